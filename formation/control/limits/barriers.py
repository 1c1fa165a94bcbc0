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
from formation.control.limits.bodies import BODY, BarrierSettings, Body, place
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

    away: unit vector from second to first, less its vertical part unless they are stacked; excess: by how much they
    accelerate towards each other too hard; push: how hard each is pushed along it so far.
    """

    first: int
    second: int
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
def excess(a: Body, b: Body, separation_m: float, away: Float) -> float:
    """How much too hard a and b accelerate towards each other, m/s^2; the direction in which a is to part into away.

    Of a lost body nobody knows how high it is: it is kept clear of at any height.
    """
    axes = 2 if a.lost or b.lost else 3
    square, speed_square, closing = 0.0, 0.0, 0.0
    away[2] = 0.0
    for axis in range(axes):
        away[axis] = a.pos_lab_m[axis] - b.pos_lab_m[axis]
        square += away[axis] * away[axis]
    distance = sqrt(square)
    if distance < 1e-6:
        away[0], away[1], away[2] = 1.0, 0.0, 0.0
    else:
        for axis in range(axes):
            away[axis] /= distance
    closing_acc = 0.0
    for axis in range(axes):
        speed = a.vel_lab_m_s[axis] - b.vel_lab_m_s[axis]
        closing -= away[axis] * speed
        speed_square += speed * speed
        closing_acc -= away[axis] * (a.acc_lab_m_s2[axis] - b.acc_lab_m_s2[axis])
    across_square = max(speed_square - closing * closing, 0.0)
    closing_acc -= across_square / max(distance, 0.5 * separation_m)
    keep_m = separation_m + a.grown_m + b.grown_m
    if away[2] * away[2] <= STEEP:
        away[2] = 0.0
    return closing_acc - closing_limit(distance, keep_m, separation_m, closing, sqrt(across_square))


@kernel
def _bounded(
    settings: Rows[BarrierSettings], wanted: Rows[Demand], estimates: Rows[VehicleEstimate],
    references: Rows[VehicleReference], now_ns: int, out: Rows[Demand],
) -> bool:  # fmt: skip
    """See `bounded`; whether anything had to be altered, and then out (m) is filled."""
    bodies = np.empty(len(settings), BODY)
    change, bits = np.zeros((len(wanted), 3)), np.zeros(len(wanted))
    for n in range(len(bodies)):
        place(settings[n], estimates[n], wanted, references, now_ns, bodies[n])
        if settings[n].keep_slow and bodies[n].yields:
            _slow_down(settings[n], bodies[n], change[settings[n].place], bits)
    _keep_apart(settings, bodies, change, bits)
    altered = False
    for i in range(len(wanted)):
        altered = altered or bits[i] > 0.0
    if altered:
        for n in range(len(bodies)):
            i = settings[n].place
            if i >= 0:
                out[i] = wanted[i]
                if bits[i] > 0.0:
                    _apply(change[i], bits[i], settings[n].sideways_m_s2, out[i])
    return altered


@kernel
def _slow_down(s: BarrierSettings, body: Body, change: Float, bits: Float) -> None:
    """Bounds the body's acceleration along its velocity, so that its speed ends at the limit; change (3), bits (m)."""
    v, acc = body.vel_lab_m_s, body.acc_lab_m_s2
    speed = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if speed < FAST * s.speed_max_m_s:
        return
    along = (acc[0] * v[0] + acc[1] * v[1] + acc[2] * v[2]) / speed
    over = along - SPEED_RATE_1_S * (s.speed_max_m_s - speed)
    if over > 0.0:
        bits[s.place] += SPEED
        for axis in range(3):
            change[axis] -= over * v[axis] / speed
            acc[axis] -= over * v[axis] / speed


@kernel
def _keep_apart(settings: Rows[BarrierSettings], bodies: Rows[Body], change: Float, bits: Float) -> None:
    """Adds to change (m, 3) the least that keeps all pairs, and tells whose demand it alters in bits (m)."""
    pairs, away, count, broken = np.empty(0, PAIR), np.empty(3), 0, False
    for turn in range(2):
        for a in range(len(bodies)):
            for b in range(a):
                if _meet(settings[a], bodies[a], bodies[b]):
                    over = excess(bodies[a], bodies[b], settings[a].separation_m, away)
                    broken = broken or over > 0.0
                    if turn > 0 and over > -NEARBY_M_S2:
                        pair = pairs[count]
                        pair.first, pair.second, pair.excess_m_s2, pair.push_m_s2 = a, b, over, 0.0
                        for axis in range(3):
                            pair.away[axis] = away[axis]
                        count += 1
        if not broken:
            return
        if turn == 0:
            pairs = np.empty(len(bodies) * (len(bodies) - 1) // 2, PAIR)
    apart = np.zeros((len(bodies), 3))
    _share(bodies, pairs[:count], apart)
    for n in range(len(bodies)):
        size = apart[n, 0] * apart[n, 0] + apart[n, 1] * apart[n, 1] + apart[n, 2] * apart[n, 2]
        if size > 0.0:
            bits[settings[n].place] += SEPARATION
            for axis in range(3):
                change[settings[n].place, axis] += apart[n, axis]


@kernel
def _meet(s: BarrierSettings, a: Body, b: Body) -> bool:
    """Whether these two are to be kept apart: both somewhere, and at least one of them yields."""
    return s.keep_apart and a.known and b.known and (a.yields or b.yields)


@kernel
def _share(bodies: Rows[Body], pairs: Rows[Pair], apart: Float) -> None:
    """The least accelerations apart (n, 3), in the sum of squares, that take away all excess (Hildreth)."""
    for _ in range(PASSES):
        moved = 0.0
        for k in range(len(pairs)):
            pair = pairs[k]
            a, b, away = pair.first, pair.second, pair.away
            left, square = pair.excess_m_s2, 0.0
            for axis in range(3):
                left -= away[axis] * (apart[a, axis] - apart[b, axis])
                square += away[axis] * away[axis]
            weight = (1.0 if bodies[a].yields else 0.0) + (1.0 if bodies[b].yields else 0.0)
            push = max(pair.push_m_s2 + left / (weight * square), 0.0)
            more = push - pair.push_m_s2
            pair.push_m_s2 = push
            moved = max(moved, abs(more))
            for axis in range(3):
                if bodies[a].yields:
                    apart[a, axis] += more * away[axis]
                if bodies[b].yields:
                    apart[b, axis] -= more * away[axis]
        if moved < SETTLED_M_S2:
            return


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
