"""`gcs live` as a process: the ground's log comes over the bus and goes to the viewers. It asks nothing."""

import asyncio
from collections.abc import Callable, Sequence

import zenoh

from formation.config import LinkConfig
from gcs.live.viewers import Viewer
from wire.logs.live import LiveLog, keys
from wire.process.daemon import GROUND_REMEDY, Awaited, Stop, report_missing
from wire.security.protection import LOOPBACK_ONLY, Protection
from wire.transport.zenoh_bus import ZenohBus

QUEUED = 64
"""Chunks that wait for a viewer; then the oldest are lost."""


class Live:
    """Between one ground's log and the viewers."""

    def __init__(self, viewers: Sequence[Viewer], report: Callable[[str], None]) -> None:
        self.messages = 0
        self.begun = False
        self._viewers = viewers
        self._report = report
        self._log = LiveLog()

    def receive_head(self, head: bytes) -> None:
        """The ground says what its log holds."""
        if self._log.receive_head(head):
            self.begun = True
            self._report(f"streaming {len(self._log.channels)} channels")
            for viewer in self._viewers:
                viewer.begin(self._log.channels)

    def receive_chunk(self, chunk: bytes) -> None:
        """The newest moments of the log."""
        for channel, unix_ns, data in self._log.messages(chunk):
            self.messages += 1
            for viewer in self._viewers:
                viewer.show(channel, unix_ns, data)


async def run(
    link: LinkConfig,
    lab: str,
    name: str,
    viewers: Sequence[Viewer],
    report: Callable[[str], None],
    protection: Protection = LOOPBACK_ONLY,
) -> int:
    """Stream until SIGINT or SIGTERM; how many messages. Raises BusError."""
    stop = Stop()
    bus = await ZenohBus.open(link.joined, lab, protection=protection)
    live = Live(viewers, report)
    head_key, chunk_key = keys(name)

    def receive_head(sample: zenoh.Sample) -> None:
        live.receive_head(sample.payload.to_bytes())

    def receive_chunk(sample: zenoh.Sample) -> None:
        live.receive_chunk(sample.payload.to_bytes())

    ground = Awaited(f"the log of ground {name!r}", lambda: live.begun, GROUND_REMEDY)
    awaited_task = asyncio.create_task(
        report_missing("live", [ground], lambda event: report(f"{event.source}: {event.text}"))
    )
    try:
        bus.listen(head_key, receive_head, limit=1)
        bus.listen(chunk_key, receive_chunk, limit=QUEUED)
        await stop.wait()
    finally:
        awaited_task.cancel()
        await bus.close()
        for viewer in viewers:
            viewer.close()
    return live.messages
