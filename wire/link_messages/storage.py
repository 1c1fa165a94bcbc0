"""Missions and logs on board, as far as a ground station asks every vehicle for them."""

from dataclasses import dataclass

from wire.link_messages.address import Address


@dataclass(frozen=True, slots=True)
class MissionRequestList:
    """MISSION_REQUEST_LIST (43); `kind` is MAV_MISSION_TYPE: mission, fence or rally points."""

    target: Address
    kind: int


@dataclass(frozen=True, slots=True)
class MissionCount:
    """MISSION_COUNT (44)."""

    target: Address
    count: int
    kind: int


@dataclass(frozen=True, slots=True)
class LogRequestList:
    """LOG_REQUEST_LIST (117)."""

    target: Address
    first: int
    last: int


@dataclass(frozen=True, slots=True)
class LogEntry:
    """LOG_ENTRY (118)."""

    id: int
    count: int
    last: int
    t_unix_s: int
    size_bytes: int
