"""MAVLink's messages as a table: a row each, with the fields in the order of MAVLink's documentation.

Readers and writers follow from the rows; what a row cannot say has a reader and a writer of its own.

A reader takes a packet's fields, flat; a writer returns them. Whatever raises ValueError makes the packet unreadable.
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from functools import lru_cache
from typing import Any

from formation.maths.arrays import Quat, Vec3
from formation.maths.frames import IDENTITY
from wire import link_messages as m
from wire.link_messages import Address, AttitudeSetpoint, Ignore
from wire.mavlink.axes import (
    Quadruple,
    Triple,
    euler_ned_from_frd,
    heading_ned,
    lab,
    lab_finite,
    ned,
    q_lab_from_euler,
    q_lab_from_flu,
    q_ned_from_frd,
)
from wire.mavlink.framing import Fields, Layout, MavlinkError, layout
from wire.mavlink.text import STATUSTEXT, read_chunk
from wire.text import plain

UNKNOWN_COVARIANCE = (math.nan, *(0.0,) * 20)
"""One whose first element is NaN is unknown, says MAVLink; the rest stays zero and costs no bytes."""
_ACCELEROMETER, _GYROSCOPE = 0x07, 0x38
"""Bits of HIGHRES_IMU_UPDATED_FLAGS."""
_HEADING_UNKNOWN, _NO_CELL = 65535, 65535
_MOST_16, _MOST_32 = 2**15 - 1, 2**31 - 1
_NO_ATTITUDE, _NO_THRUST = int(Ignore.ATTITUDE), int(Ignore.THRUST)  # plain, for every packet
_PARAM_NAME = re.compile(r"[A-Za-z0-9_]{1,16}")

RAW = "param_value"
"""The value in PARAM_VALUE and PARAM_SET. An integer in PX4's bytes may be a signalling NaN, which a float would
quieten: kept as bytes, `raw` in ours."""

Written = tuple[Layout, Fields]
Read = Callable[[Fields], Any]
Write = Callable[[Any], Written]


@dataclass(frozen=True, slots=True)
class Part:
    """A field of a message of ours, of `width` of MAVLink's fields.

    read: our value, of so many arguments; None: the field, or a tuple of several. write: the other way round, one field
    or a tuple of several; None: they are our value. bits: of ours that are sent. sent: fields that are sent as these,
    and not read.
    """

    width: int = 1
    read: Callable[..., Any] | None = None
    write: Callable[[Any], Any] | None = None
    bits: int | None = None
    sent: Fields | None = None


@dataclass(frozen=True, slots=True)
class Row:
    """One message of MAVLink, which of ours it is, and how it is read and, where it ever is, written."""

    layout: Layout
    kind: type[Any]
    read: Read
    write: Write | None


def row(name_: str, kind_: type[Any], /, *, extension: str = "", **parts: Part) -> Row:
    """The row of a message whose parts stand for themselves, in the order of MAVLink's documentation.

    parts: by our fields' names; those whose names begin with `_` are MAVLink's alone. extension: see `layout`.
    """
    width, raw = sum(part.width for part in parts.values()), RAW if "raw" in parts else ""
    form = layout(name_, width, raw=raw, extension=extension)
    names: dict[str, Any] = {"kind": kind_, "form": form}
    reads: dict[str, str] = {}
    writes: list[str] = []
    at = 0
    for field, part in parts.items():
        names |= {f"read_{field}": part.read, f"write_{field}": part.write}
        fields, is_one = [f"f[{at + k}]" for k in range(part.width)], part.width == 1
        at += part.width
        if part.sent is not None:
            names[f"sent_{field}"] = part.sent
            writes += [f"sent_{field}[0]"] if is_one else [f"*sent_{field}"]
            continue
        if part.write is not None:
            writes.append(f"{'' if is_one else '*'}write_{field}(m.{field})")
        elif part.bits is not None:
            writes.append(f"m.{field} & {part.bits}")
        else:
            writes += [f"m.{field}"] if is_one else [f"m.{field}[{k}]" for k in range(part.width)]
        if part.read is not None:
            reads[field] = f"read_{field}({', '.join(fields)})"
        else:
            reads[field] = fields[0] if is_one else f"f[{at - part.width}:{at}]"
    ours = [reads[field] for field in kind_.__match_args__[: len(reads)]]
    # As one expression, as `namedtuple` makes its constructor: every packet is read by it, and a loop costs a quarter.
    read = eval(f"lambda f: kind({', '.join(ours)})", names)
    write = eval(f"lambda m: (form, ({', '.join(writes)},))", names)
    return Row(form, kind_, read, write)


def enumeration(kind: type[IntEnum] | type[IntFlag]) -> Part:
    """One of MAVLink's enumerations; ValueError for a number that is none of ours."""
    return Part(1, kind, int)


def zeros(width: int = 1) -> Part:
    """Fields that nobody here uses."""
    return Part(width, sent=(0,) * width)


def counts(scale: float, unknown: int) -> Part:
    """A whole number, `scale` of them in one of ours; NaN is sent and read as `unknown`."""
    return Part(1, lambda value: _read_count(value, scale, unknown), lambda value: _count(value, scale, unknown))


def _read_count(value: int, scale: float, unknown: int) -> float:
    return math.nan if value == unknown else value / scale


def _count(value: float, scale: float, unknown: int) -> int:
    return unknown if math.isnan(value) else round(value * scale)


def text(size: int) -> Part:
    """A text of at most so many bytes, ended by a zero where it is shorter."""
    return Part(1, _text, lambda value: _characters(value, size))


def _text(field: bytes) -> str:
    return plain(field.partition(b"\0")[0].decode(errors="replace"), 16)


def _characters(name: str, size: int) -> bytes:
    field = name.encode(errors="replace")
    if len(field) > size:
        raise MavlinkError(f"{name!r} is longer than the field's {size} bytes")
    return field


def _param_name(field: bytes) -> str:
    name = _text(field)
    if _PARAM_NAME.fullmatch(name) is None:
        raise MavlinkError(f"{name!r} is no parameter's name")
    return name


def _mm(metres: float) -> int:
    """Millimetres in 32 bits, held at their ends."""
    return min(max(round(metres * 1e3), -_MOST_32), _MOST_32)


def _cm_s(vel_lab_m_s: Vec3) -> list[int]:
    """North, east, down in 16 bits: what is faster than 327 m/s reads as 327 m/s, as autopilots send it."""
    return [min(max(round(v * 100.0), -_MOST_16), _MOST_16) for v in ned(vel_lab_m_s)]


def _heading(heading_rad: float | None) -> int:
    if heading_rad is None:
        return _HEADING_UNKNOWN
    return round(math.degrees(heading_ned(heading_rad)) * 100.0) % 36000


def _read_heading(heading: int) -> float | None:
    return None if heading == _HEADING_UNKNOWN else math.remainder(-math.radians(heading * 0.01), 2.0 * math.pi)


def _read_yaw(yaw: float) -> float:
    return math.remainder(-yaw, math.tau) if math.isfinite(yaw) else math.nan


def _position_ignore(mask: int) -> m.PositionIgnore:
    return m.PositionIgnore(mask & int(~m.PositionIgnore.NONE))


def _turned(turn: float) -> float:
    """A turn about up, of one about down, and the other way round."""
    return 0.0 - turn


AS_IS = Part()
MS = Part(bits=0xFFFFFFFF)
"""Milliseconds, in 32 bits."""
ADDRESS = Part(2, Address)
POSITION, VECTOR = Part(3, lab_finite, ned), Part(3, lab, ned)
QUATERNION, EULER = Part(4, q_lab_from_flu, q_ned_from_frd), Part(3, q_lab_from_euler, euler_ned_from_frd)
DEGREES = Part(1, lambda value: value * 1e-7, lambda value: round(value * 1e7))
MM = Part(1, lambda value: value * 1e-3, _mm)
CM_S = Part(3, lambda x, y, z: lab(x * 0.01, y * 0.01, z * 0.01), _cm_s)
PER_MILLE = Part(1, lambda value: value * 1e-3, lambda value: round(value * 1e3))
UNKNOWN_POSE = Part(21, sent=UNKNOWN_COVARIANCE)

_ignore = lru_cache(maxsize=256)(Ignore)
SET_ATTITUDE_TARGET = layout("SET_ATTITUDE_TARGET", 12)
ATTITUDE_TARGET = layout("ATTITUDE_TARGET", 10)
ODOMETRY = layout("ODOMETRY", 61)
HIGHRES_IMU = layout("HIGHRES_IMU", 15)  # without the number of the sensor: autopilots send the one they fly by
BATTERY_STATUS = layout("BATTERY_STATUS", 26)
EKF_STATUS_REPORT, ESTIMATOR_STATUS = layout("EKF_STATUS_REPORT", 7), layout("ESTIMATOR_STATUS", 10)


def _write_setpoint(s: AttitudeSetpoint) -> Written:
    target, rate, q = s.target, ned(s.rate_flu_rad_s), q_ned_from_frd(s.q_lab_from_flu)
    head = (s.t_boot_ms & 0xFFFFFFFF, target.system, target.component, int(s.ignore))
    return SET_ATTITUDE_TARGET, (*head, *q, *rate, s.thrust_norm)


def _read_setpoint(f: Fields) -> AttitudeSetpoint:
    t_boot_ms, system, component, mask, w, x, y, z, p, q, r, thrust = f
    attitude, rate, thrust = _demand(mask, (w, x, y, z), (p, q, r), thrust)
    return AttitudeSetpoint(Address(system, component), t_boot_ms, attitude, lab(*rate), thrust, _ignore(mask))


def _write_attitude_target(t: m.AttitudeTargetReport) -> Written:
    fields = (*q_ned_from_frd(t.q_lab_from_flu), *ned(t.rate_flu_rad_s), t.thrust_norm)
    return ATTITUDE_TARGET, (t.t_boot_ms & 0xFFFFFFFF, int(t.ignore), *fields)


def _read_attitude_target(f: Fields) -> m.AttitudeTargetReport:
    t_boot_ms, mask, w, x, y, z, p, q, r, thrust = f
    attitude, rate, thrust = _demand(mask, (w, x, y, z), (p, q, r), thrust)
    return m.AttitudeTargetReport(t_boot_ms, attitude, lab(*rate), thrust, _ignore(mask))


def _demand(mask: int, q: Quadruple, rate: Triple, thrust: float) -> tuple[Quat, Triple, float]:
    """The demand of a setpoint: an ignored part reads as identity or zero, one that counts must be finite."""
    attitude = IDENTITY.copy() if mask & _NO_ATTITUDE else q_lab_from_flu(*q)
    p, q_, r = rate
    rate = (0.0 if mask & 1 else p, 0.0 if mask & 2 else q_, 0.0 if mask & 4 else r)
    if mask & _NO_THRUST:
        thrust = 0.0
    if not math.isfinite(rate[0] + rate[1] + rate[2] + thrust):
        raise MavlinkError("a setpoint that is not finite")
    return attitude, rate, thrust


def _write_odometry(o: m.Odometry) -> Written:
    pose = (*ned(o.pos_lab_m), *q_ned_from_frd(o.q_lab_from_flu))
    rates = (*ned(o.vel_flu_m_s), *ned(o.rate_flu_rad_s))
    tail = (*UNKNOWN_COVARIANCE, *UNKNOWN_COVARIANCE, o.reset_counter, int(o.estimator), 0)
    return ODOMETRY, (o.t_us, int(o.frame), int(m.MavFrame.BODY_FRD), *pose, *rates, *tail)


def _read_odometry(f: Fields) -> m.Odometry | m.UnknownMessage:
    """Unknown where the velocity is not in BODY_FRD, as in PX4's own telemetry: nobody here reads that."""
    if f[2] != m.MavFrame.BODY_FRD:
        return m.UnknownMessage(ODOMETRY.id)
    return m.Odometry(
        t_us=f[0],
        frame=m.OdometryFrame(f[1]),
        estimator=m.EstimatorType(f[59]),
        pos_lab_m=lab_finite(*f[3:6]),
        q_lab_from_flu=q_lab_from_flu(*f[6:10]),
        vel_flu_m_s=lab(*f[10:13]),
        rate_flu_rad_s=lab(*f[13:16]),
        reset_counter=f[58],
    )


def _write_inertial(s: m.InertialSample) -> Written:
    force, rate = ned(s.specific_force_flu_m_s2), ned(s.rate_flu_rad_s)
    updated = _ACCELEROMETER | _GYROSCOPE
    if math.isnan(rate[0] + rate[1] + rate[2]):
        updated, rate = _ACCELEROMETER, (0.0, 0.0, 0.0)
    return HIGHRES_IMU, (s.t_boot_us, *force, *rate, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, updated)


def _read_inertial(f: Fields) -> m.InertialSample | m.UnknownMessage:
    """Unknown where the accelerometer has nothing to say."""
    if f[14] & _ACCELEROMETER != _ACCELEROMETER:
        return m.UnknownMessage(HIGHRES_IMU.id)
    rate = f[4:7] if f[14] & _GYROSCOPE == _GYROSCOPE else (math.nan, math.nan, math.nan)
    return m.InertialSample(f[0], lab_finite(*f[1:4]), lab(*rate))


def _write_battery(b: m.Battery) -> Written:
    cells = [_count(v, 1e3, _NO_CELL) for v in b.cell_v]
    first = (*cells[:10], *(_NO_CELL,) * (10 - len(cells)))
    more = (*cells[10:], *(0,) * (4 - max(0, len(cells) - 10)))
    used = (_count(b.current_a, 1e2, -1), _count(b.consumed_mah, 1.0, -1), -1)
    kind = (0, 1, 1, 32767)  # the first, for all systems, LiPo, of an unknown temperature
    return BATTERY_STATUS, (*kind, *first, *used, _count(b.remaining, 1e2, -1), 0, 0, *more, 0, 0)


def _read_battery(f: Fields) -> m.Battery | m.UnknownMessage:
    """Of the first battery alone, where it is one to fly by: of another's charge nothing follows for the flight."""
    if f[0] != 0 or f[1] in (3, 4):  # MAV_BATTERY_FUNCTION_AVIONICS, _PAYLOAD
        return m.UnknownMessage(BATTERY_STATUS.id)
    cells = [v * 1e-3 for v in f[4:14] if v != _NO_CELL] + [v * 1e-3 for v in f[20:24] if v]
    used = (_read_count(f[14], 1e2, -1), _read_count(f[15], 1.0, -1))
    return m.Battery(tuple(cells), *used, _read_count(f[17], 1e2, -1))


def _write_ekf(e: m.EkfStatus) -> Written:
    if e.ardupilot:
        return EKF_STATUS_REPORT, (e.flags, *(0.0,) * 6)
    ratios = (0.0, e.pos_horiz_ratio, e.pos_vert_ratio, 0.0, 0.0, 0.0)
    return ESTIMATOR_STATUS, (e.t_us, e.flags, *ratios, e.pos_horiz_accuracy_m, e.pos_vert_accuracy_m)


def _read_estimator(f: Fields) -> m.EkfStatus:
    return m.EkfStatus(f[1], False, f[0], f[3], f[4], f[8], f[9])


TABLE = (
    row("HEARTBEAT", m.Heartbeat, vehicle_type=AS_IS, autopilot=enumeration(m.MavAutopilot), base_mode=AS_IS,
        custom_mode=AS_IS, system_status=AS_IS, _mavlink_version=Part(1, sent=(3,))),
    row("SYS_STATUS", m.SysStatus, sensors_present=AS_IS, sensors_enabled=AS_IS, sensors_healthy=AS_IS, load=PER_MILLE,
        battery_v=counts(1e3, 65535), battery_a=counts(1e2, -1), battery_remaining=counts(1e2, -1),
        drop_rate=counts(1e4, 65535), _errors=zeros(8)),
    row("SYSTEM_TIME", m.SystemTime, t_unix_us=AS_IS, t_boot_ms=MS),
    row("PING", m.Ping, t_us=AS_IS, seq=AS_IS, target=ADDRESS),
    row("SET_MODE", m.SetMode, target_system=AS_IS, base_mode=AS_IS, custom_mode=AS_IS),
    row("PARAM_REQUEST_READ", m.ParamRequestRead, target=ADDRESS, name=text(16), index=AS_IS),
    row("PARAM_REQUEST_LIST", m.ParamRequestList, target=ADDRESS),
    row("PARAM_VALUE", m.ParamValue, name=Part(1, _param_name, lambda name: _characters(name, 16)), raw=AS_IS,
        type=enumeration(m.ParamType), count=AS_IS, index=AS_IS),
    row("PARAM_SET", m.ParamSet, target=ADDRESS, name=text(16), raw=AS_IS, type=enumeration(m.ParamType)),
    row("ATTITUDE", m.Attitude, t_boot_ms=MS, q_lab_from_flu=EULER, rate_flu_rad_s=VECTOR),
    row("ATTITUDE_QUATERNION", m.AttitudeQuaternion, t_boot_ms=MS, q_lab_from_flu=QUATERNION, rate_flu_rad_s=VECTOR,
        _repr_offset=zeros(4)),
    row("LOCAL_POSITION_NED", m.LocalPosition, t_boot_ms=MS, pos_lab_m=POSITION, vel_lab_m_s=VECTOR),
    row("GLOBAL_POSITION_INT", m.GlobalPosition, t_boot_ms=MS, lat_deg=DEGREES, lon_deg=DEGREES, alt_m=MM, height_m=MM,
        vel_lab_m_s=CM_S, heading_rad=Part(1, _read_heading, _heading)),
    row("MISSION_REQUEST_LIST", m.MissionRequestList, target=ADDRESS, kind=AS_IS),
    row("MISSION_COUNT", m.MissionCount, target=ADDRESS, count=AS_IS, kind=AS_IS),
    row("SET_GPS_GLOBAL_ORIGIN", m.SetOrigin, target_system=AS_IS, lat_deg=DEGREES, lon_deg=DEGREES, alt_m=MM,
        _time=zeros()),
    row("GPS_GLOBAL_ORIGIN", m.Origin, lat_deg=DEGREES, lon_deg=DEGREES, alt_m=MM, _time=zeros()),
    row("COMMAND_INT", m.CommandInt, target=ADDRESS, frame=AS_IS, command=AS_IS, _mission=zeros(2), params=Part(4),
        x=AS_IS, y=AS_IS, z=AS_IS),
    row("COMMAND_LONG", m.CommandLong, target=ADDRESS, command=AS_IS, confirmation=AS_IS, params=Part(7)),
    row("COMMAND_ACK", m.CommandAck, command=AS_IS, result=enumeration(m.Result), progress=AS_IS, _param2=zeros(),
        target=ADDRESS),
    Row(SET_ATTITUDE_TARGET, AttitudeSetpoint, _read_setpoint, _write_setpoint),
    Row(ATTITUDE_TARGET, m.AttitudeTargetReport, _read_attitude_target, _write_attitude_target),
    row("SET_POSITION_TARGET_LOCAL_NED", m.PositionSetpoint, t_boot_ms=MS, target=ADDRESS,
        frame=enumeration(m.LocalFrame), ignore=Part(1, _position_ignore, int), pos_m=VECTOR, vel_m_s=VECTOR,
        acc_m_s2=VECTOR, yaw_rad=Part(1, _read_yaw, _turned), yaw_rate_rad_s=Part(1, _turned, _turned)),
    row("VISION_POSITION_ESTIMATE", m.VisionPose, t_us=AS_IS, pos_lab_m=POSITION, q_lab_from_flu=EULER,
        _covariance=UNKNOWN_POSE, _reset_counter=zeros()),
    Row(HIGHRES_IMU, m.InertialSample, _read_inertial, _write_inertial),
    row("TIMESYNC", m.TimeSync, extension="BB", tc1_ns=AS_IS, ts1_ns=AS_IS, target=ADDRESS),
    row("HIL_STATE_QUATERNION", m.SimTruth, t_us=AS_IS, q_lab_from_flu=QUATERNION, _rates=zeros(3), lat_deg=DEGREES,
        lon_deg=DEGREES, alt_m=MM, vel_lab_m_s=CM_S, _air=zeros(5)),
    row("LOG_REQUEST_LIST", m.LogRequestList, target=ADDRESS, first=AS_IS, last=AS_IS),
    row("LOG_ENTRY", m.LogEntry, id=AS_IS, count=AS_IS, last=AS_IS, t_unix_s=AS_IS, size_bytes=AS_IS),
    row("ATT_POS_MOCAP", m.MocapPose, t_us=AS_IS, q_lab_from_flu=QUATERNION, pos_lab_m=POSITION,
        _covariance=UNKNOWN_POSE),
    Row(BATTERY_STATUS, m.Battery, _read_battery, _write_battery),
    row("AUTOPILOT_VERSION", m.AutopilotVersion, capabilities=AS_IS, flight_sw_version=AS_IS, _others=zeros(29),
        uid=AS_IS, _uid2=zeros(18)),
    Row(EKF_STATUS_REPORT, m.EkfStatus, lambda f: m.EkfStatus(f[0], ardupilot=True), _write_ekf),
    Row(ESTIMATOR_STATUS, m.EkfStatus, _read_estimator, _write_ekf),
    row("HOME_POSITION", m.HomePosition, lat_deg=DEGREES, lon_deg=DEGREES, alt_m=MM, pos_lab_m=VECTOR,
        _q=Part(4, sent=(1.0, 0.0, 0.0, 0.0)), _approach=zeros(4)),
    row("MESSAGE_INTERVAL", m.MessageInterval, message_id=AS_IS, interval_us=AS_IS),
    row("EXTENDED_SYS_STATE", m.ExtendedSysState, _vtol_state=zeros(), landed=enumeration(m.LandedState)),
    row("NAMED_VALUE_FLOAT", m.NamedValue, t_boot_ms=MS, name=text(10), value=AS_IS),
    Row(STATUSTEXT, m.StatusText, read_chunk, None),
    Row(ODOMETRY, m.Odometry, _read_odometry, _write_odometry),
)  # fmt: skip
"""Every message that is read or written, by its number."""

READERS = {each.layout.id: (each.layout, each.read) for each in TABLE}
WRITERS = {each.kind: each.write for each in TABLE if each.write is not None}
