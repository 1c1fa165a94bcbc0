"""The stage table: how the ground handles one drone, from the floor to the floor. `Drone.enter` runs on it.

`TABLE` says what each trigger makes of each stage, `ROWS` what a stage asks of the drone's autopilot and whether it is
sent setpoints. Wanted stands against reported, every tick: an acknowledgement never counts as done, the next heartbeat
does. A new stage is a member of `Stage`, a row of `ROWS` and its entries in `TABLE`; a new phase of the swarm a row of
`gcs.flight.PHASES`.
"""

from collections.abc import Callable, Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import NamedTuple

from gcs.drones.link_state import DroneLink
from gcs.drones.protocols import arm, cut, disarm, land, request_control
from wire.link_messages import CommandLong

STREAM_FIRST_NS = 1_200_000_000
"""For so long setpoints are sent first: PX4 wants a second of them before it changes to off-board."""


class Stage(StrEnum):
    """What the ground does with a drone now."""

    FOLLOW = "follow"  # nothing is asked for; it follows its setpoint, or stands
    DESCEND = "descend"  # the same, above its landing spot: led straight down
    ARM = "arm"
    JOIN = "join"  # taken over in flight
    DISARM = "disarm"  # touched down, or never risen
    RELEASED = "released"  # its autopilot lands it
    CUT = "cut"
    PILOTED = "piloted"  # a pilot has taken it over, it is left alone


class Trigger(StrEnum):
    """What can change a drone's stage: a phase of the swarm, a rule of safety, or something seen to have happened."""

    ARM = "arm"
    LEAD = "lead"  # a phase in the air begins
    JOIN = "join"
    REST = "rest"  # it takes no part, or begins anew
    OVER_SPOT = "over its landing spot"
    DISARM = "disarm"
    RELEASE = "release"
    CUT = "cut by a rule"
    STOP = "stop"
    PILOT = "a pilot flies it"
    DONE = "done"  # its stage is reached, and is no stage to stay in


_STREAMED = (Stage.FOLLOW, Stage.DESCEND, Stage.ARM, Stage.JOIN, Stage.DISARM)
MOTORS_OFF = frozenset({Stage.DISARM, Stage.RELEASED, Stage.CUT})
"""Stages that end with motors off."""

TABLE: Mapping[tuple[Stage, Trigger], Stage] = MappingProxyType(
    {
        **{(stage, Trigger.ARM): Stage.ARM for stage in Stage},
        **{(stage, Trigger.JOIN): Stage.JOIN for stage in Stage},
        **{(stage, Trigger.REST): Stage.FOLLOW for stage in Stage},
        **{(stage, Trigger.STOP): Stage.CUT for stage in Stage},
        **{(stage, Trigger.CUT): Stage.CUT for stage in Stage if stage is not Stage.PILOTED},
        **{(stage, Trigger.LEAD): Stage.FOLLOW for stage in _STREAMED if stage is not Stage.JOIN},
        **{(stage, Trigger.DISARM): Stage.DISARM for stage in _STREAMED},
        **{(stage, Trigger.RELEASE): Stage.RELEASED for stage in _STREAMED},
        **{(stage, Trigger.PILOT): Stage.PILOTED for stage in (*_STREAMED, Stage.RELEASED) if stage is not Stage.JOIN},
        **{(stage, Trigger.DONE): Stage.FOLLOW for stage in (*MOTORS_OFF, Stage.JOIN)},
        (Stage.FOLLOW, Trigger.OVER_SPOT): Stage.DESCEND,
    }
)


class Row(NamedTuple):
    """goal: in words, as it is published. streams: whether setpoints are sent each frame.

    command: the next one towards the goal; its second argument is how long the stage has lasted, ns. reached: whether
    the last heartbeat reports the goal; None where nothing is asked for.
    """

    goal: str
    streams: bool
    command: Callable[[DroneLink, int], CommandLong | None] = lambda _link, _lasted_ns: None
    reached: Callable[[DroneLink], bool] | None = None


def _is_disarmed(link: DroneLink) -> bool:
    return not link.armed


def _arm(link: DroneLink, lasted_ns: int) -> CommandLong | None:
    return arm(link.target) if link.offboard and lasted_ns >= STREAM_FIRST_NS else _set_offboard(link, lasted_ns)


def _set_offboard(link: DroneLink, lasted_ns: int) -> CommandLong | None:
    return None if link.model is None or lasted_ns < STREAM_FIRST_NS else link.model.set_offboard(link.target)


def control(link: DroneLink) -> CommandLong:
    """Asks it to follow this ground; a real autopilot answers that it does not know what that means."""
    return request_control(link.target, link.codec.own)


def _join(link: DroneLink, lasted_ns: int) -> CommandLong | None:
    return _set_offboard(link, lasted_ns) if control(link) in link.commands.answers else control(link)


ROWS: Mapping[Stage, Row] = MappingProxyType(
    {
        Stage.FOLLOW: Row("leave as it is", True),
        Stage.DESCEND: Row("leave as it is", True),
        Stage.ARM: Row("off-board and armed", True, _arm, lambda link: link.armed and link.offboard),
        Stage.JOIN: Row(
            "off-board, following this ground", True, _join,
            lambda link: link.offboard and control(link) in link.commands.answers,
        ),
        Stage.DISARM: Row("disarmed", True, lambda link, _: disarm(link.target), _is_disarmed),
        Stage.RELEASED: Row(
            "landing by itself", False, lambda link, _: None if link.landing else land(link.target), _is_disarmed
        ),
        Stage.CUT: Row("motors cut", False, lambda link, _: cut(link.target), _is_disarmed),
        Stage.PILOTED: Row("leave as it is", False),
    }
)  # fmt: skip
