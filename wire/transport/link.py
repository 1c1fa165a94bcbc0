"""What every link to drones offers, whatever carries it: MAVLink bytes by drone, and counters."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from formation.messages import Datagram

LARGEST_DATAGRAM = 2048
"""Bytes; no MAVLink sender sends more at once, and a larger datagram is rejected unread."""

PAUSE_S = 0.002
"""How long a drone waits, of which more had arrived than one turn takes, while everybody else has theirs."""

# Called on the event loop, once a datagram, in the order of arrival.
Deliver = Callable[[Datagram], None]


@dataclass(slots=True)
class LinkCounters:
    """Datagrams sent, received, dropped here (a full queue or socket buffer), and rejected unread.

    superseded: packets of telemetry that were dropped since newer ones of their stream had arrived.
    """

    sent: int = 0
    received: int = 0
    dropped: int = 0
    rejected: int = 0
    superseded: int = 0


class Link(Protocol):
    """An open link to one or more drones, or from one drone to its ground."""

    @property
    def counters(self) -> LinkCounters:
        """The counters, live."""
        ...

    def send(self, datagram: Datagram) -> None:
        """Hand the bytes over, to the drone `sysid` or, at the drone, as its own; never waits, may drop."""
        ...

    def close(self) -> None:
        """Stop; nothing is delivered afterwards."""
        ...
