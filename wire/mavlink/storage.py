"""Messages that list what an autopilot stores, missions and logs, to and from MAVLink fields; see mavlink_motion."""

from collections.abc import Callable, Mapping
from typing import Any

from wire.link_messages import Address, LogEntry, LogRequestList, MissionCount, MissionRequestList
from wire.mavlink.framing import Fields, Layout, layout
from wire.mavlink.motion import Written

MISSION_REQUEST_LIST = layout("MISSION_REQUEST_LIST", 3)
MISSION_COUNT = layout("MISSION_COUNT", 4)
LOG_REQUEST_LIST = layout("LOG_REQUEST_LIST", 4)
LOG_ENTRY = layout("LOG_ENTRY", 5)


def _write_mission_request(m: MissionRequestList) -> Written:
    return MISSION_REQUEST_LIST, (m.target.system, m.target.component, m.kind)


def _write_mission_count(m: MissionCount) -> Written:
    return MISSION_COUNT, (m.target.system, m.target.component, m.count, m.kind)


def _write_log_request(m: LogRequestList) -> Written:
    return LOG_REQUEST_LIST, (m.target.system, m.target.component, m.first, m.last)


def _write_log_entry(m: LogEntry) -> Written:
    return LOG_ENTRY, (m.id, m.count, m.last, m.t_unix_s, m.size_bytes)


WRITERS: Mapping[type, Callable[[Any], Written]] = {
    MissionRequestList: _write_mission_request,
    MissionCount: _write_mission_count,
    LogRequestList: _write_log_request,
    LogEntry: _write_log_entry,
}
READERS: Mapping[Layout, Callable[[Fields], Any]] = {
    MISSION_REQUEST_LIST: lambda f: MissionRequestList(Address(f[0], f[1]), f[2]),
    MISSION_COUNT: lambda f: MissionCount(Address(f[0], f[1]), f[2], f[3]),
    LOG_REQUEST_LIST: lambda f: LogRequestList(Address(f[0], f[1]), f[2], f[3]),
    LOG_ENTRY: lambda f: LogEntry(*f),
}
