"""The stage table: who guides the drone, and what each event makes of it. The guard runs on it.

One stage at a time, from disarmed to disarmed; the README shows this very table.
"""

from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType


class Stage(StrEnum):
    """Who guides the drone now."""

    DISARMED = "DISARMED"
    OWN = "OWN MODE"  # armed in a mode of the autopilot's own, an operator's choice or its own fail-safe's
    WAIT = "WAIT"  # armed in a setpoint mode, no setpoint yet
    FOLLOW = "FOLLOW"  # the owner's setpoints
    HOLD = "HOLD"  # they are stale, or the pose is faulty: hold until they come back
    LAND = "LAND"  # by its own clock, on its own pose
    DESCEND = "DESCEND"  # by attitude and thrust alone
    STOPPED = "STOPPED"  # disarmed, and not to be armed


class Trigger(StrEnum):
    """A cause that can change the stage: an order, or something seen to have happened."""

    ARM = "arm"
    STREAM = "setpoint mode, stream alive"
    NO_STREAM = "setpoint mode, no stream"
    OTHER_MODE = "other mode"
    SETPOINT = "setpoint"
    STALE = "stale"
    NEW_OWNER = "new owner"
    HELD = "held its time"
    LAND_COMMAND = "landing commanded, pose rejected"
    NO_POSE = "no pose"
    POSE_FAULT = "pose fault"
    THRUST_LOSS = "thrust loss"
    ATTITUDE_LOSS = "attitude loss"
    DISARM = "disarmed"
    STOP = "stop"
    RESTED = "at rest for 2 s"


_ARMED = (Stage.OWN, Stage.WAIT, Stage.FOLLOW, Stage.HOLD, Stage.LAND, Stage.DESCEND)
_SETPOINT_MODES = (Stage.WAIT, Stage.FOLLOW, Stage.HOLD, Stage.LAND, Stage.DESCEND)
RULED = frozenset({Stage.WAIT, Stage.FOLLOW, Stage.HOLD})
"""In which setpoints have an owner."""

TABLE: Mapping[tuple[Stage, Trigger], Stage] = MappingProxyType(
    {
        (Stage.DISARMED, Trigger.ARM): Stage.OWN,
        **{(stage, Trigger.STREAM): Stage.FOLLOW for stage in _ARMED},
        **{(stage, Trigger.NO_STREAM): Stage.WAIT for stage in _ARMED},
        **{(stage, Trigger.OTHER_MODE): Stage.OWN for stage in _ARMED},
        (Stage.WAIT, Trigger.SETPOINT): Stage.FOLLOW,
        (Stage.WAIT, Trigger.NEW_OWNER): Stage.WAIT,
        (Stage.FOLLOW, Trigger.SETPOINT): Stage.FOLLOW,
        (Stage.FOLLOW, Trigger.STALE): Stage.HOLD,
        (Stage.FOLLOW, Trigger.POSE_FAULT): Stage.HOLD,
        (Stage.FOLLOW, Trigger.THRUST_LOSS): Stage.LAND,
        (Stage.FOLLOW, Trigger.NEW_OWNER): Stage.HOLD,
        (Stage.HOLD, Trigger.SETPOINT): Stage.FOLLOW,
        (Stage.HOLD, Trigger.NEW_OWNER): Stage.HOLD,
        (Stage.HOLD, Trigger.HELD): Stage.LAND,
        (Stage.HOLD, Trigger.THRUST_LOSS): Stage.LAND,
        **{(stage, Trigger.LAND_COMMAND): Stage.LAND for stage in (Stage.HOLD, Stage.LAND)},
        (Stage.DESCEND, Trigger.LAND_COMMAND): Stage.DESCEND,
        (Stage.HOLD, Trigger.NO_POSE): Stage.DESCEND,
        (Stage.LAND, Trigger.NO_POSE): Stage.DESCEND,
        **{(stage, Trigger.ATTITUDE_LOSS): Stage.STOPPED for stage in _SETPOINT_MODES},
        **{(stage, Trigger.DISARM): Stage.DISARMED for stage in _ARMED},
        **{(stage, Trigger.STOP): Stage.STOPPED for stage in Stage},
        (Stage.STOPPED, Trigger.RESTED): Stage.DISARMED,
    }
)


def advance(stage: Stage, trigger: Trigger) -> Stage | None:
    """The stage that `trigger` leads to, or None where it means nothing in this stage."""
    return TABLE.get((stage, trigger))


def table_markdown() -> str:
    """The table as the documentation shows it: a row an event, a column a stage."""
    header = "| | " + " | ".join(stage.value for stage in Stage) + " |"
    rule = "|---" * (len(Stage) + 1) + "|"
    rows = (
        f"| {trigger.value} | " + " | ".join(_cell(advance(stage, trigger)) for stage in Stage) + " |"
        for trigger in Trigger
    )
    return "\n".join((header, rule, *rows))


def _cell(stage: Stage | None) -> str:
    return "-" if stage is None else stage.value


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
