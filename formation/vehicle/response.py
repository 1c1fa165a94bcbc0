"""How a vehicle answers what it was sent: dead time, then a first-order lag, driven by the history of commands.

The controller's picture of the vehicle between a sent target and a felt force. The same picture says what thrust
was delivered so far (for the observer) and where the vehicle will be when a new command takes hold (for the law).
"""

from dataclasses import dataclass
from math import exp

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Float
from formation.maths.kernel import kernel

LENGTH = 128
NEVER_NS = -(1 << 60)
SECONDS = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """The last commands sent, oldest first: t_ns (h), force (h, m, 4).

    force: specific force in `lab`, m/s^2 (what an accelerometer would feel: gravity not subtracted), then its length.
    """

    t_ns: NDArray[np.int64]
    force: Float


def no_history(vehicles: int) -> History:
    """Nothing was ever sent: motors off."""
    return History(np.full(LENGTH, NEVER_NS, dtype=np.int64), np.zeros((LENGTH, vehicles, 4)))


def remember(history: History, t_ns: int, force: Float) -> History:
    """The history with the command sent at t_ns added and the oldest forgotten; force (m, 4) as in History."""
    t, kept = np.empty_like(history.t_ns), np.empty_like(history.force)
    t[:-1], kept[:-1] = history.t_ns[1:], history.force[1:]
    t[-1], kept[-1] = t_ns, force
    return History(t, kept)


@kernel
def answer(
    sent_ns: NDArray[np.int64], sent: Float, from_ns: int, to_ns: int, dead_s: float, lag_s: float, felt: Float,
    speed: Float, travel: Float,
) -> None:  # fmt: skip
    """Turns the force felt at from_ns into that at to_ns, and tells its integrals, by the exact response.

    sent_ns (h), sent (h, k): what was sent when, along k axes; felt (k) in place; speed, travel (k): its single and
    double integral since from_ns. lag_s f' = sent(t - dead_s) - f.
    """
    dead_ns = int(dead_s * 1e9)
    for k in range(len(felt)):
        speed[k], travel[k] = 0.0, 0.0
    t_ns = from_ns
    index = len(sent_ns) - 1
    while index > 0 and sent_ns[index] + dead_ns > t_ns:
        index -= 1
    while t_ns < to_ns:
        until = to_ns
        if index + 1 < len(sent_ns) and sent_ns[index + 1] + dead_ns < until:
            until = sent_ns[index + 1] + dead_ns
        if until > t_ns:
            h = (until - t_ns) * SECONDS
            kept = exp(-h / lag_s)
            swept = lag_s * (1.0 - kept)
            for k in range(len(felt)):
                pull = sent[index, k]
                gap = felt[k] - pull
                travel[k] += speed[k] * h + 0.5 * pull * h * h + gap * lag_s * (h - swept)
                speed[k] += pull * h + gap * swept
                felt[k] = pull + gap * kept
        t_ns = until
        index = min(index + 1, len(sent_ns) - 1)
