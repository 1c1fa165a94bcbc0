"""The parameter protocol."""

from dataclasses import dataclass
from enum import IntEnum

from wire.link_messages.address import Address


class ParamType(IntEnum):
    """MAV_PARAM_TYPE."""

    UINT8 = 1
    INT8 = 2
    UINT16 = 3
    INT16 = 4
    UINT32 = 5
    INT32 = 6
    UINT64 = 7
    INT64 = 8
    REAL32 = 9
    REAL64 = 10


@dataclass(frozen=True, slots=True)
class ParamValue:
    """PARAM_VALUE (22). `raw` is the float field as it rides; PX4 puts integers in bytewise, ArduPilot casts."""

    name: str
    raw: bytes
    type: ParamType
    count: int
    index: int


@dataclass(frozen=True, slots=True)
class ParamSet:
    """PARAM_SET (23); `raw` as in ParamValue."""

    target: Address
    name: str
    raw: bytes
    type: ParamType


@dataclass(frozen=True, slots=True)
class ParamRequestRead:
    """PARAM_REQUEST_READ (20); by index where it is >= 0."""

    target: Address
    name: str
    index: int = -1


@dataclass(frozen=True, slots=True)
class ParamRequestList:
    """PARAM_REQUEST_LIST (21)."""

    target: Address
