"""What has arrived from one drone and is not delivered yet: read to the newest, within a bound on work.

Telemetry that a newer message of the same stream replaces is dropped undelivered, so that a process which gets its
turn late goes on with what is new. Commands, acknowledgements, parameters, texts, inertial samples and everything
unknown keep their order and are never replaced. The bound is on work, not on count: a turn ends when delivering has
cost TURN_NS of CPU time, however long the machine took for it; the rest waits, and becomes newer meanwhile.
"""

import asyncio
from collections import deque
from collections.abc import Sequence

from formation.messages import Datagram
from wire import clock
from wire.link_messages.message_id import MessageId
from wire.transport.link import PAUSE_S, Deliver, LinkCounters

TURN_NS = 1_000_000
"""CPU time of one turn: some 60 messages."""
WAITING_MOST = 512
"""Datagrams that may wait for a turn, the oldest lost beyond: a second of what a PX4 sends by default."""
READS_A_TURN = 256
"""Datagrams read from a socket at once: as many as a kernel's buffer of the default size (208 KiB) holds."""
SUPERSEDED = frozenset(
    {
        MessageId.ATTITUDE,
        MessageId.ATTITUDE_QUATERNION,
        MessageId.LOCAL_POSITION_NED,
        MessageId.GLOBAL_POSITION_INT,
        MessageId.SERVO_OUTPUT_RAW,
        MessageId.VFR_HUD,
        MessageId.ATTITUDE_TARGET,
        MessageId.POSITION_TARGET_LOCAL_NED,
        MessageId.SIM_STATE,
        MessageId.HIL_STATE_QUATERNION,
        MessageId.DISTANCE_SENSOR,
        MessageId.ALTITUDE,
        MessageId.ODOMETRY,
    }
)
"""Streams of which the newest message says all: states, not events and not sums."""

_Stream = tuple[int, int, int]


def newest(waiting: Sequence[tuple[bytes, int]]) -> list[tuple[bytes, int]]:
    """The datagrams to deliver, in order, each with how many packets before it were superseded and dropped.

    waiting: the same of all that has arrived. A datagram is dropped where each of its packets belongs to a stream of
    SUPERSEDED of which a later one has a packet.
    """
    later: set[_Stream] = set()
    kept: list[tuple[bytes, int]] = []
    for data, before in reversed(waiting):
        streams = _streams(data)
        if streams is None or not later.issuperset(streams):
            kept.append((data, before))
            later.update(streams or ())
        else:  # its streams have a later packet, so something is kept
            kept[-1] = (kept[-1][0], kept[-1][1] + len(streams) + before)
    kept.reverse()
    return kept


def _streams(data: bytes) -> list[_Stream] | None:
    """System, component and message id of each packet, by their heads alone; None where one of them may not be lost."""
    streams: list[_Stream] = []
    at, end = 0, len(data)
    while at < end:
        if end - at < 12 or data[at] != 0xFD:
            return None
        number = data[at + 7] | data[at + 8] << 8 | data[at + 9] << 16
        if number not in SUPERSEDED:
            return None
        streams.append((data[at + 5], data[at + 6], number))
        at += 12 + data[at + 1] + (13 if data[at + 2] & 1 else 0)
    return streams if streams and at == end else None


class Intake:
    """One drone's: `put` what arrives; it is delivered from the event loop, a turn at a time."""

    def __init__(self, sysid: int, deliver: Deliver, counters: LinkCounters) -> None:
        """counters: dropped is counted there in datagrams, superseded in packets; who puts counts what is received."""
        self._sysid = sysid
        self._deliver = deliver
        self._counters = counters
        self._waiting: deque[tuple[bytes, int]] = deque(maxlen=WAITING_MOST)
        self._loop = asyncio.get_running_loop()
        self._scheduled: asyncio.Handle | None = None

    def put(self, data: bytes) -> None:
        """A datagram has arrived; on the event loop."""
        if len(self._waiting) == WAITING_MOST:
            self._counters.dropped += 1
        self._waiting.append((data, 0))
        if self._scheduled is None:
            self._scheduled = self._loop.call_soon(self._turn)

    def close(self) -> None:
        """Deliver nothing more."""
        self._waiting.clear()
        if self._scheduled is not None:
            self._scheduled.cancel()

    def _turn(self) -> None:
        self._scheduled = None
        began_ns = clock.cpu_ns()
        if len(self._waiting) > 1:
            self._waiting = deque(newest(self._waiting), WAITING_MOST)
        while self._waiting:
            data, superseded = self._waiting.popleft()
            self._counters.superseded += superseded
            self._deliver(Datagram(self._sysid, data, superseded))
            if clock.cpu_ns() - began_ns >= TURN_NS:
                break
        if self._waiting:  # everybody else's turn comes first
            self._scheduled = self._loop.call_later(PAUSE_S, self._turn)
