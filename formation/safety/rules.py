"""Safety: what the policy (formation.safety.rules_table) says of the facts. Pure decisions, no state but `RuleState`.

Every tick each rule's measure is taken of every vehicle; a fault acts once it has lasted as long as its rule says.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from formation.config import LimitsConfig
from formation.maths.arrays import Flags, Float, Scalars, Vec3s
from formation.maths.kernel import kernel
from formation.maths.sweep import ascending, widest_axis
from formation.messages import Phase
from formation.model import Vec3Tuple
from formation.safety.phases import Trigger
from formation.safety.rules_table import LOST_S, RULES, Measure, Own, Rule

(
    UNSEEN_S, OUTSIDE_M, NEARNESS, POSITION_ERROR_M, TILT_RAD, SILENT_S, NOT_OFFBOARD, DISARMED, BATTERY_LOW,
    LATE_SHARE, DUPLICATE, MODEL_MISMATCH, OUTSIDE_TOO_M, TILT_TOO_RAD, SETPOINT_AGE_S, ATTITUDE_INNOVATION_RAD,
    LEADER_POSITION_ERROR_M, LINK_BEHIND_S, BATTERY_EMPTY,
) = map(int, Measure)  # fmt: skip
INDEPENDENT_FRESH_S = 0.1
_SEVEREST_FIRST = (Trigger.LAND, Trigger.HOLD)


class Facts(NamedTuple):
    """What is decided on: one entry per vehicle of the configuration, leader first (n).

    excluded: takes no part in the flight; no rule is about it, as a body to keep clear of it counts. landing: lands
    alone, and is judged as in LAND.
    For a body that is only observed the link's fields hold their healthy values. `battery` is 0..1, NaN where unknown.
    late_share: the part of the last second's frames that came late or were missed, 0..1.
    own_pos_lab_m, own_tilt_rad: what the drone's own estimator says, by another way than the mocap's poses come and
    fresh by its own clock: an independent estimate; NaN where there is none.
    attitude_innovation_rad: the mocap's attitude less the drone's own (formation.safety.attitude_innovation).
    silent_s: since anything at all was heard of it; link_behind_s: how old its newest telemetry was when it was read,
    by its own clock, NaN: unknown; setpoint_age_s: of what reaches it, camera to drone, NaN: unknown.
    """

    names: tuple[str, ...]
    commanded: Flags
    excluded: Flags
    landing: Flags
    pos_lab_m: Vec3s
    speed_m_s: Scalars
    tilt_rad: Scalars
    age_s: Scalars
    error_m: Scalars
    model_mismatch: Scalars
    own_pos_lab_m: Vec3s
    own_tilt_rad: Scalars
    attitude_innovation_rad: Scalars
    heartbeat_age_s: Scalars
    silent_s: Scalars
    link_behind_s: Scalars
    setpoint_age_s: Scalars
    armed: Flags
    offboard: Flags
    battery: Scalars
    duplicate: Flags
    late_share: float


class RuleState(NamedTuple):
    """Since when each vehicle has broken each rule (ns, -1: it does not), and which were acted on; both (rules, n).

    is_quiet: nothing is broken, and nothing was acted on.
    """

    since_ns: NDArray[np.int64]
    acted: NDArray[np.bool_]
    is_quiet: bool = False


@dataclass(frozen=True, slots=True)
class FaultChange:
    """One fault of one vehicle that has just begun or just ended."""

    vehicle: int
    rule: Rule
    began: bool
    body: str

    @property
    def text(self) -> str:
        """In words."""
        return self.rule.text(self.body)


class Verdict(NamedTuple):
    """The action now: the fault for which the swarm acts, drones to release or to cut (n,), and what began and ended.

    fault: `began` with this tick, or goes on.
    """

    fault: FaultChange | None
    release: Flags
    cut: Flags
    changes: tuple[FaultChange, ...]

    @property
    def trigger(self) -> Trigger | None:
        """What the swarm does."""
        return None if self.fault is None else self.fault.rule.swarm


def start(n: int) -> RuleState:
    """Nothing is wrong yet with any of the n vehicles."""
    return RuleState(np.full((len(RULES), n), -1, np.int64), np.zeros((len(RULES), n), np.bool_), is_quiet=True)


def switched_on(without: frozenset[str]) -> Flags:
    """Which rules are applied, (rules,), where a campaign names some that are not."""
    return np.array([rule.name not in without for rule in RULES])


ALL_ON = switched_on(frozenset())


def assess(
    state: RuleState, facts: Facts, phase: Phase, limits: LimitsConfig, now_ns: int, on: Flags = ALL_ON
) -> tuple[RuleState, Verdict]:
    """Apply every rule that is `on` to every vehicle; a fault acts once it has lasted its rule's `persist_s`."""
    n = len(facts.names)
    broken = np.zeros((len(RULES), n), np.bool_)
    active, active_landing, measured = _ACTIVE_RULES[phase], _ACTIVE_RULES[Phase.LAND], _measured(facts, limits)
    if not _find_broken(
        measured, facts.commanded, facts.excluded, facts.landing, active, active_landing, on, state.acted, broken
    ):
        nobody = np.zeros(n, np.bool_)
        return state if state.is_quiet else start(n), Verdict(None, nobody, nobody, ())
    since = np.where(broken, np.where(state.since_ns < 0, now_ns, state.since_ns), -1)
    acting = broken & (now_ns - since >= _PERSIST_NS[:, None])
    verdict = Verdict(
        fault=_swarm_fault(acting, state.acted, facts),
        release=_owned(acting, Own.RELEASE),
        cut=_owned(acting, Own.CUT),
        changes=_changes(acting, state.acted, facts),
    )
    return RuleState(since, acting), verdict


_PERSIST_NS = np.array([round(rule.persist_s * 1e9) for rule in RULES], np.int64)
_MEASURES = np.array([rule.measure for rule in RULES])
_OVER = np.array([rule.over for rule in RULES])
_OF_ALL = np.array([rule.of_all or rule.of_swarm for rule in RULES])
_ACTIVE_RULES = {phase: np.array([phase in rule.phases for rule in RULES]) for phase in Phase}


def _measured(facts: Facts, limits: LimitsConfig) -> Float:
    """Every measure of every vehicle, (measures, n)."""
    out = np.zeros((len(Measure), len(facts.names)))
    fence, separation_min_m = limits.fence, limits.min_separation_m
    _measure_reports(
        facts.error_m, facts.silent_s, facts.armed, facts.offboard, facts.duplicate,
        facts.model_mismatch, facts.link_behind_s, facts.setpoint_age_s, facts.attitude_innovation_rad,
        facts.late_share, out,
    )  # fmt: skip
    out[BATTERY_LOW] = limits.battery_low_share - facts.battery
    out[BATTERY_EMPTY] = limits.battery_empty_share - facts.battery
    _measure_positions(
        facts.age_s, facts.tilt_rad, facts.pos_lab_m, facts.own_pos_lab_m, facts.own_tilt_rad, fence.low_m,
        fence.high_m, separation_min_m, out,
    )  # fmt: skip
    return out


@kernel
def _measure_reports(
    error_m: Scalars, silent_s: Scalars, armed: Flags, offboard: Flags, duplicate: Flags,
    model_mismatch: Scalars, link_behind_s: Scalars, setpoint_age_s: Scalars, attitude_innovation_rad: Scalars,
    late_share: float, out: Float,
) -> None:  # fmt: skip
    """The measures that are a fact each, into out (measures, n)."""
    out[LEADER_POSITION_ERROR_M, 0], out[LATE_SHARE, 0] = error_m[0], late_share
    for i in range(len(error_m)):
        out[POSITION_ERROR_M, i] = error_m[i]
        out[SILENT_S, i] = silent_s[i]
        out[NOT_OFFBOARD, i] = 1.0 if armed[i] and not offboard[i] else 0.0
        out[DISARMED, i] = 0.0 if armed[i] else 1.0
        out[DUPLICATE, i] = 1.0 if duplicate[i] else 0.0
        out[MODEL_MISMATCH, i] = model_mismatch[i]
        out[LINK_BEHIND_S, i] = link_behind_s[i]
        out[SETPOINT_AGE_S, i] = setpoint_age_s[i]
        out[ATTITUDE_INNOVATION_RAD, i] = attitude_innovation_rad[i]


@kernel
def _measure_positions(
    age_s: Scalars, tilt_rad: Scalars, pos_lab_m: Vec3s, own_pos_lab_m: Vec3s, own_tilt_rad: Scalars,
    low_m: Vec3Tuple, high_m: Vec3Tuple, separation_m: float, out: Float,
) -> None:  # fmt: skip
    """The measures of what is seen, and of both independent estimates, into out (measures, n).

    Where a lost body is, nobody knows: no place is judged for it.
    """
    known = age_s <= LOST_S
    outside, own_outside = outside_box(pos_lab_m, low_m, high_m), outside_box(own_pos_lab_m, low_m, high_m)
    near = nearest(pos_lab_m, known)
    for i in range(len(age_s)):
        out[UNSEEN_S, i], out[TILT_RAD, i] = age_s[i], tilt_rad[i]
        reported = np.isfinite(own_pos_lab_m[i, 0] + own_pos_lab_m[i, 1] + own_pos_lab_m[i, 2])
        out[OUTSIDE_M, i] = outside[i] if known[i] else 0.0
        out[NEARNESS, i] = -near[i] / separation_m
        out[OUTSIDE_TOO_M, i] = _agreed(out[OUTSIDE_M, i], own_outside[i] if reported else np.nan, age_s[i])
        out[TILT_TOO_RAD, i] = _agreed(tilt_rad[i], own_tilt_rad[i], age_s[i])


@kernel
def _agreed(mocap: float, own: float, age_s: float) -> float:
    """The smaller of both independent estimates; zero where either is missing or the mocap does not see the body."""
    if not np.isfinite(own) or not age_s <= INDEPENDENT_FRESH_S:
        return 0.0
    return own if own < mocap or np.isnan(mocap) else mocap


@kernel
def outside_box(pos_lab_m: Vec3s, low_m: Vec3Tuple, high_m: Vec3Tuple) -> Scalars:
    """How far each point is outside the box, along the axis where it is farthest; zero inside; shape (n,)."""
    outside = np.zeros(len(pos_lab_m))
    for i in range(len(pos_lab_m)):
        for axis in range(3):
            beyond = max(low_m[axis] - pos_lab_m[i, axis], pos_lab_m[i, axis] - high_m[axis])
            outside[i] = max(outside[i], beyond)
    return outside


@kernel
def nearest(pos_lab_m: Vec3s, known: Flags) -> Scalars:
    """Distance of each point to the nearest other, among those `known` (n,); infinite for the rest; shape (n,).

    Along the widest axis, from each point both ways, until all that is left is farther along this axis alone.
    """
    near = np.full(len(pos_lab_m), np.inf)
    axis = widest_axis(pos_lab_m, known, 3)
    order = ascending(pos_lab_m[:, axis], known)
    for rank in range(len(order)):
        i = order[rank]
        for step in (-1, 1):
            k = rank + step
            while 0 <= k < len(order) and abs(pos_lab_m[order[k], axis] - pos_lab_m[i, axis]) < near[i]:
                j = order[k]
                dx, dy = pos_lab_m[i, 0] - pos_lab_m[j, 0], pos_lab_m[i, 1] - pos_lab_m[j, 1]
                dz = pos_lab_m[i, 2] - pos_lab_m[j, 2]
                distance = np.sqrt(dx * dx + dy * dy + dz * dz)
                near[i], near[j] = min(near[i], distance), min(near[j], distance)
                k += step
    return near


@kernel
def _find_broken(
    measured: Float, commanded: Flags, excluded: Flags, landing: Flags, active: Flags, active_landing: Flags, on: Flags,
    acted: NDArray[np.bool_], broken: NDArray[np.bool_],
) -> bool:  # fmt: skip
    """Whether any vehicle breaks a rule, or one was acted on; `broken` (rules, n) says which, and comes in false.

    active, active_landing: the rules (rules,) of the phase, and of what lands; on: which are applied at all.
    """
    fault = False
    for rule in range(len(_OVER)):
        for i in range(len(commanded)):
            applied = active_landing[rule] if landing[i] else active[rule]
            if applied and on[rule] and not excluded[i] and (commanded[i] or _OF_ALL[rule]):
                broken[rule, i] = measured[_MEASURES[rule], i] > _OVER[rule]
            fault = fault or broken[rule, i] or acted[rule, i]
    return fault


def _swarm_fault(acting: NDArray[np.bool_], acted: NDArray[np.bool_], facts: Facts) -> FaultChange | None:
    for trigger in _SEVEREST_FIRST:
        for row, before, rule in zip(acting, acted, RULES, strict=True):
            if rule.swarm is trigger and row.any():
                i = int(row.argmax())
                return FaultChange(i, rule, not before[i], facts.names[i])
    return None


def _owned(acting: NDArray[np.bool_], own: Own) -> Flags:
    rows = np.array([rule.own is own for rule in RULES])
    flags: Flags = (acting & rows[:, None]).any(axis=0)
    return flags


def _changes(acting: NDArray[np.bool_], acted: NDArray[np.bool_], facts: Facts) -> tuple[FaultChange, ...]:
    return tuple(
        FaultChange(int(i), RULES[r], bool(acting[r, i]), facts.names[i]) for r, i in np.argwhere(acting != acted)
    )
