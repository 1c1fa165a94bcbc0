"""Clocks and round trips."""

from typing import NamedTuple

from wire.link_messages.address import EVERYONE, Address


class TimeSync(NamedTuple):
    """TIMESYNC (111): ts1 is the sender's stamp, tc1 zero in a request."""

    tc1_ns: int
    ts1_ns: int
    target: Address = EVERYONE


class Ping(NamedTuple):
    """PING (4)."""

    t_us: int
    seq: int
    target: Address


class SystemTime(NamedTuple):
    """SYSTEM_TIME (2)."""

    t_unix_us: int
    t_boot_ms: int
