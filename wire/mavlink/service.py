"""Messages of status, commands, parameters and time to and from MAVLink fields; see mavlink_motion for the form."""

import math
import re
from collections.abc import Callable, Mapping
from typing import Any

from wire.link_messages import (
    Address,
    AutopilotVersion,
    Battery,
    CommandAck,
    CommandInt,
    CommandLong,
    EkfStatus,
    ExtendedSysState,
    Heartbeat,
    LandedState,
    MavAutopilot,
    NamedValue,
    ParamRequestList,
    ParamRequestRead,
    ParamSet,
    ParamType,
    ParamValue,
    Ping,
    Result,
    SetMode,
    SysStatus,
    SystemTime,
    TimeSync,
)
from wire.mavlink.framing import Fields, Layout, MavlinkError, layout
from wire.mavlink.motion import Written
from wire.mavlink.text import STATUSTEXT, read_chunk
from wire.text import plain

HEARTBEAT = layout("HEARTBEAT", 6)
SYS_STATUS = layout("SYS_STATUS", 16)
SYSTEM_TIME = layout("SYSTEM_TIME", 2)
PING = layout("PING", 4)
SET_MODE = layout("SET_MODE", 3)
PARAM_REQUEST_READ = layout("PARAM_REQUEST_READ", 4)
PARAM_REQUEST_LIST = layout("PARAM_REQUEST_LIST", 2)
# An integer in PX4's bytes may be a signalling NaN, which a float would quieten: kept as bytes.
PARAM_VALUE = layout("PARAM_VALUE", 5, raw="param_value")
PARAM_SET = layout("PARAM_SET", 5, raw="param_value")
COMMAND_INT = layout("COMMAND_INT", 13)
COMMAND_LONG = layout("COMMAND_LONG", 11)
COMMAND_ACK = layout("COMMAND_ACK", 6)
TIMESYNC = layout("TIMESYNC", 4, extension="BB")
BATTERY_STATUS = layout("BATTERY_STATUS", 26)
AUTOPILOT_VERSION = layout("AUTOPILOT_VERSION", 50)
EKF_STATUS_REPORT = layout("EKF_STATUS_REPORT", 7)
ESTIMATOR_STATUS = layout("ESTIMATOR_STATUS", 10)
EXTENDED_SYS_STATE = layout("EXTENDED_SYS_STATE", 2)
NAMED_VALUE_FLOAT = layout("NAMED_VALUE_FLOAT", 3)

_MAVLINK_VERSION = 3
_PARAM_NAME = re.compile(r"[A-Za-z0-9_]{1,16}")
_MS_32 = 0xFFFFFFFF
_NO_CELL = 65535
_LIPO, _ALL_SYSTEMS, _TEMPERATURE_UNKNOWN = 1, 1, 32767


def _scaled(value: float, scale: float, unknown: int) -> int:
    """`value * scale` as an integer, `unknown` for NaN."""
    return unknown if math.isnan(value) else round(value * scale)


def _unscaled(value: int, scale: float, unknown: int) -> float:
    return math.nan if value == unknown else value / scale


def _name(field: bytes) -> str:
    return plain(field.partition(b"\0")[0].decode(errors="replace"), 16)


def _characters(name: str, size: int) -> bytes:
    field = name.encode(errors="replace")
    if len(field) > size:
        raise MavlinkError(f"{name!r} is longer than the field's {size} bytes")
    return field


def _write_heartbeat(m: Heartbeat) -> Written:
    return HEARTBEAT, (
        m.vehicle_type, int(m.autopilot), m.base_mode, m.custom_mode, m.system_status, _MAVLINK_VERSION,
    )  # fmt: skip


def _read_heartbeat(f: Fields) -> Heartbeat:
    return Heartbeat(MavAutopilot(f[1]), f[0], f[2], f[3], f[4])


def _write_sys_status(m: SysStatus) -> Written:
    sensors = (m.sensors_present, m.sensors_enabled, m.sensors_healthy)
    battery = (_scaled(m.battery_v, 1e3, 65535), _scaled(m.battery_a, 1e2, -1))
    remaining = _scaled(m.battery_remaining, 1e2, -1)
    return SYS_STATUS, (*sensors, round(m.load * 1e3), *battery, remaining, *(0,) * 9)


def _read_sys_status(f: Fields) -> SysStatus:
    present, enabled, healthy, load, millivolts, centiamperes, percent = f[:7]
    battery = (_unscaled(millivolts, 1e3, 65535), _unscaled(centiamperes, 1e2, -1), _unscaled(percent, 1e2, -1))
    return SysStatus(present, enabled, healthy, load * 1e-3, *battery)


def _write_battery(m: Battery) -> Written:
    cells = [_scaled(v, 1e3, _NO_CELL) for v in m.cell_v]
    first = (*cells[:10], *(_NO_CELL,) * (10 - len(cells)))
    more = (*cells[10:], *(0,) * (4 - max(0, len(cells) - 10)))
    used = (_scaled(m.current_a, 1e2, -1), _scaled(m.consumed_mah, 1.0, -1), -1)
    kind = (0, _ALL_SYSTEMS, _LIPO, _TEMPERATURE_UNKNOWN)
    return BATTERY_STATUS, (*kind, *first, *used, _scaled(m.remaining, 1e2, -1), 0, 0, *more, 0, 0)


def _read_battery(f: Fields) -> Battery:
    cells = [v * 1e-3 for v in f[4:14] if v != _NO_CELL] + [v * 1e-3 for v in f[20:24] if v]
    used = (_unscaled(f[14], 1e2, -1), _unscaled(f[15], 1.0, -1))
    return Battery(tuple(cells), *used, _unscaled(f[17], 1e2, -1))


def _write_extended_state(m: ExtendedSysState) -> Written:
    return EXTENDED_SYS_STATE, (0, int(m.landed))


def _read_extended_state(f: Fields) -> ExtendedSysState:
    return ExtendedSysState(LandedState(f[1]))


def _write_ekf(m: EkfStatus) -> Written:
    if m.ardupilot:
        return EKF_STATUS_REPORT, (m.flags, *(0.0,) * 6)
    ratios = (0.0, m.pos_horiz_ratio, m.pos_vert_ratio, 0.0, 0.0, 0.0)
    return ESTIMATOR_STATUS, (m.t_us, m.flags, *ratios, m.pos_horiz_accuracy_m, m.pos_vert_accuracy_m)


def _read_estimator(f: Fields) -> EkfStatus:
    return EkfStatus(f[1], False, f[0], f[3], f[4], f[8], f[9])


def _write_command(m: CommandLong) -> Written:
    return COMMAND_LONG, (m.target.system, m.target.component, m.command, m.confirmation, *m.params)


def _read_command(f: Fields) -> CommandLong:
    return CommandLong(Address(f[0], f[1]), f[2], f[4:], f[3])


def _write_command_int(m: CommandInt) -> Written:
    head = (m.target.system, m.target.component, m.frame, m.command, 0, 0)
    return COMMAND_INT, (*head, *m.params, m.x, m.y, m.z)


def _read_command_int(f: Fields) -> CommandInt:
    return CommandInt(Address(f[0], f[1]), f[2], f[3], f[6:10], f[10], f[11], f[12])


def _write_ack(m: CommandAck) -> Written:
    return COMMAND_ACK, (m.command, int(m.result), m.progress, 0, m.target.system, m.target.component)


def _read_ack(f: Fields) -> CommandAck:
    return CommandAck(Address(f[4], f[5]), f[0], Result(f[1]), f[2])


def _write_set_mode(m: SetMode) -> Written:
    return SET_MODE, (m.target_system, m.base_mode, m.custom_mode)


def _write_timesync(m: TimeSync) -> Written:
    return TIMESYNC, (m.tc1_ns, m.ts1_ns, m.target.system, m.target.component)


def _read_timesync(f: Fields) -> TimeSync:
    return TimeSync(f[0], f[1], Address(f[2], f[3]))


def _write_ping(m: Ping) -> Written:
    return PING, (m.t_us, m.seq, m.target.system, m.target.component)


def _write_system_time(m: SystemTime) -> Written:
    return SYSTEM_TIME, (m.t_unix_us, m.t_boot_ms & _MS_32)


def _write_param_value(m: ParamValue) -> Written:
    return PARAM_VALUE, (_characters(m.name, 16), m.raw, int(m.type), m.count, m.index)


def _read_param_value(f: Fields) -> ParamValue:
    name = _name(f[0])
    if _PARAM_NAME.fullmatch(name) is None:
        raise MavlinkError(f"{name!r} is no parameter's name")
    return ParamValue(name, f[1], ParamType(f[2]), f[3], f[4])


def _write_param_set(m: ParamSet) -> Written:
    return PARAM_SET, (m.target.system, m.target.component, _characters(m.name, 16), m.raw, int(m.type))


def _read_param_set(f: Fields) -> ParamSet:
    return ParamSet(Address(f[0], f[1]), _name(f[2]), f[3], ParamType(f[4]))


def _write_param_request(m: ParamRequestRead) -> Written:
    return PARAM_REQUEST_READ, (m.target.system, m.target.component, _characters(m.name, 16), m.index)


def _write_param_list(m: ParamRequestList) -> Written:
    return PARAM_REQUEST_LIST, (m.target.system, m.target.component)


def _write_version(m: AutopilotVersion) -> Written:
    head = (m.capabilities, m.flight_sw_version, 0, 0, 0)
    return AUTOPILOT_VERSION, (*head, *(0,) * 24, 0, 0, m.uid, *(0,) * 18)


def _write_named_value(m: NamedValue) -> Written:
    return NAMED_VALUE_FLOAT, (m.t_boot_ms & _MS_32, _characters(m.name, 10), m.value)


WRITERS: Mapping[type, Callable[[Any], Written]] = {
    Heartbeat: _write_heartbeat,
    SysStatus: _write_sys_status,
    Battery: _write_battery,
    ExtendedSysState: _write_extended_state,
    EkfStatus: _write_ekf,
    CommandLong: _write_command,
    CommandInt: _write_command_int,
    CommandAck: _write_ack,
    SetMode: _write_set_mode,
    TimeSync: _write_timesync,
    Ping: _write_ping,
    SystemTime: _write_system_time,
    ParamValue: _write_param_value,
    ParamSet: _write_param_set,
    ParamRequestRead: _write_param_request,
    ParamRequestList: _write_param_list,
    AutopilotVersion: _write_version,
    NamedValue: _write_named_value,
}

READERS: Mapping[Layout, Callable[[Fields], Any]] = {
    HEARTBEAT: _read_heartbeat,
    SYS_STATUS: _read_sys_status,
    BATTERY_STATUS: _read_battery,
    EXTENDED_SYS_STATE: _read_extended_state,
    EKF_STATUS_REPORT: lambda f: EkfStatus(f[0], ardupilot=True),
    ESTIMATOR_STATUS: _read_estimator,
    STATUSTEXT: read_chunk,
    COMMAND_LONG: _read_command,
    COMMAND_INT: _read_command_int,
    COMMAND_ACK: _read_ack,
    SET_MODE: lambda f: SetMode(*f),
    TIMESYNC: _read_timesync,
    PING: lambda f: Ping(f[0], f[1], Address(f[2], f[3])),
    SYSTEM_TIME: lambda f: SystemTime(*f),
    PARAM_VALUE: _read_param_value,
    PARAM_SET: _read_param_set,
    PARAM_REQUEST_READ: lambda f: ParamRequestRead(Address(f[0], f[1]), _name(f[2]), f[3]),
    PARAM_REQUEST_LIST: lambda f: ParamRequestList(Address(f[0], f[1])),
    AUTOPILOT_VERSION: lambda f: AutopilotVersion(f[0], f[1], f[31]),
    NAMED_VALUE_FLOAT: lambda f: NamedValue(f[0], _name(f[1]), f[2]),
}
