"""Positive controls: a monitor is switched off, and the faults that it is there for must then do harm.

Where another monitor stands behind it, that one is switched off too: a control that is contained all the same would
say nothing of either. With the monitor on again, and those behind it still off where it stands alone, else all on, the
same fault must do none.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import pi
from types import MappingProxyType

import numpy as np

from formation.messages import Verb
from sim.faults.fault import Family, Fault
from sim.monitors import Without
from sim.proof.flight import fly
from sim.proof.labs import Autopilot, Kind, scenario
from sim.scenario import Scenario
from sim.script import Step

FaultDraw = Callable[[np.random.Generator], tuple[Fault, ...]]
ENOUGH = 0.95
"""The share of a monitor's runs that must fail without it."""
LATE = ("stale-setpoint", "rule-setpoints-late", "rule-setpoints-late-landing", "rule-setpoints-stale")
"""Who acts on setpoints that reach a drone late."""
ESTIMATE = ("pose-slides",)
"""Monitors of poses that are inconsistent with a drone's own estimate."""
SWAPPED = ("validator-swap", "validator-jump", "validator-flip", *ESTIMATE, "rule-leader-position-error")
"""Who acts on two bodies that the cameras exchange."""
NEAR = ("separation-filter", "rule-not-offboard", "rule-too-close", "rule-half-separation")
"""Who acts where one drone stands in another's way because a pilot holds it."""
ARMING = ("arm-in-air", "arm-other-ground", "foreign-setpoint")
"""Who acts on a second ground that arms drones in the air."""
TILTED = ("motor-failure", "rule-tilted", "rule-tilted-agreed")
"""Who acts on a drone that cannot be kept upright."""


@dataclass(frozen=True, slots=True)
class Control:
    """One monitor's: its faults, whoever stands behind it, and the flight in which they are met.

    fails: the kinds of harm that its absence does; another is no proof. alone: whether it contains its faults with
    those behind it switched off.
    """

    faults: FaultDraw
    behind: tuple[str, ...] = ()
    kind: Kind = "circle"
    autopilot: Autopilot = "px4"
    followers: int = 2
    arms_after_s: float = 0.0
    fails: tuple[str, ...] = ()
    alone: bool = False

    def flight(self) -> Scenario:
        """Without its faults."""
        plain = scenario(self.kind, self.followers, self.autopilot)
        arm = Step(verb=Verb.ARM, phase="GROUND", after_s=self.arms_after_s)
        return plain.model_copy(update={"script": (arm, *plain.script[1:])})


@dataclass(frozen=True, slots=True)
class ControlJob:
    """One flight without a monitor, and the same with it."""

    monitor: str
    seed: int


@dataclass(frozen=True, slots=True)
class ControlResult:
    """Whether it failed without the monitor, as it must, and with it, as it must not."""

    without: bool
    with_it: bool


@dataclass(frozen=True, slots=True)
class Shares:
    """The share of one monitor's flights that failed without it, and with it."""

    without: float
    with_it: float

    @property
    def shows(self) -> bool:
        """Whether the monitor is what contains its faults."""
        return self.without >= ENOUGH and self.with_it == 0.0


def _others(names: tuple[str, ...], monitor: str) -> tuple[str, ...]:
    return tuple(name for name in names if name != monitor)


def _pose(
    family: Family, for_s: tuple[float, float], severity: tuple[float, float] = (1.0, 1.0), **more: object
) -> FaultDraw:
    def draw(rng: np.random.Generator) -> tuple[Fault, ...]:
        values = {
            "family": family, "body": "f2", "after_s": float(rng.uniform(2.3, 2.8)),
            "for_s": float(rng.uniform(*for_s)), "severity": float(rng.uniform(*severity)),
        } | more  # fmt: skip
        return (Fault.model_validate(values),)

    return draw


_swapped = _pose(Family.SWAP, (0.8, 1.2), body="leader", other="f2")


def _late(rng: np.random.Generator) -> tuple[Fault, ...]:
    return (Fault(family=Family.DELAY, severity=float(rng.uniform(0.35, 0.9)), direction="down", after_s=2.0),)


def _replayed(rng: np.random.Generator) -> tuple[Fault, ...]:
    return (Fault(family=Family.REPLAY, severity=float(rng.uniform(0.8, 2.0)), direction="down", after_s=3.0),)


def _rogue_setpoint(rng: np.random.Generator) -> tuple[Fault, ...]:
    after_s, tilt_rad = float(rng.uniform(0.5, 3.5)), float(rng.uniform(2.0, pi))
    one = {"body": "f2", "direction": "down", "after_s": after_s, "for_s": 0.02, "severity": tilt_rad}
    return (Fault.model_validate({"family": Family.ROGUE_SETPOINT} | one),)


def _ground_killed(rng: np.random.Generator) -> tuple[Fault, ...]:
    return (Fault(family=Family.KILL, core="ground", after_s=float(rng.uniform(0.5, 4.0))),)


def _second_ground(rng: np.random.Generator) -> tuple[Fault, ...]:
    return (Fault(family=Family.TWIN, core="ground", verb=Verb.ARM, after_s=float(rng.uniform(0.3, 1.5))),)


def _armed_after_stop(rng: np.random.Generator) -> tuple[Fault, ...]:
    """A second ground requests arming just after the drones were stopped on the floor; they must not arm."""
    twin_s, stop_s = float(rng.uniform(0.55, 0.65)), float(rng.uniform(1.95, 2.05))
    return (
        Fault(family=Family.TWIN, core="ground", verb=Verb.ARM, phase="ARMED", after_s=twin_s),
        Fault(family=Family.REQUEST, verb=Verb.STOP, phase="ARMED", after_s=stop_s),
    )


def _stop_at_loss(rng: np.random.Generator) -> tuple[Fault, ...]:
    return (
        Fault(family=Family.DROP, severity=0.75, direction="down", after_s=1.5),
        Fault(family=Family.REQUEST, verb=Verb.STOP, after_s=float(rng.uniform(1.6, 2.9))),
    )


def _log_ill(rng: np.random.Generator) -> tuple[Fault, ...]:
    return (Fault(family=Family.LOG_TROUBLE, phase="GROUND", after_s=float(rng.uniform(0.03, 0.5))),)


def _pilot_interferes(rng: np.random.Generator) -> tuple[Fault, ...]:
    return (Fault(family=Family.PILOT, body="f2", after_s=float(rng.uniform(1.05, 1.15)), for_s=6.0),)


def _dead_motor(rng: np.random.Generator) -> tuple[Fault, ...]:
    motor, after_s = int(rng.integers(4)), float(rng.uniform(1.0, 4.0))
    return (Fault(family=Family.DEAD_MOTOR, body="f2", motor=motor, severity=0.0, after_s=after_s),)


def _armed_in_air(monitor: str) -> Control:
    return Control(_second_ground, _others(ARMING, monitor), "hold", fails=("undue-cut", "impact"), alone=True)


CONTROLS: Mapping[str, Control] = MappingProxyType(
    {
        "validator-freeze": Control(
            _pose(Family.FREEZE, (2.0, 4.0), phase="TAKEOFF", after_s=0.5),
            ("validator-flip", "validator-jump", *ESTIMATE),
        ),
        "validator-jump": Control(_pose(Family.JUMP, (0.6, 1.0), (0.9, 1.2), heading_rad=-pi / 2), ESTIMATE),
        "validator-swap": Control(
            _swapped, (*_others(SWAPPED, "validator-swap"), "rule-attitude-innovation")
        ),
        "stale-setpoint": Control(_late, _others(LATE, "stale-setpoint")),
        "old-setpoint": Control(_replayed, LATE),
        "foreign-setpoint": _armed_in_air("foreign-setpoint"),
        "setpoint-bounds": Control(_rogue_setpoint, fails=("command-bounds",), alone=True),
        "own-land": Control(_ground_killed, ("stream-stale",), autopilot="ardupilot"),
        "pose-slides": Control(
            _pose(Family.DRIFT, (2.5, 3.0), (0.3, 0.5), heading_rad=-pi / 2),
            kind="hold", fails=("separation",), alone=True,
        ),
        "motor-failure": Control(_dead_motor, _others(TILTED, "motor-failure")),
        "stop-latch": Control(
            _armed_after_stop, ("arm-in-air", "arm-other-ground"), "hold", fails=("stop",), alone=True
        ),
        "stop-repeat": Control(_stop_at_loss, kind="hold", followers=5, fails=("stop",), alone=True),
        "separation-filter": Control(
            _pilot_interferes, _others(NEAR, "separation-filter"), "turning", fails=("separation",), alone=True
        ),
        "rule-not-offboard": Control(
            _pilot_interferes, _others(NEAR, "rule-not-offboard"), "turning", fails=("separation",), alone=True
        ),
        "rule-attitude-innovation": Control(_swapped, SWAPPED, fails=("fence",), alone=True),
        "arm-in-air": _armed_in_air("arm-in-air"),
        "arm-other-ground": _armed_in_air("arm-other-ground"),
        "log-trouble": Control(_log_ill, arms_after_s=1.0, fails=("unrecorded",), alone=True),
    }
)  # fmt: skip
"""By monitor. What is in neither these nor `REDUNDANT` is a mistake."""


def fly_control(job: ControlJob) -> ControlResult:
    """Fly one, without the monitor and with it."""
    control = CONTROLS[job.monitor]
    rng = np.random.default_rng([job.seed, 13, *job.monitor.encode()])
    flight = control.flight().model_copy(update={"faults": control.faults(rng)})
    off = fly(flight, job.seed, without=Without(frozenset({job.monitor, *control.behind}))).verdict
    failed = bool(set(off.kinds) & set(control.fails)) if control.fails else not off.contained
    without = Without(frozenset(control.behind if control.alone else ()))
    return ControlResult(failed, not fly(flight, job.seed, without=without).verdict.contained)


def jobs(seed: int, flights: int) -> list[ControlJob]:
    """So many flights of each monitor."""
    return [ControlJob(name, seed + k) for name in CONTROLS for k in range(flights)]


def shares(flown: Sequence[ControlJob], tried: Sequence[ControlResult]) -> dict[str, Shares]:
    """The shares of each monitor's flights that failed."""
    tried_of: dict[str, list[ControlResult]] = {}
    for job, one in zip(flown, tried, strict=True):
        tried_of.setdefault(job.monitor, []).append(one)
    return {
        name: Shares(sum(one.without for one in each) / len(each), sum(one.with_it for one in each) / len(each))
        for name, each in tried_of.items()
    }


_WARNS = "only warns"
REDUNDANT: Mapping[str, str] = MappingProxyType(
    {
        "validator-flip": "two independent estimates must agree before motors are cut; autopilots fly by their own",
        "validator-yaw-rate": "slots are followed at limits.speed_m_s at most; autopilots know their own heading",
        "validator-stamp": "no frame leaves the mocap process stamped after its receipt; rules on age for late stamps",
        "setpoint-hold-off": "by luck of what the noise was: rule-lost lets go of it after 0.4 s",
        "stream-stale": "the autopilot's own time-out 0.1 s later (COM_OF_LOSS_T, GUID_TIMEOUT 0.2 s)",
        "keep-out": "the separation filter keeps clear of the last place; unseen, a drone levels and comes down there",
        "speed-limit": "references are slow; pose validator, separation filter and fence limit fast ones",
        "rule-unseen": "rule-lost 0.2 s later",
        "rule-lost": "the drone's own level flight and descent without a pose, and the keep-out about it",
        "rule-long-lost": "rule-lost of a drone; of an observed leader, rule-unseen holds until the battery's rule",
        "rule-outside-fence": "the fence that brakes demands, rule-far-outside",
        "rule-far-outside": "rule-outside-fence, rule-far-outside-agreed",
        "rule-far-outside-agreed": "rule-far-outside lets go of it half a metre outside all the same",
        "rule-too-close": "separation filter, rule-half-separation",
        "rule-half-separation": "separation filter, rule-too-close",
        "rule-position-error": "fence and its rules, rule-attitude-innovation",
        "rule-leader-position-error": "rule-not-offboard; followers come down no faster than their leader",
        "rule-tilted": "motor-failure in the drone, rule-tilted-agreed",
        "rule-tilted-agreed": "motor-failure in the drone, rule-tilted",
        "rule-silent": "a drone that hears nothing holds and lands by itself; one that says nothing is led as before",
        "rule-link-behind": _WARNS,
        "rule-link-behind-hold": "poses so old are unseen where autopilots are their own mocap; else the release",
        "rule-link-behind-release": "rule-lost where autopilots are their own mocap; else a late estimate cuts nothing",
        "rule-disarmed": "a drone that is disarmed has come down already, and the others keep clear of it",
        "rule-setpoints-late": _WARNS,
        "rule-setpoints-late-landing": "stale-setpoint in the drone, the bound on its rate of descent",
        "rule-setpoints-stale": "stale-setpoint in the drone",
        "rule-battery-low": _WARNS,
        "rule-battery-empty": "the autopilot's own landing, then rule-not-offboard",
        "rule-model-mismatch": _WARNS,
        "rule-frames-late": _WARNS,
        "rule-frames-lost": "rule-unseen and rule-lost, stream-stale in the drone",
        "rule-duplicate-sysid": _WARNS,
    }
)
"""By monitor, who stands behind it."""
