"""The separation filter and the speed limit: demands altered before they are sent, as little as keeps the barriers.

Two bodies may close no faster than lets them stop, a separation apart, with a deceleration that one of the two has to
spare and after a delay for it to begin; so may no vehicle gain speed faster than lets it end at the limit. These are
barrier functions of the demanded accelerations, linear in them (Ames et al., Control barrier functions, ECC 2019;
pairwise between vehicles: Wang, Ames, Egerstedt, IEEE T-RO 2017). The least change that keeps all pairs is found by
Hildreth's method, pair after pair, each sharing what is missing. Where nothing is near, not a bit is changed.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np

from formation.control.composite_law import Demand
from formation.control.limits.bodies import BarrierSettings, Bodies, placed
from formation.estimation.state import VehicleEstimate
from formation.guidance.reference_generator import VehicleReference
from formation.maths.arrays import Float, Vec3
from formation.maths.kernel import kernel
from formation.maths.records import Rows, dtype_of, like

SPEED, SEPARATION = 8.0, 32.0  # bits of formation.messages.Saturation
BRAKE_M_S2 = 4.0  # two thirds of what a tilt of 0.6 rad gives: one of a pair alone can do it, against wind too
REACTION_S = 0.25  # how long it takes to turn towards it: dead time is predicted, lag and a saturated turn are not
BARRIER_RATE_1_S = 6.0
SPEED_RATE_1_S, FAST = 6.0, 0.5  # where it begins, as a share of the limit: what is demanded below it is let be
STEEP = 0.75  # sine squared of the elevation from which two are stacked, and part upwards and downwards
NEARBY_M_S2 = 20.0  # pairs this far from their bound may be driven to it by what others are changed
PASSES, SETTLED_M_S2 = 60, 1e-9


@dataclass(slots=True)
class Pair:
    """Two bodies that may be too near; a record.

    away: unit vector from second to first, less its vertical part unless they are stacked; takes: of a push, how
    much each does; excess: by how much they accelerate towards each other too hard; push: how hard along it so far.
    """

    first: int
    second: int
    first_takes: float
    second_takes: float
    away: Vec3
    excess_m_s2: float
    push_m_s2: float


PAIR = dtype_of(Pair)


def bounded(
    settings: Rows[BarrierSettings], wanted: Rows[Demand], estimates: Rows[VehicleEstimate],
    references: Rows[VehicleReference], now_ns: int,
) -> Rows[Demand]:  # fmt: skip
    """The demands (m) altered as little as keeps every vehicle slow enough and apart from all n bodies.

    The very same object where nothing had to be altered.
    """
    out = like(wanted)
    return out if _bounded(settings, wanted, estimates, references, now_ns, out) else wanted


@kernel
def closing_limit(distance_m: float, keep_m: float, least_m: float, closing_m_s: float, across_m_s: float) -> float:
    """How hard, m/s^2, two bodies may accelerate towards each other.

    From the speed at which braking, after the reaction, and their passing each other sideways (across_m_s; its angular
    momentum lasts) stop them keep_m apart. Within it nobody may come nearer; nearer than least_m they part.
    """
    pad = BRAKE_M_S2 * REACTION_S
    allowed, slope = 0.0, 1.0 / REACTION_S
    if distance_m > keep_m:
        square = across_m_s * across_m_s
        ratio = distance_m / keep_m
        root = sqrt(pad * pad + 2.0 * BRAKE_M_S2 * (distance_m - keep_m) + square * (ratio * ratio - 1.0))
        allowed, slope = root - pad, (BRAKE_M_S2 + square / distance_m) / root
    elif distance_m < least_m:
        allowed = (distance_m - least_m) / REACTION_S
    return BARRIER_RATE_1_S * (allowed - closing_m_s) - slope * closing_m_s


@kernel
def acceleration_along(bodies: Bodies, n: int, x: float, y: float, z: float, obeys: bool) -> float:
    """Of body n along a unit vector: as demanded, if it obeys; of one that does not answer as it is, if that is less.

    What is demanded of one that is deaf is of no account then.
    """
    wanted, has = bodies.motion[n, 2], bodies.acc_m_s2[n]
    demanded: float = x * wanted[0] + y * wanted[1] + z * wanted[2]
    if obeys or bodies.answers[n]:
        return demanded
    felt: float = x * has[0] + y * has[1] + z * has[2]
    return felt if bodies.deaf[n] else min(demanded, felt)


@kernel
def excess(bodies: Bodies, a: int, b: int, least_m: float, obey: bool, away: Float) -> float:
    """How much too hard a and b accelerate towards each other, m/s^2; the direction in which a is to part into away.

    least_m: the separation; of a body that is lost the height does not count. obey: were both to do as demanded.
    """
    motion, keep_m = bodies.motion, least_m + bodies.grown_m[a] + bodies.grown_m[b]
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
    over: float = closing_acc - closing_limit(distance, keep_m, least_m, closing, sqrt(across_square))
    return over


@kernel
def _bounded(
    settings: Rows[BarrierSettings], wanted: Rows[Demand], estimates: Rows[VehicleEstimate],
    references: Rows[VehicleReference], now_ns: int, out: Rows[Demand],
) -> bool:  # fmt: skip
    """See `bounded`; whether anything had to be altered, and then out (m) is filled."""
    bodies = placed(settings, estimates, wanted, references, now_ns)
    change, bits = np.zeros((len(settings), 3)), np.zeros(len(settings))
    for n in range(len(settings)):
        if settings[n].keep_slow and bodies.yields[n]:
            bits[n] += _slow_down(settings[n].speed_max_m_s, bodies.motion[n], change[n])
    if settings[0].keep_apart:
        _keep_apart(settings[0].separation_m, bodies, change, bits)
    altered = False
    for n in range(len(settings)):
        altered = altered or bits[n] > 0.0
    if altered:
        for n in range(len(settings)):
            i = settings[n].place
            if i >= 0:
                out[i] = wanted[i]
                if bits[n] > 0.0:
                    _apply(change[n], bits[n], settings[n].sideways_m_s2, out[i])
    return altered


@kernel
def _slow_down(speed_max_m_s: float, motion: Float, change: Float) -> float:
    """Bounds the acceleration along the velocity, so that a body's speed ends at the limit; the bit if it had to."""
    v, acc = motion[1], motion[2]
    speed = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if speed < FAST * speed_max_m_s:
        return 0.0
    along = (acc[0] * v[0] + acc[1] * v[1] + acc[2] * v[2]) / speed
    over = along - SPEED_RATE_1_S * (speed_max_m_s - speed)
    if over <= 0.0:
        return 0.0
    for axis in range(3):
        change[axis] -= over * v[axis] / speed
        acc[axis] -= over * v[axis] / speed
    return SPEED


@kernel
def _keep_apart(separation_m: float, bodies: Bodies, change: Float, bits: Float) -> None:
    """Adds to change (n, 3) the least that keeps all pairs, and tells whose demand it alters in bits (n)."""
    count = len(bodies.known)
    pairs = np.empty(count * (count - 1), PAIR)
    found, broken = _near(separation_m, bodies, pairs)
    if not broken:
        return
    apart = np.zeros((count, 3))
    _share(pairs[:found], apart)
    for n in range(count):
        if apart[n, 0] != 0.0 or apart[n, 1] != 0.0 or apart[n, 2] != 0.0:
            bits[n] += SEPARATION
            for axis in range(3):
                change[n, axis] += apart[n, axis]


@kernel
def _near(separation_m: float, bodies: Bodies, pairs: Rows[Pair]) -> tuple[int, bool]:
    """Fills in the pairs that are near their bound; how many, and whether any is beyond it.

    Where one of two does not answer, the other makes room for what it does; what is demanded of it is altered as if it
    obeyed, for it may do so at any time, and as if it were alone.
    """
    known, yields, answers = bodies.known, bodies.yields, bodies.answers
    away, found, broken = np.empty(3), 0, False
    for a in range(len(known)):
        for b in range(a):
            if not (known[a] and known[b] and (yields[a] or yields[b])):
                continue
            over = excess(bodies, a, b, separation_m, False, away)
            obeying = over if answers[a] and answers[b] else excess(bodies, a, b, separation_m, True, away)
            broken = broken or over > 0.0 or obeying > 0.0
            if yields[a] and yields[b] and answers[a] != answers[b]:
                found += _noted(pairs[found], a, b, answers[a], answers[b], over, away)
                found += _noted(pairs[found], a, b, answers[b], answers[a], obeying, away)
            else:
                found += _noted(pairs[found], a, b, yields[a], yields[b], max(over, obeying), away)
    return found, broken


@kernel
def _noted(pair: Pair, a: int, b: int, a_takes: bool, b_takes: bool, over: float, away: Float) -> int:
    """Fills in a pair that is near its bound; how many that were."""
    if over <= -NEARBY_M_S2:
        return 0
    pair.first, pair.second, pair.excess_m_s2, pair.push_m_s2 = a, b, over, 0.0
    pair.first_takes, pair.second_takes = 1.0 if a_takes else 0.0, 1.0 if b_takes else 0.0
    for axis in range(3):
        pair.away[axis] = away[axis]
    return 1


@kernel
def _share(pairs: Rows[Pair], apart: Float) -> None:
    """The least accelerations apart (n, 3), in the sum of squares, that take away all excess (Hildreth)."""
    for _ in range(PASSES):
        moved = 0.0
        for k in range(len(pairs)):
            pair = pairs[k]
            a, b, x, y, z = pair.first, pair.second, pair.away[0], pair.away[1], pair.away[2]
            on_a, on_b = pair.first_takes, pair.second_takes
            gained = on_a * (x * apart[a, 0] + y * apart[a, 1] + z * apart[a, 2])
            gained -= on_b * (x * apart[b, 0] + y * apart[b, 1] + z * apart[b, 2])
            share = (on_a + on_b) * (x * x + y * y + z * z)
            push = max(pair.push_m_s2 + (pair.excess_m_s2 - gained) / share, 0.0)
            more = push - pair.push_m_s2
            pair.push_m_s2 = push
            moved = max(moved, abs(more))
            for axis in range(3):
                apart[a, axis] += on_a * more * pair.away[axis]
                apart[b, axis] -= on_b * more * pair.away[axis]
        if moved < SETTLED_M_S2:
            break


@kernel
def _apply(change: Float, bits: float, sideways_m_s2: float, out: Demand) -> None:
    """Alters a demand by change (3); what the law asks across it gives way where both together would tilt too far."""
    acc, lead = out.acc_lab_m_s2, out.lead_acc_lab_m_s2
    square, led = 0.0, 0.0
    for axis in range(3):
        acc[axis] += change[axis]
        square += change[axis] * change[axis]
        led += lead[axis] * change[axis]
    if led < 0.0:  # inverting the lag must not undo it
        for axis in range(3):
            lead[axis] -= led * change[axis] / square
    flat = sqrt(change[0] * change[0] + change[1] * change[1])
    if flat > 0.0 and acc[0] * acc[0] + acc[1] * acc[1] > sideways_m_s2 * sideways_m_s2:
        ux, uy = change[0] / flat, change[1] / flat
        along, across = acc[0] * ux + acc[1] * uy, acc[1] * ux - acc[0] * uy
        along = min(max(along, -sideways_m_s2), sideways_m_s2)
        room = sqrt(sideways_m_s2 * sideways_m_s2 - along * along)
        across = min(max(across, -room), room)
        acc[0], acc[1] = along * ux - across * uy, along * uy + across * ux
    out.limits_met = bits
