"""A drone's intake at the ground in simulated time: wire.transport.link's rule, its work counted instead of timed."""

from collections.abc import Iterator

from formation.messages import Datagram
from wire.mavlink.framing import FrameCutter
from wire.transport.link import PAUSE_S, TURN_NS, Backlog, LinkCounters
from wire.transport.memory_bus import NOTHING_DUE_NS

PAUSE_NS = round(PAUSE_S * 1e9)


class VirtualIntake:
    """`enqueue` what arrives, then `turn`, again at `due_ns`.

    Each packet costs the ground some work, done as simulated time passes. A turn ends when TURN_NS of it are to be
    done; what waits then has its turn when that is done and everybody else had theirs, and becomes newer meanwhile.
    """

    def __init__(self, sysid: int, work_ns: int, counters: LinkCounters) -> None:
        """work_ns: that one packet costs."""
        self._backlog = Backlog(sysid, counters)
        self._work_ns = work_ns
        self._idle_ns = 0
        """When all work is done."""
        self.due_ns = NOTHING_DUE_NS
        """When the next turn of what waits is due."""

    def enqueue(self, datagram: Datagram) -> None:
        """A datagram has arrived."""
        self._backlog.enqueue(datagram.data, datagram.superseded)

    def turn(self, now_ns: int) -> Iterator[Datagram]:
        """What is delivered now; nothing while an earlier turn's work is not done."""
        if self.due_ns > now_ns and self.due_ns != NOTHING_DUE_NS:
            return
        self._idle_ns = max(self._idle_ns, now_ns)
        self.due_ns = NOTHING_DUE_NS
        for datagram in self._backlog.dequeue():
            yield datagram
            self._idle_ns += self._work_ns * max(len(FrameCutter().cut(datagram.data)), 1) if self._work_ns else 0
            if self._idle_ns - now_ns >= TURN_NS:
                self.due_ns = self._idle_ns + PAUSE_NS
                break
