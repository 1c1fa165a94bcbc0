"""Which pairs of bodies can be near the bound of the separation filter at all: the others are not even looked at.

Two bodies accelerate towards each other by at most A too hard, and close by at most V: the sums of how far each one's
acceleration and velocity are from the swarm's mean, for what all do alike brings no two together. With the root of
`closing_limit` at least R = sqrt(pad^2 + 2 BRAKE (distance - clearance)), what is looked for is

    excess <= A + V (RATE + (BRAKE + V^2 / distance) / R) - RATE (R - pad),

which is below the bound from some R on; (a + b)^3 <= 4 (a^3 + b^3) divides that R between the two. Beyond the distance
of it, the reach, nothing is left out that the filter would have used: its decisions are the same to the bit.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Bool, Float
from formation.maths.kernel import kernel
from formation.maths.sweep import Index, ascending, widest_axis

BRAKE_M_S2 = 4.0  # two thirds of what a tilt of 0.6 rad gives: one of a pair alone can do it, against wind too
REACTION_S = 0.25  # how long it takes to turn towards it: dead time is predicted, lag and a saturated turn are not
BARRIER_RATE_1_S = 6.0
NEARBY_M_S2 = 20.0  # pairs this far from their bound may be driven to it by what others are changed
PAD_M_S = BRAKE_M_S2 * REACTION_S
ROUNDING_M_S2 = 0.01
"""More than all rounding of an excess."""
ROOT_LEAST_M_S = PAD_M_S + (NEARBY_M_S2 + ROUNDING_M_S2) / BARRIER_RATE_1_S
"""R of two that move as all do; more for others, so that R and distance are nowhere less where it matters."""
DISTANCE_LEAST_M = (ROOT_LEAST_M_S**2 - PAD_M_S**2) / (2.0 * BRAKE_M_S2)


class Bodies(NamedTuple):
    """All n bodies; arrays, for every pair looks at them.

    motion (n, 3, 3): position, velocity and acceleration (rows), as demanded and as disturbed; acc_m_s2 (n, 3): the
    estimated one; grown_m: uncertainty of the position; known: ever seen; controllable: its demand may be altered;
    responds: follows its commands, as far as is known; unresponsive: surely does not; lost: unseen, at unknown height.
    """

    motion: Float
    acc_m_s2: Float
    grown_m: Float
    known: Bool
    controllable: Bool
    responds: Bool
    unresponsive: Bool
    lost: Bool


@kernel
def near_pairs(least_m: float, bodies: Bodies) -> NDArray[np.int64]:
    """The pairs (k, 2) of known bodies a > b within reach, one of them controllable, in ascending order.

    least_m: the separation. Of a body that is lost the height does not count. Where a number is not finite, all pairs.
    """
    shares = _root_shares(bodies)
    share_most, grown_most = 0.0, 0.0
    for n in range(len(shares)):
        if bodies.known[n]:  # not max(): NaN is to stay
            share_most = share_most if shares[n] <= share_most else shares[n]
            grown_most = max(grown_most, bodies.grown_m[n])
    axis = widest_axis(bodies.motion[:, 0], bodies.known, 2)
    along = bodies.motion[:, 0, axis]
    order = ascending(along, bodies.known)
    rank = np.zeros(len(shares), np.int64)
    for k in range(len(order)):
        rank[order[k]] = k
    pairs, count = np.empty((4 * len(shares), 2), np.int64), 0
    others = np.empty(len(shares), np.int64)
    for a in range(len(shares)):
        if not bodies.known[a]:
            continue
        window_m = _reach_m(shares[a] + share_most, least_m + bodies.grown_m[a] + grown_most)
        found = 0
        for step in (-1, 1):
            k = rank[a] + step
            while 0 <= k < len(order) and not abs(along[order[k]] - along[a]) > window_m:
                b = order[k]
                if b < a and _is_within_reach(least_m, bodies, shares, a, b):
                    found = _insert(b, others, found)
                k += step
        if count + found > len(pairs):
            longer = np.empty((2 * (count + found), 2), np.int64)
            for k in range(count):
                longer[k, 0], longer[k, 1] = pairs[k, 0], pairs[k, 1]
            pairs = longer
        for k in range(found):
            pairs[count, 0], pairs[count, 1] = a, others[k]
            count += 1
    return pairs[:count]


@kernel
def _root_shares(bodies: Bodies) -> Float:
    """Each body's part (n) of R, m/s; NaN everywhere where any number of a known body is not finite."""
    motion, count, mean = bodies.motion, 0, np.zeros((2, 3))
    for n in range(len(motion)):
        if bodies.known[n]:
            count += 1
            for axis in range(3):
                nothing = 0.0 * motion[n, 0, axis] + 0.0 * bodies.acc_m_s2[n, axis]
                mean[0, axis] += motion[n, 1, axis] + nothing
                mean[1, axis] += motion[n, 2, axis]
    mean /= max(count, 1)
    shares = np.zeros(len(motion))
    for n in range(len(motion)):
        speed, demanded, measured = 0.0, 0.0, 0.0
        for axis in range(3):
            speed += (motion[n, 1, axis] - mean[0, axis]) ** 2
            demanded += (motion[n, 2, axis] - mean[1, axis]) ** 2
            measured += (bodies.acc_m_s2[n, axis] - mean[1, axis]) ** 2
        v, acc = sqrt(speed), sqrt(max(demanded, measured))
        closing = BARRIER_RATE_1_S * v + (BRAKE_M_S2 * v + 4.0 * v * v * v / DISTANCE_LEAST_M) / ROOT_LEAST_M_S
        shares[n] = (acc + closing) / BARRIER_RATE_1_S
    return shares


@kernel
def _reach_m(shares: float, clearance_m: float) -> float:
    """Beyond this distance two bodies of these parts of R together are not near their bound."""
    root = ROOT_LEAST_M_S + shares
    return clearance_m + (root * root - PAD_M_S * PAD_M_S) / (2.0 * BRAKE_M_S2)


@kernel
def _is_within_reach(least_m: float, bodies: Bodies, shares: Float, a: int, b: int) -> bool:
    """Whether a pair may be near its bound; the rounding of squares is in ROUNDING_M_S2."""
    if not (bodies.controllable[a] or bodies.controllable[b]):
        return False
    up = 0.0 if bodies.lost[a] or bodies.lost[b] else 1.0
    x, y = bodies.motion[a, 0, 0] - bodies.motion[b, 0, 0], bodies.motion[a, 0, 1] - bodies.motion[b, 0, 1]
    z = up * (bodies.motion[a, 0, 2] - bodies.motion[b, 0, 2])
    reach_m = _reach_m(shares[a] + shares[b], least_m + bodies.grown_m[a] + bodies.grown_m[b])
    return not x * x + y * y + z * z > reach_m * reach_m


@kernel
def _insert(index: int, ascending_indices: Index, count: int) -> int:
    """Insert it in its place; how many they are now."""
    at = count
    while at > 0 and ascending_indices[at - 1] > index:
        ascending_indices[at] = ascending_indices[at - 1]
        at -= 1
    ascending_indices[at] = index
    return count + 1
