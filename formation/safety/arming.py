"""Why a swarm may not arm, as reasons an operator can act on. Pure decisions on plain facts."""

import numpy as np

from formation.config import LimitsConfig
from formation.reasons import Reason, Reject
from formation.safety.rules import Facts, nearest, outside_box
from formation.safety.rules_table import BATTERY_LOW, HEARTBEAT_S

FRESH_S = 0.2
"""A pose is fresh until it is so old: who has none neither arms nor is led, formed on or foreseen."""
STILL_M_S = 0.3
LEVEL_RAD = 0.35


def prearm_failures(facts: Facts, limits: LimitsConfig) -> tuple[Reject, ...]:
    """Every failed pre-arm check; empty when the swarm may arm. Those an operator can fix come first."""
    fresh = facts.age_s <= FRESH_S
    outside = outside_box(facts.pos_lab_m, limits.fence.low_m, limits.fence.high_m)
    near = nearest(facts.pos_lab_m, fresh)
    reasons: list[Reject] = []
    for i, name in enumerate(facts.names):
        if not fresh[i]:
            reasons.append(Reason.NO_POSE.of(name, _seconds(facts.age_s[i])))
        elif facts.commanded[i]:
            reasons += _pose_failures(facts, i, float(outside[i]))
        if near[i] < limits.min_separation_m:
            reasons.append(Reason.TOO_NEAR.of(name, near[i], limits.min_separation_m))
        if facts.commanded[i]:
            reasons += _link_failures(facts, i)
    return tuple(reasons)


def _pose_failures(facts: Facts, i: int, outside_m: float) -> list[Reject]:
    name, reasons = facts.names[i], list[Reject]()
    if outside_m > 0.0:
        reasons.append(Reason.OUTSIDE_FENCE.of(name, outside_m))
    if facts.tilt_rad[i] > LEVEL_RAD:
        reasons.append(Reason.TILTED.of(name, np.degrees(facts.tilt_rad[i])))
    if facts.speed_m_s[i] > STILL_M_S:
        reasons.append(Reason.MOVING.of(name, facts.speed_m_s[i]))
    return reasons


def _link_failures(facts: Facts, i: int) -> list[Reject]:
    name, reasons = facts.names[i], list[Reject]()
    if facts.heartbeat_age_s[i] > HEARTBEAT_S:
        reasons.append(Reason.NO_HEARTBEAT.of(name, _seconds(facts.heartbeat_age_s[i])))
    if facts.battery[i] < BATTERY_LOW:
        reasons.append(Reason.BATTERY_LOW.of(name, facts.battery[i]))
    if facts.duplicate[i]:
        reasons.append(Reason.SYSID_TWICE.of(name))
    return reasons


def _seconds(age_s: float) -> str:
    return f"{age_s:.1f} s ago" if np.isfinite(age_s) else "never"
