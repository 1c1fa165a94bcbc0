"""The names of what the ground watches, by which a campaign switches one off to see that it is needed."""

from formation.control import limits
from formation.safety.rules_table import RULE_NAMES

ARM_IN_AIR = "arm-in-air"
ARM_OTHER_GROUND = "arm-other-ground"
LOG_TROUBLE = "log-trouble"
STOP_REPEAT = "stop-repeat"
SETPOINT_HOLD_OFF = "setpoint-hold-off"
MONITORS = (*RULE_NAMES, *limits.MONITORS, ARM_IN_AIR, ARM_OTHER_GROUND, LOG_TROUBLE, STOP_REPEAT, SETPOINT_HOLD_OFF)


def check(without: frozenset[str]) -> None:
    """ValueError for a name that is none."""
    unknown = sorted(without - set(MONITORS))
    if unknown:
        raise ValueError(f"no monitor of the ground: {', '.join(unknown)}")
