"""Commands and their answers."""

from dataclasses import dataclass
from enum import IntEnum

from wire.link_messages.address import Address


@dataclass(frozen=True, slots=True)
class Command:
    """COMMAND_LONG (76)."""

    target: Address
    command: int
    params: tuple[float, float, float, float, float, float, float]
    confirmation: int = 0


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
