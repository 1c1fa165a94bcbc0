"""Position setpoints, global origin and message intervals, to and from MAVLink fields; see mavlink_motion for the
form.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any

from wire.link_messages import Address, LocalFrame, MessageInterval, Origin, PositionIgnore, PositionSetpoint, SetOrigin
from wire.mavlink.framing import Fields, Layout, layout
from wire.mavlink.motion import Written, lab, ned

SET_POSITION_TARGET_LOCAL_NED = layout("SET_POSITION_TARGET_LOCAL_NED", 16)
SET_GPS_GLOBAL_ORIGIN = layout("SET_GPS_GLOBAL_ORIGIN", 5)
GPS_GLOBAL_ORIGIN = layout("GPS_GLOBAL_ORIGIN", 4)
MESSAGE_INTERVAL = layout("MESSAGE_INTERVAL", 2)
_MS_32 = 0xFFFFFFFF


def _write_position(m: PositionSetpoint) -> Written:
    head = (m.t_boot_ms & _MS_32, m.target.system, m.target.component, int(m.frame), int(m.ignore))
    vectors = (*ned(m.pos_m), *ned(m.vel_m_s), *ned(m.acc_m_s2))
    return SET_POSITION_TARGET_LOCAL_NED, (*head, *vectors, 0.0 - m.yaw_rad, 0.0 - m.yaw_rate_rad_s)


def _read_position(f: Fields) -> PositionSetpoint:
    return PositionSetpoint(
        target=Address(f[1], f[2]),
        t_boot_ms=f[0],
        frame=LocalFrame(f[3]),
        ignore=PositionIgnore(f[4] & int(~PositionIgnore.NONE)),
        pos_m=lab(*f[5:8]),
        vel_m_s=lab(*f[8:11]),
        acc_m_s2=lab(*f[11:14]),
        yaw_rad=math.remainder(-f[14], math.tau) if math.isfinite(f[14]) else math.nan,
        yaw_rate_rad_s=0.0 - f[15],
    )


def _surface(m: SetOrigin | Origin) -> tuple[int, int, int]:
    return round(m.lat_deg * 1e7), round(m.lon_deg * 1e7), round(m.alt_m * 1e3)


def _write_set_origin(m: SetOrigin) -> Written:
    return SET_GPS_GLOBAL_ORIGIN, (m.target_system, *_surface(m), 0)


def _write_origin(m: Origin) -> Written:
    return GPS_GLOBAL_ORIGIN, (*_surface(m), 0)


WRITERS: Mapping[type, Callable[[Any], Written]] = {
    PositionSetpoint: _write_position,
    SetOrigin: _write_set_origin,
    Origin: _write_origin,
    MessageInterval: lambda m: (MESSAGE_INTERVAL, (m.message_id, m.interval_us)),
}
READERS: Mapping[Layout, Callable[[Fields], Any]] = {
    SET_POSITION_TARGET_LOCAL_NED: _read_position,
    SET_GPS_GLOBAL_ORIGIN: lambda f: SetOrigin(f[0], f[1] * 1e-7, f[2] * 1e-7, f[3] * 1e-3),
    GPS_GLOBAL_ORIGIN: lambda f: Origin(f[0] * 1e-7, f[1] * 1e-7, f[2] * 1e-3),
    MESSAGE_INTERVAL: lambda f: MessageInterval(*f),
}
