"""A NatNet session and a server in lockstep: packets on their way for as long as is drawn, one clock for the truth."""

from collections.abc import Callable
from heapq import heappop, heappush

import numpy as np

from formation.messages import RawFrame
from mocap.sources.natnet.session import NatNetSession
from sim.cameras.servers.natnet import NatNetSettings, Responder
from tests.mocap.sources.recorded_feed import kept

MS = 1_000_000
SERVER, CLIENT = "10.0.0.1", ("10.0.0.2", 40_000)
BODIES = ("lead", "left")
Delay = Callable[[], float]
"""Seconds that the next packet takes."""


class Lockstep:
    """Steps of 1 ms; frames every 10 ms, exposed 3 ms before they are sent."""

    def __init__(
        self,
        multicast: str = "",
        settings: NatNetSettings | None = None,
        delay: Delay = lambda: 0.0002,
        wanted: tuple[str, ...] = BODIES,
    ) -> None:
        self.recorder = kept("natnet", natnet={"host": SERVER, "multicast": multicast})
        self.session = NatNetSession(self.recorder.config.natnet, 8 * MS, wanted, self.recorder.feed())
        self.responder: Responder | None = Responder(settings or NatNetSettings(), 1511, multicast or None)
        self.bodies, self.seen = BODIES, (True, True)
        self.exposed_ns: dict[int, int] = {}
        self.frames_lost = False
        self.burst = 1
        self._delay = delay
        self.seq = 0
        self._held: list[bytes] = []
        self._way: list[tuple[int, int, bool, bytes]] = []
        self.asked: list[bytes] = []
        self._sent = 0
        self._last_ns = {True: 0, False: 0}
        self.session.start(self.recorder.now_ns)

    def run(self, seconds: float) -> None:
        """Let so much time pass."""
        for _ in range(round(seconds * 1000)):
            self._arrive(self.recorder.now_ns)
            if self.recorder.now_ns % (10 * MS) == 0:
                self._expose()
            if self.recorder.now_ns % (25 * MS) == 0:
                for data in self.session.due(self.recorder.now_ns):
                    self.asked.append(data)
                    self._put(data, True, self.recorder.now_ns)
                if self.session.is_silent(self.recorder.now_ns):
                    self.session.start(self.recorder.now_ns)
            self._arrive(self.recorder.now_ns + MS)
            self.recorder.now_ns += MS - self.recorder.now_ns % MS

    def errors_ns(self, since_ns: int) -> list[int]:
        """Of the capture times of the frames that came since."""
        came = zip(self.recorder.came_ns, self.recorder.frames, strict=True)
        return [frame.t_capture_ns - self.exposed_ns[frame.seq] for now_ns, frame in came if now_ns >= since_ns]

    def _expose(self) -> None:
        self.seq += 1
        exposed_ns = self.recorder.now_ns - 3 * MS
        self.exposed_ns[self.seq] = exposed_ns
        if self.responder is None or self.frames_lost:
            return
        n = len(self.bodies)
        pos = np.arange(3.0 * n).reshape(n, 3)
        raw = RawFrame(
            self.seq, exposed_ns, self.bodies, pos, np.tile([0.5, 0.5, -0.5, 0.5], (n, 1)), np.array(self.seen)
        )
        self._held.append(self.responder.frame(raw, self.recorder.now_ns))
        if len(self._held) >= self.burst and self.responder.listeners(self.recorder.now_ns):
            for k, data in enumerate(self._held):
                self._put(data, False, self.recorder.now_ns + k * 50_000)
        if len(self._held) >= self.burst:
            self._held.clear()

    def _put(self, data: bytes, up: bool, now_ns: int) -> None:
        """On a way that keeps their order: what is held up holds up what follows."""
        self._sent += 1
        self._last_ns[up] = max(self._last_ns[up] + 1000, now_ns + round(self._delay() * 1e9))
        heappush(self._way, (self._last_ns[up], self._sent, up, data))

    def _arrive(self, until_ns: int) -> None:
        """In the order in which they come, each at its own time."""
        while self._way and self._way[0][0] < until_ns:
            now_ns, _, up, data = heappop(self._way)
            self.recorder.now_ns = now_ns
            if not up:
                self.session.received(data, SERVER, now_ns)
            elif self.responder is not None:
                for answer in self.responder.received(data, CLIENT, now_ns):
                    self._put(answer, False, now_ns)
