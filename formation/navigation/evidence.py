"""Evidence of declared faults in the innovations: a generalised likelihood-ratio test over a bank of onsets.

Willsky and Jones (IEEE TAC 21, 1976). A fault of amplitude a that began at an onset adds f a to what a source observes,
and so g a to its innovation, g = f - h' m; what it does to the error state, m a, obeys the filter's own F and k:

    m = F m,   m += k g,   c += g g' / s,   d += g innovation / s,   2 ln(likelihood ratio) = d' c^-1 d

which is chi-square with as many degrees as a has axes where there is no fault. Onsets are the stamps of poses, thinned
so that their ages rise in about equal ratios; each keeps the estimate of then, to roll back to.
"""

from dataclasses import dataclass
from math import sqrt
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Float, Layout
from formation.maths.copying import copy_into
from formation.maths.kernel import kernel
from formation.maths.records import Rows, blank
from formation.navigation.state import DELAY, ERRORS, POSE_ATTITUDE, POSE_POSITION, SCALE, THRUST, Estimate, Fault

NOTHING, STEP, RAMP, LATE, LATER, LOSS = range(6)
"""What a fault adds to an observation: 1 or its age along an axis; a step or ramp of the delay, a step of the scale."""
ONSETS = 16
OLDEST_NS = 4_000_000_000
"""Of onsets: from one pose to this age, in 16 steps of 1.45 at 100 Hz; a velocity is as good as new after that."""
_SINGULAR = 1e-9
CLEARLY = 1.0 + 1e-6
"""More: of faults that explain the same alike, to rounding, the first of the table is named."""
Index = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Shape:
    """One fault as the kernels have it; a record.

    position, attitude, thrust: what it adds to those of a source. axes: 3, or 1 where its amplitude is a number.
    first: its first column. threshold: of the statistic. least: amplitude below which it does not matter; most: that
    it can have.
    rolls_back: whether poses are wrong by it.
    """

    position: int
    attitude: int
    thrust: int
    axes: int
    first: int
    threshold: float
    least: float
    most: float
    rolls_back: bool


@dataclass(slots=True)
class Onset:
    """One hypothesis of one body: that faults began after t_ns; 0: none."""

    t_ns: int
    estimate: Estimate


@dataclass(slots=True)
class Order:
    """The onsets of one body, newest first, and how many there are."""

    count: int
    slots: Annotated[Float, Layout(np.int64, (ONSETS,))]


class Bank(NamedTuple):
    """The hypotheses of n bodies: m, d and c above, of every column of every onset, side by side.

    onsets (n * ONSETS); response (n, errors, ONSETS * columns); evidence (n, ONSETS * columns); information
    (n, 3, ONSETS * columns). partners (3, ONSETS * columns): of each column those of its fault's axes, itself for lack
    of more. What it says of an onset that is none is not read: it begins anew with the onset.
    """

    shapes: Rows[Shape]
    partners: Index
    onsets: Rows[Onset]
    order: Rows[Order]
    response: Float
    evidence: Float
    information: Float


def empty_bank(shapes: Rows[Shape], n: int) -> Bank:
    """Of n bodies, without a hypothesis."""
    columns = np.concatenate([_partners(each.first, each.axes) for each in (shapes[k] for k in range(len(shapes)))], 1)
    partners = np.concatenate([columns + slot * columns.shape[1] for slot in range(ONSETS)], 1)
    width = partners.shape[1]
    onsets, order = blank(Onset, n * ONSETS), blank(Order, n)
    return Bank(
        shapes, partners, onsets, order, np.zeros((n, ERRORS, width)), np.zeros((n, width)), np.zeros((n, 3, width))
    )


def _partners(first: int, axes: int) -> Index:
    own = np.arange(first, first + axes)
    return np.stack([np.full(axes, first + axis) if axis < axes else own for axis in range(3)])


@kernel
def copy_estimate(old: Estimate, new: Estimate) -> None:
    """new = old."""
    new.t_ns = old.t_ns
    copy_into(old.pos_lab_m, new.pos_lab_m)
    copy_into(old.vel_lab_m_s, new.vel_lab_m_s)
    copy_into(old.q_lab_from_flu, new.q_lab_from_flu)
    copy_into(old.accel_bias_flu_m_s2, new.accel_bias_flu_m_s2)
    copy_into(old.level_bias_flu_rad, new.level_bias_flu_rad)
    new.thrust_scale, new.pose_delay_s, new.thrust_m_s2 = old.thrust_scale, old.pose_delay_s, old.thrust_m_s2
    copy_into(old.rate_flu_rad_s, new.rate_flu_rad_s)
    copy_into(old.force_lab_m_s2, new.force_lab_m_s2)
    for row in range(ERRORS):
        copy_into(old.cov[row], new.cov[row])


@kernel
def reset_onsets(bank: Bank, i: int) -> None:
    """Body i has no hypothesis any more."""
    bank.order[i].count = 0


@kernel
def add_onset(bank: Bank, i: int, x: Estimate) -> None:
    """Faults of body i may have begun now, after the pose that x was corrected by."""
    order = bank.order[i]
    slots, onsets = order.slots, bank.onsets
    count = order.count
    gone = count
    if count < ONSETS:
        order.count += 1
        slot = count
    else:
        gone = ONSETS - 1
        if x.t_ns - onsets[i * ONSETS + slots[gone]].t_ns <= OLDEST_NS:
            least = np.inf
            for k in range(1, ONSETS - 1):
                newer, older = onsets[i * ONSETS + slots[k - 1]].t_ns, onsets[i * ONSETS + slots[k + 1]].t_ns
                ratio = (newer - older) / (x.t_ns - onsets[i * ONSETS + slots[k]].t_ns)
                if ratio < least:
                    least, gone = ratio, k
        slot = slots[gone]
    for k in range(gone, 0, -1):
        slots[k] = slots[k - 1]
    slots[0] = slot
    onset = onsets[i * ONSETS + slot]
    onset.t_ns = x.t_ns
    copy_estimate(x, onset.estimate)
    columns = bank.evidence.shape[1] // ONSETS
    first, last = slot * columns, (slot + 1) * columns
    bank.response[i, :, first:last] = 0.0
    bank.evidence[i, first:last] = 0.0
    bank.information[i, :, first:last] = 0.0


@kernel
def add_evidence(
    bank: Bank, i: int, t_ns: int, source: int, axis: int, h: Float, innovation: float, variance: float, gain: Float
) -> None:
    """Adds one scalar innovation, of a source along an axis of `lab`, to every hypothesis of body i.

    h: its row; gain: with which the filter used it, zero where it did not.
    """
    response, evidence, information = bank.response[i], bank.evidence[i], bank.information[i]
    width = len(evidence)
    columns = width // ONSETS
    g, partner = np.zeros(width), np.empty(width)
    order = bank.order[i]
    for row in range(len(bank.shapes)):
        shape = bank.shapes[row]
        kind = kind_of(shape, source)
        for k in range(order.count if kind != NOTHING else 0):
            slot = order.slots[k]
            first, age_s = slot * columns + shape.first, (t_ns - bank.onsets[i * ONSETS + slot].t_ns) * 1e-9
            if kind == LATE:
                g[first] = h[DELAY]
            elif kind == LATER:
                g[first] = age_s * h[DELAY]
            elif kind == LOSS:
                g[first] = h[SCALE]
            else:
                g[first + axis] = age_s if kind == RAMP else 1.0
    for state in range(ERRORS):
        if h[state] != 0.0:
            for column in range(width):
                g[column] -= h[state] * response[state, column]
    for state in range(ERRORS):
        for column in range(width):
            response[state, column] += gain[state] * g[column]
    for column in range(width):
        evidence[column] += innovation / variance * g[column]
    for b in range(3):
        for column in range(width):
            partner[column] = g[bank.partners[b, column]]
        for column in range(width):
            information[b, column] += g[column] * partner[column] / variance


@kernel
def kind_of(shape: Shape, source: int) -> int:
    """What a fault adds to a source."""
    if source == POSE_POSITION:
        return int(shape.position)
    if source == POSE_ATTITUDE:
        return int(shape.attitude)
    return int(shape.thrust) if source == THRUST else NOTHING


@kernel
def find_fault(bank: Bank, i: int, t_ns: int, fault: Fault) -> int:
    """The slot of the onset and the fault whose statistic exceeds its threshold most; -1: none does."""
    amplitude, lower, half, most, found = np.empty(3), np.empty((3, 3)), np.empty(3), 1.0, -1
    evidence, information = bank.evidence[i], bank.information[i]
    columns = bank.evidence.shape[1] // ONSETS
    for k in range(bank.order[i].count):
        slot = bank.order[i].slots[k]
        for row in range(len(bank.shapes)):
            shape = bank.shapes[row]
            first = slot * columns + shape.first
            statistic = statistic_of(evidence, information, first, shape.axes, amplitude, lower, half)
            size = sqrt(amplitude[0] ** 2 + amplitude[1] ** 2 + amplitude[2] ** 2)
            if shape.position == LATE or shape.position == LATER:
                size = amplitude[0]  # poses come later by a fault, and never from the future
            if statistic > most * shape.threshold * CLEARLY and shape.least <= size <= shape.most:
                most, found = statistic / shape.threshold, slot
                fault.row, fault.t_ns, fault.statistic = row, t_ns, statistic
                fault.onset_ns = bank.onsets[i * ONSETS + slot].t_ns
                copy_into(amplitude, fault.amplitude)
    return found


@kernel
def statistic_of(
    evidence: Float, information: Float, first: int, axes: int, amplitude: Float, lower: Float, half: Float
) -> float:  # fmt: skip
    """d' c^-1 d and c^-1 d by Cholesky, of 1 to 3 axes; axes that look like the state's own error are left out.

    first: column of the first axis; lower (3, 3), half (3): overwritten.
    """
    statistic = 0.0
    for a in range(3):
        amplitude[a], half[a] = 0.0, 0.0
        for b in range(3):
            lower[a, b] = 0.0
    for a in range(axes):
        for b in range(a + 1):
            total = information[a, first + b]
            for k in range(b):
                total -= lower[a, k] * lower[b, k]
            if a != b:
                lower[a, b] = total / lower[b, b] if lower[b, b] > 0.0 else 0.0
            elif total > _SINGULAR * information[a, first + a]:
                lower[a, a] = sqrt(total)
        if lower[a, a] > 0.0:
            half[a] = evidence[first + a]
            for k in range(a):
                half[a] -= lower[a, k] * half[k]
            half[a] /= lower[a, a]
            statistic += half[a] * half[a]
    for a in range(axes - 1, -1, -1):
        if lower[a, a] > 0.0:
            amplitude[a] = half[a]
            for k in range(a + 1, axes):
                amplitude[a] -= lower[k, a] * amplitude[k]
            amplitude[a] /= lower[a, a]
    return statistic
