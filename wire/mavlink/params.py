"""The float field of a MAVLink parameter, as PX4 fills it (bytewise) and as ArduPilot does (a cast)."""

import struct

from wire.link_messages import MavAutopilot, ParamType
from wire.mavlink.framing import MavlinkError

_REAL32 = struct.Struct("<f")
_BYTEWISE = {
    ParamType.UINT8: struct.Struct("<Bxxx"),
    ParamType.INT8: struct.Struct("<bxxx"),
    ParamType.UINT16: struct.Struct("<Hxx"),
    ParamType.INT16: struct.Struct("<hxx"),
    ParamType.UINT32: struct.Struct("<I"),
    ParamType.INT32: struct.Struct("<i"),
    ParamType.REAL32: _REAL32,
}


def param_to_raw(value: float, kind: ParamType, autopilot: MavAutopilot) -> bytes:
    """The four bytes that carry `value`; MavlinkError if the type cannot hold it.

    PX4 (and every autopilot but ArduPilot): the integer's own bytes. ArduPilot: the number as a float.
    """
    form = _form(kind, autopilot)
    try:
        return form.pack(value if form is _REAL32 else _whole(value))
    except (struct.error, OverflowError) as error:
        raise MavlinkError(f"{value} does not fit a parameter of type {kind.name}: {error}") from error


def param_from_raw(raw: bytes, kind: ParamType, autopilot: MavAutopilot) -> int | float:
    """The value in `raw` (four bytes): an int for integer types, else a float; MavlinkError if there is none."""
    value: int | float = _form(kind, autopilot).unpack(raw)[0]
    return value if kind is ParamType.REAL32 else _whole(value)


def _form(kind: ParamType, autopilot: MavAutopilot) -> struct.Struct:
    if kind not in _BYTEWISE:
        raise MavlinkError(f"a parameter of type {kind.name} does not fit MAVLink's four bytes")
    return _REAL32 if autopilot is MavAutopilot.ARDUPILOT else _BYTEWISE[kind]


def _whole(value: float) -> int:
    try:
        whole = int(value)
    except (ValueError, OverflowError) as error:
        raise MavlinkError(f"{value} is no integer") from error
    if whole != value:
        raise MavlinkError(f"{value} is no integer")
    return whole
