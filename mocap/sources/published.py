"""Raw frames that somebody publishes on the lab's bus: a program of the lab's own, or the emulated cameras."""

import asyncio
from collections.abc import Callable

from formation.messages import RawFrame
from mocap.sources.source import SourceStatus
from wire.transport.mocap_bus import MocapBus


class Published:
    """Whoever publishes. Its stamps are on our clock already, or 0."""

    def __init__(self, bus: MocapBus, deliver: Callable[[RawFrame], None]) -> None:
        self._bus = bus
        self._deliver = deliver
        self._status = SourceStatus(server="the lab's bus")

    async def run(self) -> None:
        """Take what comes."""
        self._bus.on_raw(self._receive)
        await asyncio.get_running_loop().create_future()

    def status(self) -> SourceStatus:
        """Connected when a frame has come."""
        return self._status

    def _receive(self, frame: RawFrame) -> None:
        if frame.bodies != self._status.bodies:
            self._status = SourceStatus(self._status.server, connected=True, bodies=frame.bodies)
        self._deliver(frame)
