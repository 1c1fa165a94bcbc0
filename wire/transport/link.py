"""The interface of every link to drones, and one drone's intake: read to the newest, within a bound.

Telemetry that a newer message of the same stream replaces is dropped undelivered, so that a process which gets its
turn late goes on with what is new. Commands, acknowledgements, parameters, texts, inertial samples and everything
unknown keep their order and are never replaced. The bound is on work, not on count: a turn ends when delivering has
cost TURN_NS of CPU time, however long the machine took for it; the rest waits, and becomes newer meanwhile.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from formation.messages import Datagram
from wire import clock
from wire.link_messages import MessageId

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


TURN_NS = 1_000_000
"""CPU time of one turn: some 60 messages."""
BACKLOG_MAX = 512
"""Datagrams that may wait for a turn, the oldest lost beyond: a second of what a PX4 sends by default."""
READS_A_TURN = 256
"""Datagrams read from a socket at once: as many as a kernel's buffer of the default size (208 KiB) holds."""
SUPERSEDED = frozenset(
    {
        MessageId.HEARTBEAT,
        MessageId.SYS_STATUS,
        MessageId.EXTENDED_SYS_STATE,
        MessageId.ESTIMATOR_STATUS,
        MessageId.EKF_STATUS_REPORT,
        MessageId.HOME_POSITION,
        MessageId.ATTITUDE,
        MessageId.ATTITUDE_QUATERNION,
        MessageId.LOCAL_POSITION_NED,
        MessageId.GLOBAL_POSITION_INT,
        MessageId.SERVO_OUTPUT_RAW,
        MessageId.VFR_HUD,
        MessageId.ATTITUDE_TARGET,
        MessageId.POSITION_TARGET_LOCAL_NED,
        MessageId.DISTANCE_SENSOR,
        MessageId.ALTITUDE,
        MessageId.ODOMETRY,
        MessageId.NAMED_VALUE_FLOAT,
    }
)
"""Streams of which the newest message says all: states, not events and not sums. Of named values, of each name."""

_Stream = tuple[int, int, int, bytes]


def newest(backlog: Sequence[tuple[bytes, int]]) -> list[tuple[bytes, int]]:
    """The datagrams to deliver, in order, each with how many packets before it were superseded and dropped.

    backlog: the same of all that has arrived. A datagram is dropped where each of its packets belongs to a stream of
    SUPERSEDED of which a later one has a packet.
    """
    later: set[_Stream] = set()
    current: list[tuple[bytes, int]] = []
    for data, before in reversed(backlog):
        streams = _streams(data)
        if streams is None or not later.issuperset(streams):
            current.append((data, before))
            later.update(streams or ())
        else:  # its streams have a later packet, so something is kept
            current[-1] = (current[-1][0], current[-1][1] + len(streams) + before)
    current.reverse()
    return current


def _streams(data: bytes) -> list[_Stream] | None:
    """System, component, message id and name of each packet, by its bytes; None where one of them may not be lost."""
    streams: list[_Stream] = []
    at, end = 0, len(data)
    while at < end:
        if end - at < 12 or data[at] != 0xFD:
            return None
        number = data[at + 7] | data[at + 8] << 8 | data[at + 9] << 16
        if number not in SUPERSEDED:
            return None
        # The name of a NAMED_VALUE_FLOAT is behind the head, a time and a value.
        name = data[at + 18 : at + 10 + data[at + 1]] if number == MessageId.NAMED_VALUE_FLOAT else b""
        streams.append((data[at + 5], data[at + 6], number, name))
        at += 12 + data[at + 1] + (13 if data[at + 2] & 1 else 0)
    return streams if streams and at == end else None


class Backlog:
    """The waiting datagrams of one drone: `enqueue` on arrival, `dequeue` a turn at a time. No loop, no clock."""

    def __init__(self, sysid: int, counters: LinkCounters) -> None:
        """counters: counts dropped datagrams and superseded packets; the caller of `enqueue` counts received ones."""
        self._sysid = sysid
        self._counters = counters
        self._datagrams: deque[tuple[bytes, int]] = deque(maxlen=BACKLOG_MAX)

    def __len__(self) -> int:
        """How many datagrams wait."""
        return len(self._datagrams)

    def enqueue(self, data: bytes, superseded: int = 0) -> None:
        """A datagram has arrived; superseded: packets before it that were dropped on the way."""
        if len(self._datagrams) == BACKLOG_MAX:
            self._counters.dropped += 1
        self._datagrams.append((data, superseded))

    def dequeue(self) -> Iterator[Datagram]:
        """The datagrams to deliver, in order, until the caller stops; the rest waits for the next turn."""
        if len(self._datagrams) > 1:
            self._datagrams = deque(newest(self._datagrams), BACKLOG_MAX)
        while self._datagrams:
            data, superseded = self._datagrams.popleft()
            self._counters.superseded += superseded
            yield Datagram(self._sysid, data, superseded)

    def clear(self) -> None:
        """Drop all waiting datagrams."""
        self._datagrams.clear()


class Intake:
    """One drone's intake: `enqueue` on arrival; the event loop delivers, a turn at a time."""

    def __init__(self, sysid: int, deliver: Deliver, counters: LinkCounters) -> None:
        """counters: as a Backlog counts there."""
        self._deliver = deliver
        self._backlog = Backlog(sysid, counters)
        self._loop = asyncio.get_running_loop()
        self._scheduled: asyncio.Handle | None = None

    def enqueue(self, data: bytes) -> None:
        """A datagram has arrived; on the event loop."""
        self._backlog.enqueue(data)
        if self._scheduled is None:
            self._scheduled = self._loop.call_soon(self._turn)

    def close(self) -> None:
        """Deliver nothing more."""
        self._backlog.clear()
        if self._scheduled is not None:
            self._scheduled.cancel()

    def _turn(self) -> None:
        self._scheduled = None
        began_ns = clock.cpu_ns()
        for datagram in self._backlog.dequeue():
            self._deliver(datagram)
            if clock.cpu_ns() - began_ns >= TURN_NS:
                break
        if self._backlog:  # everybody else's turn comes first
            self._scheduled = self._loop.call_later(PAUSE_S, self._turn)
