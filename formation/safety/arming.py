"""Why a swarm may not arm, in words an operator can act on. Pure decisions on plain facts."""

import numpy as np

from formation.config import LimitsConfig
from formation.safety.rules import Facts, nearest, outside_box
from formation.safety.rules_table import BATTERY_LOW, HEARTBEAT_S

FRESH_S = 0.2
STILL_M_S = 0.3
LEVEL_RAD = 0.35


def prearm_failures(facts: Facts, limits: LimitsConfig) -> tuple[str, ...]:
    """Every failed pre-arm check, as a text; empty when the swarm may arm. Those an operator can fix come first."""
    fresh = facts.age_s <= FRESH_S
    outside = outside_box(facts.pos_lab_m, limits.fence.low_m, limits.fence.high_m)
    near = nearest(facts.pos_lab_m, fresh)
    reasons: list[str] = []
    for i, name in enumerate(facts.names):
        if not fresh[i]:
            reasons.append(f"{name}: no fresh pose (last seen {_seconds(facts.age_s[i])})")
        elif facts.commanded[i]:
            reasons += _pose_failures(facts, i, float(outside[i]))
        if near[i] < limits.min_separation_m:
            reasons.append(f"{name}: {near[i]:.2f} m from the next body, minimum is {limits.min_separation_m:.2f} m")
        if facts.commanded[i]:
            reasons += _link_failures(facts, i)
    return (*reasons, *facts.prearm_failures)


def _pose_failures(facts: Facts, i: int, outside_m: float) -> list[str]:
    name, reasons = facts.names[i], []
    if outside_m > 0.0:
        reasons.append(f"{name}: {outside_m:.2f} m outside the fence")
    if facts.tilt_rad[i] > LEVEL_RAD:
        reasons.append(f"{name}: tilted by {np.degrees(facts.tilt_rad[i]):.0f} degrees")
    if facts.speed_m_s[i] > STILL_M_S:
        reasons.append(f"{name}: moving at {facts.speed_m_s[i]:.2f} m/s")
    return reasons


def _link_failures(facts: Facts, i: int) -> list[str]:
    name, reasons = facts.names[i], []
    if facts.heartbeat_age_s[i] > HEARTBEAT_S:
        reasons.append(f"{name}: no heartbeat (last heard {_seconds(facts.heartbeat_age_s[i])})")
    if facts.battery[i] < BATTERY_LOW:
        reasons.append(f"{name}: battery at {facts.battery[i]:.0%}")
    if facts.duplicate[i]:
        reasons.append(f"{name}: its sysid is used twice on the network")
    return reasons


def _seconds(age_s: float) -> str:
    return f"{age_s:.1f} s ago" if np.isfinite(age_s) else "never"
