"""How a vehicle answers what it was sent: dead time, then a first-order lag, driven by the history of commands.

The controller's picture of the vehicle between a sent target and the specific force it makes. The same picture says
what thrust was delivered so far (for the observer) and where the vehicle will be when a new command takes hold (for
the law).
"""

from dataclasses import dataclass
from math import exp
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Float, Layout
from formation.maths.kernel import kernel
from formation.maths.records import Rows, blank, like

LENGTH = 128
NEVER_NS = -(1 << 60)
SECONDS = 1e-9


@dataclass(frozen=True, slots=True)
class Response:
    """What is counted on of a vehicle's answer to attitude and thrust commands, s."""

    attitude_dead_s: float
    attitude_lag_s: float
    thrust_dead_s: float
    thrust_lag_s: float


@dataclass(slots=True)
class SentCommands:
    """The last commands sent to one vehicle, oldest first; a record (formation.maths.records).

    force: specific force in `lab`, m/s^2 (what an accelerometer would feel: gravity not subtracted), then its length.
    """

    t_ns: Annotated[NDArray[np.int64], Layout(np.int64, (LENGTH,))]
    force: Annotated[Float, Layout(np.float64, (LENGTH, 4))]


def no_history(vehicles: int) -> Rows[SentCommands]:
    """Nothing was ever sent: motors off."""
    nothing = blank(SentCommands, vehicles)
    nothing["t_ns"] = NEVER_NS
    return nothing


def remember(history: Rows[SentCommands], t_ns: int, force: Float) -> Rows[SentCommands]:
    """The history with the command sent at t_ns added and the oldest forgotten; force (m, 4) as in SentCommands."""
    new = like(history)
    new["t_ns"][:, :-1], new["t_ns"][:, -1] = history["t_ns"][:, 1:], t_ns
    new["force"][:, :-1], new["force"][:, -1] = history["force"][:, 1:], force
    return new


@kernel
def answer(
    sent_ns: NDArray[np.int64], sent: Float, from_ns: int, to_ns: int, dead_s: float, lag_s: float, force: Float,
    speed: Float, travel: Float,
) -> None:  # fmt: skip
    """Turns the specific force at from_ns into that at to_ns, and tells its integrals, by the exact response.

    sent_ns (h), sent (h, k): what was sent when, along k axes; force (k) in place; speed, travel (k): its single and
    double integral since from_ns. lag_s f' = sent(t - dead_s) - f.
    """
    dead_ns = int(dead_s * 1e9)
    for k in range(len(force)):
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
            for k in range(len(force)):
                pull = sent[index, k]
                gap = force[k] - pull
                travel[k] += speed[k] * h + 0.5 * pull * h * h + gap * lag_s * (h - swept)
                speed[k] += pull * h + gap * swept
                force[k] = pull + gap * kept
        t_ns = until
        index = min(index + 1, len(sent_ns) - 1)
