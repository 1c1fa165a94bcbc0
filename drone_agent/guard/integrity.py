"""The declared faults of a body's poses and thrust, as one table; a fault is added as a row.

Each row is a generalised likelihood-ratio test (formation.navigation.evidence): what the fault adds to an observation
is declared, its amplitude and onset are estimated, and twice the log-likelihood ratio is chi-square where there is no
fault. Every threshold follows from one false-alarm rate by the union bound over all tests that are made:

    P(chi-square with `axes` degrees of freedom > threshold) = FALSE_ALARMS_1_H / (3600 pose_rate_hz ONSETS)

Neighbouring tests are alike, so that alarms are rarer than that.

A frozen pose needs no row: one that is the same to the last bit is no observation (RejectReason.FROZEN), one that only
trembles drifts by minus the body's velocity.
"""

from dataclasses import dataclass
from enum import IntEnum
from math import erfc, exp, inf, pi, sqrt

from drone_agent.guard.stages import Stage, Trigger, advance
from formation.maths.records import Rows, rows
from formation.navigation.evidence import LATE, LATER, LOSS, NOTHING, ONSETS, RAMP, STEP, Shape

FALSE_ALARMS_1_H = 0.01
"""False alarms of each row and drone: one in 100 hours of flight."""


class Effect(IntEnum):
    """The contribution of a fault to a source's observation, per unit of its amplitude."""

    NOTHING = NOTHING
    STEP = STEP
    RAMP = RAMP
    LATE = LATE
    LATER = LATER
    LOSS = LOSS


@dataclass(frozen=True, slots=True)
class Signature:
    """One declared fault.

    unit: of the amplitude. least: amplitude below which the fault does no harm, and is left to the estimate; most: that
    it can have.
    rolls_back: whether the estimate goes back to the onset and on by dead reckoning. trigger: of the stage table.
    """

    name: str
    unit: str
    least: float
    position: Effect = Effect.NOTHING
    attitude: Effect = Effect.NOTHING
    thrust: Effect = Effect.NOTHING
    most: float = inf
    rolls_back: bool = True
    trigger: Trigger = Trigger.POSE_FAULT

    @property
    def axes(self) -> int:
        """3 where the amplitude is a vector."""
        return 3 if {Effect.STEP, Effect.RAMP} & {self.position, self.attitude} else 1


SIGNATURES = (
    Signature("pose jump", "m", 0.01, position=Effect.STEP),
    Signature("pose drift", "m/s", 0.04, position=Effect.RAMP),
    Signature("pose delay", "s", 0.02, position=Effect.LATE, attitude=Effect.LATE, most=0.5),
    Signature("pose delay growing", "1", 0.05, position=Effect.LATER, attitude=Effect.LATER, most=1.0),
    Signature("pose attitude inconsistent", "rad", 0.04, attitude=Effect.STEP),
    Signature("vertical thrust loss", "1", 0.25, thrust=Effect.LOSS, rolls_back=False, trigger=Trigger.THRUST_LOSS),
)
"""Least amplitudes. Jump: the radius of a marker. Drift: half of what must be found, 4 cm in a second of hold. Delay:
what the clocks' exchange leaves in doubt; older poses are refused. Growing: 80 ms within 1.6 s, and no faster than time
goes; a simulator's clock drifts by 1 %. Attitude: 2.3 degrees, 0.4 m/s^2. Thrust: of the commanded, more than an empty
battery (0.15) or a vertical gust takes; what a horizontal wind does along the rotors' axis is taken out before
(formation.navigation.observe)."""


def chi_square_tail(x: float, axes: int) -> float:
    """P(chi-square > x) for 1 or 3 degrees of freedom, in closed form."""
    tail = erfc(sqrt(0.5 * x))
    return tail if axes == 1 else tail + sqrt(2.0 * x / pi) * exp(-0.5 * x)


def threshold(axes: int, pose_rate_hz: float, false_alarms_1_h: float = FALSE_ALARMS_1_H) -> float:
    """The statistic that is exceeded so rarely, by bisection of the formula above."""
    probability = false_alarms_1_h / (3600.0 * pose_rate_hz * ONSETS)
    low, high = 0.0, 200.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if chi_square_tail(middle, axes) > probability else (low, middle)
    return high


def shapes(signatures: tuple[Signature, ...], pose_rate_hz: float) -> Rows[Shape]:
    """The table as the kernels have it."""
    out, first = [], 0
    for s in signatures:
        bound = threshold(s.axes, pose_rate_hz)
        out.append(Shape(s.position, s.attitude, s.thrust, s.axes, first, bound, s.least, s.most, s.rolls_back))
        first += s.axes
    return rows(Shape, out)


def signatures_markdown() -> str:
    """The table as the documentation shows it."""
    rows = (
        f"| {s.name} | {_shown_by(s)} | {s.least:g} {'' if s.unit == '1' else s.unit} "
        f"| {threshold(s.axes, 100.0):.1f} | {s.trigger.value} | {_stage_after(s.trigger)} |"
        for s in SIGNATURES
    )
    header = "| fault | shown by | from | statistic above | event of the stage table | stage after `FOLLOW` |"
    return "\n".join((header, "|---|---|---|---|---|---|", *rows))


def _shown_by(s: Signature) -> str:
    sources = (("position", s.position), ("attitude", s.attitude), ("measured thrust", s.thrust))
    return ", ".join(f"{source}: {_EFFECTS[effect]}" for source, effect in sources if effect is not Effect.NOTHING)


def _stage_after(trigger: Trigger) -> str:
    stage = advance(Stage.FOLLOW, trigger)
    return "-" if stage is None else f"`{stage.value}`"


_EFFECTS = {
    Effect.STEP: "a step",
    Effect.RAMP: "a ramp",
    Effect.LATE: "a delay",
    Effect.LATER: "a growing delay",
    Effect.LOSS: "a step of its scale",
}
