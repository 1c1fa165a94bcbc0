"""Clocks and round trips."""

from dataclasses import dataclass

from wire.link_messages.address import EVERYONE, Address


@dataclass(frozen=True, slots=True)
class TimeSync:
    """TIMESYNC (111): ts1 is the sender's stamp, tc1 zero in a request."""

    tc1_ns: int
    ts1_ns: int
    target: Address = EVERYONE


@dataclass(frozen=True, slots=True)
class Ping:
    """PING (4)."""

    t_us: int
    seq: int
    target: Address


@dataclass(frozen=True, slots=True)
class SystemTime:
    """SYSTEM_TIME (2)."""

    t_unix_us: int
    t_boot_ms: int
