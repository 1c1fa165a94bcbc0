"""Commands and their answers."""

from dataclasses import dataclass
from enum import IntEnum

from wire.link_messages.address import Address


class MavCommand(IntEnum):
    """MAV_CMD, those that are sent or obeyed here."""

    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    DO_SET_MODE = 176
    DO_FLIGHTTERMINATION = 185
    DO_REPOSITION = 192
    MISSION_START = 300
    COMPONENT_ARM_DISARM = 400
    GET_HOME_POSITION = 410
    GET_MESSAGE_INTERVAL = 510
    SET_MESSAGE_INTERVAL = 511
    REQUEST_MESSAGE = 512
    REQUEST_AUTOPILOT_CAPABILITIES = 520
    REQUEST_OPERATOR_CONTROL = 32100  # development.xml


class MavFrame(IntEnum):
    """MAV_FRAME, of CommandInt."""

    GLOBAL = 0
    LOCAL_NED = 1
    MISSION = 2
    GLOBAL_RELATIVE_ALT = 3
    LOCAL_ENU = 4
    GLOBAL_INT = 5
    GLOBAL_RELATIVE_ALT_INT = 6
    LOCAL_OFFSET_NED = 7
    BODY_NED = 8
    BODY_OFFSET_NED = 9
    GLOBAL_TERRAIN_ALT = 10
    GLOBAL_TERRAIN_ALT_INT = 11
    BODY_FRD = 12
    LOCAL_FRD = 20
    LOCAL_FLU = 21


DISARM_IN_FLIGHT, ARM_PAST_CHECKS = 21196, 2989
"""COMPONENT_ARM_DISARM's second parameter: what forces it, in both autopilots."""


@dataclass(frozen=True, slots=True)
class CommandLong:
    """COMMAND_LONG (76)."""

    target: Address
    command: int
    params: tuple[float, float, float, float, float, float, float]
    confirmation: int = 0


def command_long(target: Address, command: int, *params: float) -> CommandLong:
    """The command with zeros for the parameters that are not given."""
    p1, p2, p3, p4, p5, p6, p7 = (*params, *(0.0,) * (7 - len(params)))
    return CommandLong(target, command, (p1, p2, p3, p4, p5, p6, p7))


@dataclass(frozen=True, slots=True)
class CommandInt:
    """COMMAND_INT (75); x, y as sent (degrees * 1e7 or metres * 1e4, by frame)."""

    target: Address
    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    CANCELLED = 6
    COMMAND_LONG_ONLY = 7
    COMMAND_INT_ONLY = 8
    UNSUPPORTED_FRAME = 9


@dataclass(frozen=True, slots=True)
class CommandAck:
    """COMMAND_ACK (77); progress 0..100 or 255 where unknown."""

    target: Address
    command: int
    result: Result
    progress: int = 255


@dataclass(frozen=True, slots=True)
class SetMode:
    """SET_MODE (11), the old way, still sent by mavutil and MAVProxy."""

    target_system: int
    base_mode: int
    custom_mode: int
