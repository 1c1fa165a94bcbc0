"""What the agent tells about itself: one builder for each message id it can send."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drone_agent.autopilots.personality import Task
from drone_agent.config import AgentConfig
from drone_agent.flight.autopilot import Autopilot
from drone_agent.flight.estimator import NO_OFFSET, turned
from drone_agent.geodesy import to_globe
from formation.maths.arrays import Vec3
from wire.link_messages.clocks import TimeSync
from wire.link_messages.motion import (
    Attitude,
    AttitudeQuaternion,
    GlobalPosition,
    HomePosition,
    LocalPosition,
    Origin,
    SimTruth,
)
from wire.link_messages.packet import LinkMessage
from wire.link_messages.setpoints import AttitudeTargetReport, Ignore
from wire.link_messages.status import (
    ARMED,
    AutopilotVersion,
    Battery,
    EkfStatus,
    ExtendedSysState,
    Heartbeat,
    LandedState,
    NamedValue,
    SysStatus,
)
from wire.link_messages.status import Autopilot as Make

_GYRO, _ACCEL, _MAG, _BARO, _GPS, _VISION = 1, 2, 4, 8, 32, 128
_CONTROL = 1024 | 2048 | 4096 | 8192 | 16384 | 32768  # rates, attitude, yaw, height, position, motors
_AHRS, _BATTERY, _PREARM = 1 << 21, 1 << 25, 1 << 28
_LOAD = 0.2
AGE = 251
"""NAMED_VALUE_FLOAT: the age of the newest setpoint."""


@dataclass(frozen=True, slots=True)
class Teller:
    """Builds telemetry from the autopilot's state at `now_ns`; `builders` are by MAVLink message id."""

    config: AgentConfig
    autopilot: Autopilot
    t0_ns: int

    def build(self, number: int, now_ns: int) -> LinkMessage | None:
        """The message of that id, or None if there is none to tell now."""
        return _BUILDERS[number](self, now_ns)

    def boot_ms(self, now_ns: int) -> int:
        """Time since boot, ms."""
        return (now_ns - self.t0_ns) // 1_000_000


def _heartbeat(t: Teller, now_ns: int) -> LinkMessage:
    pilot = t.autopilot
    make = pilot.personality
    ready = pilot.armed or pilot.arming_fault(now_ns) is None
    status = make.system_status(pilot.armed, pilot.landed, pilot.failsafe, ready)
    base_mode = pilot.row.flags | (ARMED if pilot.armed else 0)
    return Heartbeat(make.autopilot, make.vehicle_type, base_mode, pilot.row.custom_mode, status)


def _sys_status(t: Teller, now_ns: int) -> LinkMessage:
    pilot = t.autopilot
    receiver = _VISION if t.config.pose == "mocap" else _GPS
    present = _GYRO | _ACCEL | _MAG | _BARO | _CONTROL | _AHRS | _BATTERY | _PREARM | receiver
    healthy = present
    if not pilot.positioning.valid(now_ns):
        healthy &= ~receiver
    if not pilot.armed and pilot.arming_fault(now_ns) is not None:
        healthy &= ~_PREARM
    pack = pilot.airframe.pack
    return SysStatus(present, present, healthy, _LOAD, pack.voltage_v, pack.current_a, pack.remaining)


def _attitude(t: Teller, now_ns: int) -> LinkMessage:
    frame = t.autopilot.airframe
    q = turned(frame.estimated_q_lab_from_flu, t.autopilot.positioning.yaw_rad)
    return Attitude(t.boot_ms(now_ns), q, frame.state.rate_flu_rad_s)


def _attitude_quaternion(t: Teller, now_ns: int) -> LinkMessage:
    frame = t.autopilot.airframe
    q = turned(frame.estimated_q_lab_from_flu, t.autopilot.positioning.yaw_rad)
    return AttitudeQuaternion(t.boot_ms(now_ns), q, frame.state.rate_flu_rad_s)


def _local_position(t: Teller, now_ns: int) -> LinkMessage | None:
    pilot = t.autopilot
    if not pilot.positioning.valid(now_ns):
        return None
    offset = pilot.positioning.offset(now_ns)
    if offset is NO_OFFSET:
        state = pilot.airframe.state
        return LocalPosition(t.boot_ms(now_ns), state.pos_lab_m, state.vel_lab_m_s)
    belief = pilot.belief(now_ns)
    return LocalPosition(t.boot_ms(now_ns), np.array(belief.pos_lab_m), np.array(belief.vel_lab_m_s))


def _global_position(t: Teller, now_ns: int) -> LinkMessage | None:
    pilot = t.autopilot
    if pilot.origin is None or not pilot.positioning.valid(now_ns):
        return None
    belief = pilot.belief(now_ns)
    lat, lon, alt = to_globe(pilot.origin, belief.pos_lab_m)
    ground_m = pilot.home.pos_lab_m[2] if pilot.home else t.config.start_lab_m[2]
    vel: Vec3 = np.array(belief.vel_lab_m_s)
    return GlobalPosition(t.boot_ms(now_ns), lat, lon, alt, belief.pos_lab_m[2] - ground_m, vel, belief.yaw_rad)


def _home(t: Teller, now_ns: int) -> LinkMessage | None:
    pilot = t.autopilot
    if pilot.origin is None or not pilot.positioning.valid(now_ns):
        return None
    place = pilot.home.pos_lab_m if pilot.home else t.config.start_lab_m
    lat, lon, alt = to_globe(pilot.origin, place)
    return HomePosition(lat, lon, alt, np.array(place))


def _battery(t: Teller, _now_ns: int) -> LinkMessage:
    pack = t.autopilot.airframe.pack
    return Battery((pack.cell_v,) * pack.profile.cells, pack.current_a, pack.used_mah, pack.remaining)


def _extended(t: Teller, _now_ns: int) -> LinkMessage:
    pilot = t.autopilot
    if pilot.landed:
        return ExtendedSysState(LandedState.ON_GROUND)
    landing = pilot.task in (Task.LAND, Task.DESCEND)
    rising = LandedState.TAKEOFF if pilot.task is Task.TAKEOFF else LandedState.IN_AIR
    return ExtendedSysState(LandedState.LANDING if landing else rising)


def _estimator(t: Teller, now_ns: int) -> LinkMessage:
    pilot = t.autopilot
    placed = pilot.origin is not None or not pilot.personality.needs_origin
    valid = placed and pilot.positioning.valid(now_ns)
    flags = pilot.personality.estimator_flags(valid, pilot.position_fault(now_ns) is None)
    return EkfStatus(flags, t.autopilot.personality.autopilot is Make.ARDUPILOT)


def _target(t: Teller, now_ns: int) -> LinkMessage:
    now = t.autopilot.airframe.setpoint
    q = turned(now.q_lab_from_flu, t.autopilot.positioning.yaw_rad)
    return AttitudeTargetReport(t.boot_ms(now_ns), q, now.rate_flu_rad_s, now.thrust_norm, Ignore.NONE)


def _timesync(t: Teller, now_ns: int) -> LinkMessage:
    return TimeSync(0, now_ns - t.t0_ns)


def _origin(t: Teller, _now_ns: int) -> LinkMessage | None:
    return None if t.autopilot.origin is None else Origin(*t.autopilot.origin)


def _true_state(t: Teller, now_ns: int) -> LinkMessage:
    state = t.autopilot.airframe.state
    x, y, z = state.pos_lab_m.tolist()
    lat, lon, alt = to_globe(t.config.origin, (x, y, z))
    return SimTruth((now_ns - t.t0_ns) // 1000, state.q_lab_from_flu, state.vel_lab_m_s, lat, lon, alt)


def _age(t: Teller, now_ns: int) -> LinkMessage | None:
    age_ms = t.autopilot.take_setpoint_age_ms()
    return None if age_ms is None else NamedValue(t.boot_ms(now_ns), "age_ms", age_ms)


def _version(t: Teller, _now_ns: int) -> LinkMessage:
    make = t.autopilot.personality
    return AutopilotVersion(make.capabilities, make.version, t.config.sysid)


_BUILDERS: dict[int, Callable[[Teller, int], LinkMessage | None]] = {
    0: _heartbeat, 1: _sys_status, 30: _attitude, 31: _attitude_quaternion, 32: _local_position,
    33: _global_position, 49: _origin, 83: _target, 111: _timesync, 115: _true_state, 147: _battery, 148: _version,
    193: _estimator, 230: _estimator, 242: _home, 245: _extended, AGE: _age,
}  # fmt: skip
ON_REQUEST = frozenset({49, 148})
"""Sent when asked for, never at a rate."""
