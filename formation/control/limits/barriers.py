"""The separation filter and the speed limit: demands altered before they are sent, as little as keeps the barriers.

Two bodies may close no faster than lets them stop, a separation apart, with a deceleration that one of the two has to
spare and after a delay for it to begin; so may no vehicle gain speed faster than lets it end at the limit. These are
barrier functions of the demanded accelerations, linear in them (Ames et al., Control barrier functions, ECC 2019;
pairwise between vehicles: Wang, Ames, Egerstedt, IEEE T-RO 2017). The least change that keeps all pairs is found by
Hildreth's method, pair after pair, each sharing what is missing. Where nothing is near, not a bit is changed.

The barriers see every body where it will be when a command sent now takes hold, or where it may be. A body that is not
seen is somewhere about where it was: around its last place, drifting with what is left of its last velocity, a keep-out
grows by what it can do, at any height, until it is seen again.
"""

from dataclasses import dataclass
from math import exp, sqrt

import numpy as np
from numpy.typing import NDArray

from formation.control.law import Demand
from formation.control.limits.near_pairs import (
    BARRIER_RATE_1_S,
    BRAKE_M_S2,
    NEARBY_M_S2,
    REACTION_S,
    Bodies,
    near_pairs,
)
from formation.estimation.response import MISMATCH_BAD, MISMATCH_WARN, NEVER_NS, SECONDS
from formation.estimation.state import VehicleEstimate
from formation.guidance.reference_generator import VehicleReference
from formation.maths.arrays import Float, Vec3
from formation.maths.kernel import kernel
from formation.maths.records import Rows, dtype_of, like
from formation.messages import Saturation

UNSEEN_S = 0.1  # until then where it is predicted to be is where it is
DRIFT_S = 0.5  # how soon its last velocity is gone: a drone's agent levels and holds at 0.1 s, who carries one stops
ABLE_M_S2 = 4.0
VERTICAL_DIST_MAX_M_S2 = 4.0  # what no wind, battery or propeller does to a vehicle whose thrust is as commanded
GROWN_MOST_M = 0.3  # a drone without setpoints is at rest within this
SPEED, SEPARATION = float(Saturation.SPEED), float(Saturation.SEPARATION)
SPEED_RATE_1_S, FAST = 6.0, 0.5  # where it begins, as a share of the limit: what is demanded below it is let be
STEEP = 0.75  # sine squared of the elevation from which two are stacked, and part upwards and downwards
PASSES, SETTLED_M_S2 = 60, 1e-9


@dataclass(frozen=True, slots=True)
class BarrierSettings:
    """What is kept with one of the n bodies; a record.

    place: among the commanded vehicles, or -1; dead_s: dead time of attitudes; sideways_m_s2: what the tilt limit
    gives; separation_on, keep_out_on, speed_limit_on: which barriers there are.
    """

    commanded_index: int
    dead_s: float
    separation_m: float
    speed_m_s: float
    sideways_m_s2: float
    separation_on: bool
    keep_out_on: bool
    speed_limit_on: bool


@dataclass(slots=True)
class Pair:
    """Two bodies that may be too near; a record.

    away: unit vector from second to first, less its vertical part unless they are stacked; takes: of a push, how
    much each does; excess: by how much they accelerate towards each other too hard; push: how hard along it so far.
    """

    first: int
    second: int
    first_share: float
    second_share: float
    away: Vec3
    excess_m_s2: float
    push_m_s2: float


PAIR = dtype_of(Pair)


def limit_demands(
    settings: Rows[BarrierSettings], wanted: Rows[Demand], estimates: Rows[VehicleEstimate],
    references: Rows[VehicleReference], now_ns: int,
) -> Rows[Demand]:  # fmt: skip
    """The demands (m) altered as little as keeps every vehicle slow enough and apart from all n bodies.

    The very same object where nothing had to be altered.
    """
    out = like(wanted)
    return out if _limit_demands(settings, wanted, estimates, references, now_ns, out) else wanted


@kernel
def _limit_demands(
    settings: Rows[BarrierSettings], wanted: Rows[Demand], estimates: Rows[VehicleEstimate],
    references: Rows[VehicleReference], now_ns: int, out: Rows[Demand],
) -> bool:  # fmt: skip
    """See `bounded`; whether anything had to be altered, and then out (m) is filled."""
    bodies = placed(settings, estimates, wanted, references, now_ns)
    change, bits = np.zeros((len(settings), 3)), np.zeros(len(settings))
    for n in range(len(settings)):
        if settings[n].speed_limit_on and bodies.controllable[n]:
            bits[n] += _limit_speed(settings[n].speed_m_s, bodies.motion[n], change[n])
    if settings[0].separation_on:
        _separate(settings[0].separation_m, bodies, change, bits)
    altered = False
    for n in range(len(settings)):
        altered = altered or bits[n] > 0.0
    if altered:
        for n in range(len(settings)):
            i = settings[n].commanded_index
            if i >= 0:
                out[i] = wanted[i]
                if bits[n] > 0.0:
                    _apply(change[n], bits[n], settings[n].sideways_m_s2, out[i])
    return altered


@kernel
def placed(
    settings: Rows[BarrierSettings], estimates: Rows[VehicleEstimate], wanted: Rows[Demand],
    references: Rows[VehicleReference], now_ns: int,
) -> Bodies:  # fmt: skip
    """The bodies with their motions, extrapolated for bodies that are unseen."""
    count = len(settings)
    motion, acc_m_s2, grown_m = np.zeros((count, 3, 3)), np.zeros((count, 3)), np.zeros(count)
    known, controllable, responds, unresponsive, lost = np.zeros((5, count), np.bool_)
    for n in range(count):
        s, z = settings[n], estimates[n]
        unseen_s = (z.t_ns - z.seen.t_ns) * SECONDS
        known[n] = z.seen.t_ns > NEVER_NS
        lost[n] = s.keep_out_on and unseen_s > UNSEEN_S
        controllable[n] = s.commanded_index >= 0 and not lost[n] and references[s.commanded_index].airborne
        unresponsive[n] = abs(z.dist_lab_m_s2[2]) > VERTICAL_DIST_MAX_M_S2 or z.model_error.mismatch > MISMATCH_BAD
        responds[n] = z.model_error.mismatch < MISMATCH_WARN and not unresponsive[n]
        for axis in range(3):
            acc_m_s2[n, axis] = min(max(z.motion[2, axis], -ABLE_M_S2), ABLE_M_S2)
        if lost[n]:
            decay = exp(-unseen_s / DRIFT_S)
            grown_m[n] = min(0.5 * ABLE_M_S2 * unseen_s * unseen_s, GROWN_MOST_M)
            for axis in range(3):
                speed = z.seen.vel_lab_m_s[axis]
                motion[n, 0, axis] = z.seen.pos_lab_m[axis] + DRIFT_S * (1.0 - decay) * speed
                motion[n, 1, axis] = decay * speed
        elif controllable[n]:
            demand = wanted[s.commanded_index]
            for axis in range(3):
                motion[n, 0, axis], motion[n, 1, axis] = demand.motion[0, axis], demand.motion[1, axis]
                motion[n, 2, axis] = demand.acc_lab_m_s2[axis] + z.dist_lab_m_s2[axis]
        else:
            ahead_s = (now_ns - z.t_ns) * SECONDS + s.dead_s
            for axis in range(3):
                motion[n, 0, axis] = z.motion[0, axis] + ahead_s * z.motion[1, axis]
                motion[n, 1, axis] = z.motion[1, axis]
                motion[n, 2, axis] = acc_m_s2[n, axis]  # a guess: nobody asked for it
    return Bodies(motion, acc_m_s2, grown_m, known, controllable, responds, unresponsive, lost)


@kernel
def _limit_speed(speed_m_s: float, motion: Float, change: Float) -> float:
    """Bounds the acceleration along the velocity, so that a body's speed ends at the limit; the bit if it had to."""
    v, acc = motion[1], motion[2]
    speed = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if speed < FAST * speed_m_s:
        return 0.0
    along = (acc[0] * v[0] + acc[1] * v[1] + acc[2] * v[2]) / speed
    over = along - SPEED_RATE_1_S * (speed_m_s - speed)
    if over <= 0.0:
        return 0.0
    for axis in range(3):
        change[axis] -= over * v[axis] / speed
        acc[axis] -= over * v[axis] / speed
    return SPEED


@kernel
def _separate(separation_m: float, bodies: Bodies, change: Float, bits: Float) -> None:
    """Adds to change (n, 3) the least that keeps all pairs, and sets bits (n) of the bodies whose demand it alters."""
    count, within_reach = len(bodies.known), near_pairs(separation_m, bodies)
    pairs = np.empty(2 * len(within_reach), PAIR)
    found, broken = _near(separation_m, bodies, within_reach, pairs)
    if not broken:
        return
    pushes = np.zeros((count, 3))
    _share(pairs[:found], pushes)
    for n in range(count):
        if pushes[n, 0] != 0.0 or pushes[n, 1] != 0.0 or pushes[n, 2] != 0.0:
            bits[n] += SEPARATION
            for axis in range(3):
                change[n, axis] += pushes[n, axis]


@kernel
def _near(separation_m: float, bodies: Bodies, within_reach: NDArray[np.int64], pairs: Rows[Pair]) -> tuple[int, bool]:
    """Fills in those within reach (k, 2) that are near their bound; how many, and whether any is beyond it.

    Where one of two does not answer, the other makes room for what it does; what is demanded of it is altered as if it
    obeyed, for it may do so at any time, and as if it were alone.
    """
    controllable, responds = bodies.controllable, bodies.responds
    away, found, broken = np.empty(3), 0, False
    for k in range(len(within_reach)):
        a, b = within_reach[k, 0], within_reach[k, 1]
        over = excess(bodies, a, b, separation_m, False, away)
        obeying = over if responds[a] and responds[b] else excess(bodies, a, b, separation_m, True, away)
        broken = broken or over > 0.0 or obeying > 0.0
        if controllable[a] and controllable[b] and responds[a] != responds[b]:
            found += _add_pair(pairs[found], a, b, responds[a], responds[b], over, away)
            found += _add_pair(pairs[found], a, b, responds[b], responds[a], obeying, away)
        else:
            found += _add_pair(pairs[found], a, b, controllable[a], controllable[b], max(over, obeying), away)
    return found, broken


@kernel
def excess(bodies: Bodies, a: int, b: int, least_m: float, obey: bool, away: Float) -> float:
    """How much too hard a and b accelerate towards each other, m/s^2; the direction in which a is to part into away.

    least_m: the separation; of a body that is lost the height does not count. obey: were both to do as demanded.
    """
    motion, clearance_m = bodies.motion, least_m + bodies.grown_m[a] + bodies.grown_m[b]
    up = 0.0 if bodies.lost[a] or bodies.lost[b] else 1.0
    x, y, z = motion[a, 0, 0] - motion[b, 0, 0], motion[a, 0, 1] - motion[b, 0, 1], motion[a, 0, 2] - motion[b, 0, 2]
    distance = sqrt(x * x + y * y + up * z * z)
    if distance < 1e-6:
        x, y, z = 1.0, 0.0, 0.0
    else:
        x, y, z = x / distance, y / distance, up * z / distance
    vx, vy = motion[a, 1, 0] - motion[b, 1, 0], motion[a, 1, 1] - motion[b, 1, 1]
    vz = up * (motion[a, 1, 2] - motion[b, 1, 2])
    closing = -(x * vx + y * vy + z * vz)
    across_square = max(vx * vx + vy * vy + vz * vz - closing * closing, 0.0)
    closing_acc = -across_square / max(distance, 0.5 * least_m)
    closing_acc -= acceleration_along(bodies, a, x, y, z, obey)
    closing_acc -= acceleration_along(bodies, b, -x, -y, -z, obey)
    away[0], away[1], away[2] = x, y, z if z * z > STEEP else 0.0
    over: float = closing_acc - closing_limit(distance, clearance_m, least_m, closing, sqrt(across_square))
    return over


@kernel
def acceleration_along(bodies: Bodies, n: int, x: float, y: float, z: float, obeys: bool) -> float:
    """Acceleration of body n along a unit vector: the demanded one, or the estimated one of an unresponsive body.

    A body that may be either has the smaller of the two.
    """
    wanted, has = bodies.motion[n, 2], bodies.acc_m_s2[n]
    demanded: float = x * wanted[0] + y * wanted[1] + z * wanted[2]
    if obeys or bodies.responds[n]:
        return demanded
    force_meas: float = x * has[0] + y * has[1] + z * has[2]
    return force_meas if bodies.unresponsive[n] else min(demanded, force_meas)


@kernel
def closing_limit(
    distance_m: float, clearance_m: float, least_m: float, closing_m_s: float, across_m_s: float
) -> float:
    """How hard, m/s^2, two bodies may accelerate towards each other.

    From the speed at which braking, after the reaction, and their passing each other sideways (across_m_s; its angular
    momentum lasts) stop them clearance_m apart. Within it nobody may come nearer; nearer than least_m they part.
    """
    pad = BRAKE_M_S2 * REACTION_S
    allowed, slope = 0.0, 1.0 / REACTION_S
    if distance_m > clearance_m:
        square = across_m_s * across_m_s
        ratio = distance_m / clearance_m
        root = sqrt(pad * pad + 2.0 * BRAKE_M_S2 * (distance_m - clearance_m) + square * (ratio * ratio - 1.0))
        allowed, slope = root - pad, (BRAKE_M_S2 + square / distance_m) / root
    elif distance_m < least_m:
        allowed = (distance_m - least_m) / REACTION_S
    return BARRIER_RATE_1_S * (allowed - closing_m_s) - slope * closing_m_s


@kernel
def _add_pair(pair: Pair, a: int, b: int, a_share: bool, b_share: bool, over: float, away: Float) -> int:
    """Fills in a pair that is near its bound; how many that were."""
    if over <= -NEARBY_M_S2:
        return 0
    pair.first, pair.second, pair.excess_m_s2, pair.push_m_s2 = a, b, over, 0.0
    pair.first_share, pair.second_share = 1.0 if a_share else 0.0, 1.0 if b_share else 0.0
    for axis in range(3):
        pair.away[axis] = away[axis]
    return 1


@kernel
def _share(pairs: Rows[Pair], pushes: Float) -> None:
    """The least accelerations apart (n, 3), in the sum of squares, that take away all excess (Hildreth)."""
    for _ in range(PASSES):
        moved = 0.0
        for k in range(len(pairs)):
            pair = pairs[k]
            a, b, x, y, z = pair.first, pair.second, pair.away[0], pair.away[1], pair.away[2]
            on_a, on_b = pair.first_share, pair.second_share
            gained = on_a * (x * pushes[a, 0] + y * pushes[a, 1] + z * pushes[a, 2])
            gained -= on_b * (x * pushes[b, 0] + y * pushes[b, 1] + z * pushes[b, 2])
            share = (on_a + on_b) * (x * x + y * y + z * z)
            push = max(pair.push_m_s2 + (pair.excess_m_s2 - gained) / share, 0.0)
            more = push - pair.push_m_s2
            pair.push_m_s2 = push
            moved = max(moved, abs(more))
            for axis in range(3):
                pushes[a, axis] += on_a * more * pair.away[axis]
                pushes[b, axis] -= on_b * more * pair.away[axis]
        if moved < SETTLED_M_S2:
            break


@kernel
def _apply(change: Float, bits: float, sideways_m_s2: float, out: Demand) -> None:
    """Alters a demand by change (3); what the law asks across it gives way where both together would tilt too far."""
    acc, lead = out.acc_lab_m_s2, out.lead_acc_lab_m_s2
    square, lead_along = 0.0, 0.0
    for axis in range(3):
        acc[axis] += change[axis]
        square += change[axis] * change[axis]
        lead_along += lead[axis] * change[axis]
    if lead_along < 0.0:  # inverting the lag must not undo it
        for axis in range(3):
            lead[axis] -= lead_along * change[axis] / square
    flat = sqrt(change[0] * change[0] + change[1] * change[1])
    if flat > 0.0 and acc[0] * acc[0] + acc[1] * acc[1] > sideways_m_s2 * sideways_m_s2:
        ux, uy = change[0] / flat, change[1] / flat
        along, across = acc[0] * ux + acc[1] * uy, acc[1] * ux - acc[0] * uy
        along = min(max(along, -sideways_m_s2), sideways_m_s2)
        across_max = sqrt(sideways_m_s2 * sideways_m_s2 - along * along)
        across = min(max(across, -across_max), across_max)
        acc[0], acc[1] = along * ux - across * uy, along * uy + across * ux
    out.limits_met = bits
