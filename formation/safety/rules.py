"""Safety: who acts, when, on every fault in flight. Pure decisions on plain facts.

`RULES` is the whole policy in flight: it is evaluated as one table and printed as one (formation.safety.rules_table).
The ground acts by a trigger for the swarm (formation.safety.phases) and, where one drone is the trouble, by letting
go of that drone or cutting its motors. Below all of this each drone's agent levels, holds and lands by itself when
setpoints go stale.
"""

from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from formation.config import LimitsConfig
from formation.estimation.model_mismatch import MISMATCH_TOLD
from formation.maths.arrays import Flags, Float, Scalars, Vec3s
from formation.maths.kernel import kernel
from formation.messages import Phase, Severity
from formation.model import Vec3Tuple
from formation.safety.attitude_miss import MOST_RAD
from formation.safety.phases import AIRBORNE, Trigger
from formation.safety.places import nearest, outside_box


class Facts(NamedTuple):
    """What is decided on: one entry per vehicle of the configuration, leader first (n).

    For a body that is only observed the link's fields hold their healthy values. `battery` is 0..1, NaN where unknown.
    late_share: the part of the last second's frames that came late or were missed, 0..1.
    own_pos_lab_m, own_tilt_rad: what the drone's own estimator says, by another way than the mocap's poses come and
    fresh by its own clock: an independent estimate; NaN where there is none.
    attitude_miss_rad: how far the mocap's attitude is from the drone's own (formation.safety.attitude_miss).
    silent_s: since anything at all was heard of it; link_behind_s: how old its newest telemetry was when it was read,
    by its own clock, NaN: unknown; setpoint_age_s: of what reaches it, camera to drone, NaN: unknown.
    """

    names: tuple[str, ...]
    commanded: Flags
    pos_lab_m: Vec3s
    speed_m_s: Scalars
    tilt_rad: Scalars
    age_s: Scalars
    error_m: Scalars
    model_mismatch: Scalars
    own_pos_lab_m: Vec3s
    own_tilt_rad: Scalars
    attitude_miss_rad: Scalars
    heartbeat_age_s: Scalars
    silent_s: Scalars
    link_behind_s: Scalars
    setpoint_age_s: Scalars
    armed: Flags
    offboard: Flags
    battery: Scalars
    duplicate: Flags
    late_share: float
    objections: tuple[str, ...] = ()


class Own(StrEnum):
    """What happens to the one drone that a fault is about."""

    NOTHING = "-"
    RELEASE = "no more setpoints; told to land by itself"
    CUT = "motors cut"


class Measure(IntEnum):
    """What a rule looks at: a number for each vehicle, larger where things are worse; a flag counts as 0 or 1."""

    UNSEEN_S = 0
    OUTSIDE_M = 1
    NEARNESS = 2  # minus the distance to the nearest neighbour, in minimum separations
    ASTRAY_M = 3
    TILT_RAD = 4
    SILENT_S = 5
    NOT_OFFBOARD = 6
    DISARMED = 7
    DISCHARGE = 8  # minus what is left of the battery
    LATE_SHARE = 9
    DUPLICATE = 10
    MODEL_MISMATCH = 11  # see formation.estimation.model_mismatch
    OUTSIDE_TOO_M = 12  # as mocap and the drone's own estimator agree: the smaller of both
    TILT_TOO_RAD = 13
    SETPOINT_AGE_S = 14
    ATTITUDE_MISS_RAD = 15
    LEADER_ASTRAY_M = 16  # of the leader alone
    LINK_BEHIND_S = 17


UNSEEN_S, OUTSIDE_M, NEARNESS = int(Measure.UNSEEN_S), int(Measure.OUTSIDE_M), int(Measure.NEARNESS)
TILT_RAD, OUTSIDE_TOO_M = int(Measure.TILT_RAD), int(Measure.OUTSIDE_TOO_M)
TILT_TOO_RAD = int(Measure.TILT_TOO_RAD)


@dataclass(frozen=True, slots=True)
class Rule:
    """One fault: the measure that is then over its limit, for how long, in which phases, and who then does what.

    name: by which a campaign switches it off. of_all: judged of bodies too that are only observed. of_swarm: the fault
    is nobody's own; it is raised once, at index 0, whoever that is.
    """

    name: str
    fault: str
    measure: Measure
    over: float
    persist_s: float
    phases: frozenset[Phase]
    swarm: Trigger | None = None
    own: Own = Own.NOTHING
    of_all: bool = False
    of_swarm: bool = False

    def text(self, name: str) -> str:
        """The fault of the vehicle `name`, in words."""
        return self.fault if self.of_swarm else f"{name}: {self.fault}"

    @property
    def severity(self) -> Severity:
        """How loudly it is told."""
        if self.swarm is None and self.own is Own.NOTHING:
            return Severity.WARNING
        return Severity.ERROR if self.own is Own.NOTHING else Severity.CRITICAL


HEARTBEAT_S = 3.0
SILENT_S = 3.0
WITNESS_FRESH_S = 0.1
LATE_SETPOINT_S, STALE_SETPOINT_S = 0.07, 0.1
LOST_S = 0.4
BEHIND_WARN_S, BEHIND_HOLD_S, BEHIND_RELEASE_S = 0.05, 0.1, 0.3
FAR_OUTSIDE_M = 0.5
BATTERY_LOW, BATTERY_EMPTY = 0.2, 0.1
UPSET_RAD = 1.3
ASTRAY_M, LEADER_ASTRAY_M = 1.0, 0.3


FLYING = AIRBORNE - {Phase.LAND}
IN_PLACE = frozenset({Phase.FORMATION, Phase.HOLD})
IN_FORMATION = frozenset({Phase.FORMATION})
MOTORS_ON = AIRBORNE | {Phase.ARMED}

RULES: tuple[Rule, ...] = (
    Rule("rule-unseen", "body not seen for 0.2 s",
         Measure.UNSEEN_S, 0.2, 0.0, IN_FORMATION, Trigger.HOLD, of_all=True),
    Rule("rule-lost", "body not seen for 0.4 s",
         Measure.UNSEEN_S, LOST_S, 0.0, AIRBORNE, Trigger.LAND, Own.RELEASE),
    Rule("rule-long-lost", "body not seen for 5 s",
         Measure.UNSEEN_S, 5.0, 0.0, FLYING, Trigger.LAND, of_all=True),
    Rule("rule-outside-fence", "outside the fence",
         Measure.OUTSIDE_M, 0.0, 0.1, AIRBORNE, Trigger.LAND),
    Rule("rule-far-outside", "0.5 m outside the fence",
         Measure.OUTSIDE_M, FAR_OUTSIDE_M, 0.2, AIRBORNE, Trigger.LAND, Own.RELEASE),
    Rule("rule-far-outside-agreed", "0.5 m outside the fence, says its own estimate too",
         Measure.OUTSIDE_TOO_M, FAR_OUTSIDE_M, 0.2, AIRBORNE, Trigger.LAND, Own.CUT),
    Rule("rule-too-close", "closer than the minimum separation",
         Measure.NEARNESS, -1.0, 0.1, IN_FORMATION, Trigger.HOLD),
    Rule("rule-half-separation", "closer than half the minimum separation",
         Measure.NEARNESS, -0.5, 0.1, FLYING, Trigger.LAND),
    Rule("rule-astray", "1 m away from its reference",
         Measure.ASTRAY_M, ASTRAY_M, 1.0, IN_PLACE, Trigger.LAND),
    Rule("rule-leader-astray", "0.3 m away from its reference, and it leads",
         Measure.LEADER_ASTRAY_M, LEADER_ASTRAY_M, 0.1, IN_FORMATION, Trigger.HOLD),
    Rule("rule-tilted", "tilted by 75 degrees",
         Measure.TILT_RAD, UPSET_RAD, 0.3, MOTORS_ON, Trigger.LAND, Own.RELEASE),
    Rule("rule-tilted-agreed", "tilted by 75 degrees, says its own attitude too",
         Measure.TILT_TOO_RAD, UPSET_RAD, 0.3, MOTORS_ON, Trigger.LAND, Own.CUT),
    Rule("rule-silent", "nothing heard for 3 s",
         Measure.SILENT_S, SILENT_S, 0.0, MOTORS_ON, Trigger.LAND),
    Rule("rule-link-behind", "its telemetry arrives 50 ms late",
         Measure.LINK_BEHIND_S, BEHIND_WARN_S, 1.0, MOTORS_ON),
    Rule("rule-link-behind-hold", "its telemetry arrives 100 ms late",
         Measure.LINK_BEHIND_S, BEHIND_HOLD_S, 0.3, IN_FORMATION, Trigger.HOLD),
    Rule("rule-link-behind-release", "its telemetry arrives 300 ms late",
         Measure.LINK_BEHIND_S, BEHIND_RELEASE_S, 0.3, MOTORS_ON, Trigger.LAND, Own.RELEASE),
    Rule("rule-not-offboard", "not in off-board mode",
         Measure.NOT_OFFBOARD, 0.0, 0.5, FLYING, Trigger.LAND),
    Rule("rule-disarmed", "disarmed in the air",
         Measure.DISARMED, 0.0, 0.3, FLYING, Trigger.LAND),
    Rule("rule-setpoints-late", "setpoints reach it 70 ms old",
         Measure.SETPOINT_AGE_S, LATE_SETPOINT_S, 1.0, MOTORS_ON),
    Rule("rule-setpoints-late-landing", "setpoints reach it 70 ms old as it lands",
         Measure.SETPOINT_AGE_S, LATE_SETPOINT_S, 1.0, frozenset({Phase.LAND}), own=Own.RELEASE),
    Rule("rule-setpoints-stale", "setpoints reach it 100 ms old",
         Measure.SETPOINT_AGE_S, STALE_SETPOINT_S, 1.0, MOTORS_ON, Trigger.LAND, Own.RELEASE),
    Rule("rule-battery-low", "battery under 20 %",
         Measure.DISCHARGE, -BATTERY_LOW, 1.0, MOTORS_ON),
    Rule("rule-battery-empty", "battery under 10 %",
         Measure.DISCHARGE, -BATTERY_EMPTY, 1.0, MOTORS_ON, Trigger.LAND),
    Rule("rule-model-mismatch", "model mismatch",
         Measure.MODEL_MISMATCH, MISMATCH_TOLD, 0.3, AIRBORNE),
    Rule("rule-attitude-miss", "its attitude is not the mocap's: late poses?",
         Measure.ATTITUDE_MISS_RAD, MOST_RAD, 0.1, AIRBORNE, Trigger.LAND, Own.RELEASE),
    Rule("rule-frames-late", "a fifth of the frames late",
         Measure.LATE_SHARE, 0.2, 0.5, MOTORS_ON, of_swarm=True),
    Rule("rule-frames-lost", "seven tenths of the frames late",
         Measure.LATE_SHARE, 0.7, 2.0, MOTORS_ON, Trigger.LAND, of_swarm=True),
    Rule("rule-duplicate-sysid", "its sysid is used twice on the network",
         Measure.DUPLICATE, 0.0, 0.0, frozenset(Phase)),
)  # fmt: skip
RULE_NAMES = tuple(rule.name for rule in RULES)

_SEVEREST_FIRST = (Trigger.LAND, Trigger.HOLD)


class RuleState(NamedTuple):
    """Since when each vehicle has broken each rule (ns, -1: it does not), and which were acted on; both (rules, n)."""

    since_ns: NDArray[np.int64]
    acted: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class FaultChange:
    """One fault of one vehicle that has just begun or just ended."""

    vehicle: int
    rule: Rule
    began: bool
    text: str


class Verdict(NamedTuple):
    """What is to be done now: a trigger for the swarm, drones to let go of or to cut (n,), and what is new to tell."""

    trigger: Trigger | None
    cause: str
    release: Flags
    cut: Flags
    changes: tuple[FaultChange, ...]


def start(n: int) -> RuleState:
    """Nothing is wrong yet with any of the n vehicles."""
    return RuleState(np.full((len(RULES), n), -1, np.int64), np.zeros((len(RULES), n), np.bool_))


def switched_on(without: frozenset[str]) -> Flags:
    """Which rules are applied, (rules,), where a campaign names some that are not."""
    return np.array([rule.name not in without for rule in RULES])


ALL_ON = switched_on(frozenset())


def assess(
    state: RuleState, facts: Facts, phase: Phase, limits: LimitsConfig, now_ns: int, on: Flags = ALL_ON
) -> tuple[RuleState, Verdict]:
    """Apply every rule that is `on` to every vehicle; a fault acts once it has lasted its rule's `persist_s`."""
    n = len(facts.names)
    broken, judged = np.zeros((len(RULES), n), np.bool_), _JUDGED[phase] & on
    measured = _measured(facts, limits)
    if not _find_broken(measured, facts.commanded, _MEASURES, _OVER, _OF_ALL, judged, state.acted, broken):
        nobody = np.zeros(n, np.bool_)
        return start(n), Verdict(None, "", nobody, nobody, ())
    since = np.where(broken, np.where(state.since_ns < 0, now_ns, state.since_ns), -1)
    acting = broken & (now_ns - since >= _PERSIST_NS[:, None])
    trigger, cause = _swarm_trigger(acting, facts)
    verdict = Verdict(
        trigger=trigger,
        cause=cause,
        release=_owned(acting, Own.RELEASE),
        cut=_owned(acting, Own.CUT),
        changes=_changes(acting, state.acted, facts),
    )
    return RuleState(since, acting), verdict


_PERSIST_NS = np.array([round(rule.persist_s * 1e9) for rule in RULES], np.int64)
_MEASURES = np.array([rule.measure for rule in RULES])
_OVER = np.array([rule.over for rule in RULES])
_OF_ALL = np.array([rule.of_all or rule.of_swarm for rule in RULES])
_JUDGED = {phase: np.array([phase in rule.phases for rule in RULES]) for phase in Phase}


def _measured(facts: Facts, limits: LimitsConfig) -> Float:
    """Every measure of every vehicle, (measures, n)."""
    out = np.zeros((len(Measure), len(facts.names)))
    out[Measure.UNSEEN_S] = facts.age_s
    out[Measure.ASTRAY_M] = facts.error_m
    out[Measure.LEADER_ASTRAY_M, 0] = facts.error_m[0]
    out[Measure.TILT_RAD] = facts.tilt_rad
    out[Measure.SILENT_S] = facts.silent_s
    out[Measure.NOT_OFFBOARD] = facts.armed & ~facts.offboard
    out[Measure.DISARMED] = ~facts.armed
    out[Measure.DISCHARGE] = -facts.battery
    out[Measure.LATE_SHARE, 0] = facts.late_share
    out[Measure.DUPLICATE] = facts.duplicate
    out[Measure.MODEL_MISMATCH] = facts.model_mismatch
    out[Measure.LINK_BEHIND_S] = facts.link_behind_s
    out[Measure.SETPOINT_AGE_S] = facts.setpoint_age_s
    out[Measure.ATTITUDE_MISS_RAD] = facts.attitude_miss_rad
    fence, apart_m = limits.fence, limits.min_separation_m
    _measure_places(facts.pos_lab_m, facts.own_pos_lab_m, facts.own_tilt_rad, fence.low_m, fence.high_m, apart_m, out)
    return out


@kernel
def _measure_places(
    pos_lab_m: Vec3s, own_pos_lab_m: Vec3s, own_tilt_rad: Scalars, low_m: Vec3Tuple, high_m: Vec3Tuple,
    separation_m: float, out: Float,
) -> None:  # fmt: skip
    """The measures of place, and those of both witnesses, into out (measures, n), which holds age and tilt already.

    Where a lost body is, nobody knows: no place is judged for it.
    """
    age_s = out[UNSEEN_S]
    known = age_s <= LOST_S
    outside, own_outside = outside_box(pos_lab_m, low_m, high_m), outside_box(own_pos_lab_m, low_m, high_m)
    near = nearest(pos_lab_m, known)
    for i in range(len(age_s)):
        told = np.isfinite(own_pos_lab_m[i, 0] + own_pos_lab_m[i, 1] + own_pos_lab_m[i, 2])
        out[OUTSIDE_M, i] = outside[i] if known[i] else 0.0
        out[NEARNESS, i] = -near[i] / separation_m
        out[OUTSIDE_TOO_M, i] = _agreed(out[OUTSIDE_M, i], own_outside[i] if told else np.nan, age_s[i])
        out[TILT_TOO_RAD, i] = _agreed(out[TILT_RAD, i], own_tilt_rad[i], age_s[i])


@kernel
def _agreed(mocap: float, own: float, age_s: float) -> float:
    """What both witnesses say, the smaller of the two; zero where either is silent or the mocap has not seen it now."""
    if not np.isfinite(own) or not age_s <= WITNESS_FRESH_S:
        return 0.0
    return own if own < mocap or np.isnan(mocap) else mocap


@kernel
def _find_broken(
    measured: Float, commanded: Flags, measures: NDArray[np.int64], over: Float, of_all: Flags, judged: Flags,
    acted: NDArray[np.bool_], broken: NDArray[np.bool_],
) -> bool:  # fmt: skip
    """Whether any vehicle breaks a rule, or one was acted on; `broken` (rules, n) says which, and comes in false."""
    fault = False
    for rule in range(len(over)):
        for i in range(len(commanded)):
            if judged[rule]:
                broken[rule, i] = (commanded[i] or of_all[rule]) and measured[measures[rule], i] > over[rule]
            fault = fault or broken[rule, i] or acted[rule, i]
    return fault


def _swarm_trigger(acting: NDArray[np.bool_], facts: Facts) -> tuple[Trigger | None, str]:
    for trigger in _SEVEREST_FIRST:
        for row, rule in zip(acting, RULES, strict=True):
            if rule.swarm is trigger and row.any():
                return trigger, rule.text(facts.names[int(row.argmax())])
    return None, ""


def _owned(acting: NDArray[np.bool_], own: Own) -> Flags:
    rows = np.array([rule.own is own for rule in RULES])
    flags: Flags = (acting & rows[:, None]).any(axis=0)
    return flags


def _changes(acting: NDArray[np.bool_], acted: NDArray[np.bool_], facts: Facts) -> tuple[FaultChange, ...]:
    return tuple(
        FaultChange(int(i), RULES[r], bool(acting[r, i]), RULES[r].text(facts.names[i]))
        for r, i in np.argwhere(acting != acted)
    )
