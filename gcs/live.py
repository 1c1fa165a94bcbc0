"""`gcs live` as a process: the ground's log comes over the bus and goes to the viewer. It asks nothing.

Foxglove connects to a WebSocket server here, which hands on the log's own channels, bytes untouched. Its package is
optional: `pip install 'mavlink-formation[live]'`.
"""

from collections.abc import Callable, Mapping
from typing import Any, Protocol

import zenoh

from formation.config import LinkConfig
from formation.messages import Event
from mavlink_formation.installation import install_command
from wire.logs.live import QUEUED, ChannelDescription, LiveLog, keys
from wire.process.daemon import GROUND_REMEDY, Precondition, Stop, beside, report_missing
from wire.security.protection import LOOPBACK_ONLY, Protection
from wire.transport.zenoh_bus import ZenohBus

APPLICATION = "mavlink-formation"


class ViewerError(RuntimeError):
    """A viewer that is not there, or a port that is taken; in words."""


class Viewer(Protocol):
    """Where channels and messages go."""

    def begin(self, channels: Mapping[int, ChannelDescription]) -> None:
        """Another log begins."""

    def show(self, channel: int, unix_ns: int, data: bytes) -> None:
        """One message of it."""

    def close(self) -> None:
        """The end."""


class Foxglove:
    """A WebSocket server that Foxglove connects to (Open connection, ws://HOST:PORT)."""

    def __init__(self, host: str, port: int) -> None:
        """ViewerError where the package is missing or the port is taken."""
        try:
            import foxglove
        except ImportError as error:
            raise ViewerError(f"foxglove-sdk is not installed: {install_command('live')}") from error
        self._sdk: Any = foxglove
        self._channels: dict[int, Any] = {}
        try:
            self._server: Any = foxglove.start_server(name=APPLICATION, host=host, port=port)
        except Exception as error:
            raise ViewerError(f"no WebSocket server on {host}:{port}: {error}") from error
        self.port: int = self._server.port

    def begin(self, channels: Mapping[int, ChannelDescription]) -> None:
        """Announce the log's channels in place of the last one's."""
        for channel in self._channels.values():
            channel.close()
        self._channels = {
            number: self._sdk.Channel(
                described.topic,
                message_encoding="protobuf",
                schema=self._sdk.Schema(name=described.schema_name, encoding="protobuf", data=described.descriptor_set),
            )
            for number, described in channels.items()
        }

    def show(self, channel: int, unix_ns: int, data: bytes) -> None:
        """To whoever is connected and has subscribed."""
        self._channels[channel].log(data, log_time=unix_ns)

    def close(self) -> None:
        """End the server."""
        self._server.stop()


class Live:
    """Between one ground's log and the viewer."""

    def __init__(self, viewer: Viewer, report: Callable[[str], None]) -> None:
        self.messages = 0
        self.begun = False
        self._viewer = viewer
        self._report = report
        self._log = LiveLog()

    def receive_head(self, head: bytes) -> None:
        """The ground says what its log holds."""
        if self._log.receive_head(head):
            self.begun = True
            self._report(f"streaming {len(self._log.channels)} channels")
            self._viewer.begin(self._log.channels)

    def receive_chunk(self, chunk: bytes) -> None:
        """The newest moments of the log."""
        for channel, unix_ns, data in self._log.messages(chunk):
            self.messages += 1
            self._viewer.show(channel, unix_ns, data)


async def run(
    link: LinkConfig,
    lab: str,
    name: str,
    viewer: Viewer,
    report: Callable[[str], None],
    protection: Protection = LOOPBACK_ONLY,
) -> int:
    """Stream until SIGINT or SIGTERM; how many messages. Raises BusError."""

    def report_event(event: Event) -> None:
        report(f"{event.source}: {event.text}")

    stop = Stop(report_event)
    bus = await ZenohBus.open(link.joined, lab, protection=protection)
    live = Live(viewer, report)
    head_key, chunk_key = keys(name)

    def receive_head(sample: zenoh.Sample) -> None:
        live.receive_head(sample.payload.to_bytes())

    def receive_chunk(sample: zenoh.Sample) -> None:
        live.receive_chunk(sample.payload.to_bytes())

    ground = Precondition(f"the log of ground {name!r}", lambda: live.begun, GROUND_REMEDY)
    try:
        bus.listen(head_key, receive_head, limit=1)
        bus.listen(chunk_key, receive_chunk, limit=QUEUED)
        async with beside(report_missing("live", [ground], report_event)):
            await stop.wait()
    finally:
        await bus.close()
        viewer.close()
    return live.messages
