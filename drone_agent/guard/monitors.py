"""What in the guard detects or refuses, by name, so that a campaign can show what each is for."""

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from drone_agent.guard.stages import Trigger

MONITORS = (
    "stale-setpoint",  # older than 100 ms
    "old-setpoint",  # not newer than the last followed
    "foreign-setpoint",  # of a ground that does not own the stream
    "setpoint-bounds",  # tilt, body rate and thrust
    "stream-stale",  # level and hold 0.1 s after the last setpoint
    "own-land",  # land by its own clock after that
    "pose-slides",  # neither poses nor setpoints count that move as the inertial sensors do not
    "motor-failure",  # thrust that is missing, and a body that turns as no command turns it
    "stop-latch",  # no arming after a stop until it was seen at rest
)

MONITOR_OF: Mapping[Trigger, str] = MappingProxyType(
    {
        Trigger.POSE_FAULT: "pose-slides",
        Trigger.THRUST_LOSS: "motor-failure",
        Trigger.ATTITUDE_LOSS: "motor-failure",
    }
)
"""The monitor that a trigger of a fault signature belongs to."""


def switched_off(names: Iterable[str]) -> frozenset[str]:
    """The monitors to do without; ValueError names one that is none of them."""
    off = frozenset(names)
    unknown = sorted(off - set(MONITORS))
    if unknown:
        raise ValueError(f"unknown monitors: {', '.join(unknown)}; known: {', '.join(MONITORS)}")
    return off
