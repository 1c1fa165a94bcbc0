"""Positive controls: a monitor is switched off, and the faults that it is there for must then do harm.

Where another monitor stands behind it, that one is switched off too: a control that is contained all the same would
say nothing of either.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import pi
from types import MappingProxyType

import numpy as np

from formation.messages import Verb
from sim.campaign.flight import fly
from sim.campaign.labs import Autopilot, Kind, scenario
from sim.faults.fault import Family, Fault
from sim.monitors import Without

Draw = Callable[[np.random.Generator], tuple[Fault, ...]]
ENOUGH = 0.95
"""The share of a monitor's runs that must fail without it."""
LATE = ("stale-setpoint", "rule-setpoints-late", "rule-setpoints-stale")
"""Who acts on setpoints that reach a drone late."""
LOST = ("pose-rejected", "rule-unseen", "rule-lost")
"""Who acts on poses that are old."""
ASTRAY = ("rule-outside-fence", "rule-far-outside", "rule-astray", "rule-attitude-miss")
"""Who acts on a drone that is not where it is led."""


@dataclass(frozen=True, slots=True)
class Control:
    """One monitor's: its faults, whoever stands behind it, and the flight in which they are met."""

    faults: Draw
    behind: tuple[str, ...] = ()
    kind: Kind = "circle"
    autopilot: Autopilot = "px4"


@dataclass(frozen=True, slots=True)
class ControlJob:
    """One flight without a monitor."""

    monitor: str
    seed: int


def _pose(
    family: Family, for_s: tuple[float, float], severity: tuple[float, float] = (1.0, 1.0), **more: object
) -> Draw:
    def draw(rng: np.random.Generator) -> tuple[Fault, ...]:
        values = {
            "family": family, "body": "f2", "after_s": float(rng.uniform(2.3, 2.8)),
            "for_s": float(rng.uniform(*for_s)), "severity": float(rng.uniform(*severity)),
        } | more  # fmt: skip
        return (Fault.model_validate(values),)

    return draw


def _late(rng: np.random.Generator) -> tuple[Fault, ...]:
    return (Fault(family=Family.DELAY, severity=float(rng.uniform(0.35, 0.9)), direction="down", after_s=2.0),)


def _replayed(rng: np.random.Generator) -> tuple[Fault, ...]:
    return (Fault(family=Family.REPLAY, severity=float(rng.uniform(0.8, 2.0)), direction="down", after_s=3.0),)


def _ground_killed(rng: np.random.Generator) -> tuple[Fault, ...]:
    return (Fault(family=Family.KILL, core="ground", after_s=float(rng.uniform(0.5, 4.0))),)


def _second_ground(rng: np.random.Generator) -> tuple[Fault, ...]:
    return (Fault(family=Family.TWIN, core="ground", verb=Verb.ARM, after_s=float(rng.uniform(0.3, 1.5))),)


def _dead_motor(rng: np.random.Generator) -> tuple[Fault, ...]:
    motor, after_s = int(rng.integers(4)), float(rng.uniform(1.0, 4.0))
    return (Fault(family=Family.DEAD_MOTOR, body="f2", motor=motor, severity=0.0, after_s=after_s),)


CONTROLS: Mapping[str, Control] = MappingProxyType(
    {
        "gate-freeze": Control(
            _pose(Family.FREEZE, (2.0, 4.0), phase="TAKEOFF", after_s=0.5), ("gate-flip", "gate-jump", "pose-rejected")
        ),
        "gate-jump": Control(_pose(Family.JUMP, (0.6, 1.0), (0.9, 1.2), heading_rad=-pi / 2), ("pose-rejected",)),
        "gate-yaw-rate": Control(_pose(Family.YAW, (0.2, 0.4), (2.7, 3.1), body="leader"), ("pose-rejected",)),
        "gate-swap": Control(
            _pose(Family.SWAP, (0.8, 1.2), body="leader", other="f2"), ("gate-jump", "gate-flip", "pose-rejected")
        ),
        "gate-stamp": Control(_pose(Family.STAMP_OFFSET, (8.0, 9.0), (-0.38, -0.3)), (*LATE, *LOST, *ASTRAY)),
        "stale-setpoint": Control(_late, LATE),
        "old-setpoint": Control(_replayed, LATE),
        "stream-stale": Control(_ground_killed),
        "own-land": Control(_ground_killed, ("stream-stale",), autopilot="ardupilot"),
        "arm-in-air": Control(_second_ground, ("arm-other-ground", "foreign-setpoint"), kind="hold"),
        "motor-failure": Control(_dead_motor, ("rule-tilted", "rule-tilted-agreed")),
    }
)
"""By monitor."""


def fly_control(job: ControlJob) -> bool:
    """Fly one; whether it failed, as it must."""
    control = CONTROLS[job.monitor]
    names = tuple(CONTROLS)
    rng = np.random.default_rng([job.seed, 13, names.index(job.monitor)])
    flight = scenario(control.kind, 2, control.autopilot).model_copy(update={"faults": control.faults(rng)})
    without = Without(frozenset({job.monitor, *control.behind}))
    return not fly(flight, job.seed, without=without).verdict.contained


def jobs(seed: int, flights: int, only: Sequence[str] = ()) -> list[ControlJob]:
    """So many flights of each monitor, or of some alone."""
    wanted = [name for name in CONTROLS if not only or name in only]
    return [ControlJob(name, seed + k) for name in wanted for k in range(flights)]


def shares(flown: Sequence[ControlJob], failed: Sequence[bool]) -> dict[str, float]:
    """Of each monitor, the share of flights that failed without it."""
    told: dict[str, list[bool]] = {}
    for job, one in zip(flown, failed, strict=True):
        told.setdefault(job.monitor, []).append(one)
    return {name: sum(each) / len(each) for name, each in told.items()}
