"""`gcs live` as a process: the ground's log comes over the bus and goes to the viewers. It asks nothing.

Foxglove connects to a WebSocket server here, Rerun has its own window; both get the log's own channels, bytes
untouched. Their packages are optional: `pip install 'mavlink-formation[live]'`.
"""

import os
import socket
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from io import BytesIO
from typing import Any, Protocol

import zenoh
from mcap.writer import CompressionType, Writer

from formation.config import LinkConfig
from formation.messages import Event
from wire.logs.live import ChannelDescription, LiveLog, keys
from wire.logs.scene import rerun_blueprint, show_bodies
from wire.process.daemon import GROUND_REMEDY, Precondition, Stop, beside, report_missing
from wire.process.system import python_command
from wire.security.bus_access import free_loopback_port
from wire.security.protection import LOOPBACK_ONLY, Protection
from wire.transport.zenoh_bus import ZenohBus

MISSING = "{} is not installed: pip install 'mavlink-formation[live]'"
APPLICATION = "mavlink-formation"
BATCH_NS = 500_000_000
"""So much of a flight Rerun is given at once."""
QUEUED = 64
"""Chunks that wait for a viewer; then the oldest are lost."""


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
            raise ViewerError(MISSING.format("foxglove-sdk")) from error
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


class Rerun:
    """Rerun's viewer: given a small MCAP file every half second, which it reads as it reads the log itself."""

    def __init__(self, to: str | None, bodies: Sequence[str]) -> None:
        """to: a file instead of a window; bodies: the lab's, leader first, for the blueprint that comes first.

        ViewerError where the package is missing.
        """
        try:
            import rerun
        except ImportError as error:
            raise ViewerError(MISSING.format("rerun-sdk")) from error
        self._sdk: Any = rerun
        self._channels: Mapping[int, ChannelDescription] = {}
        self._pending: list[tuple[int, int, bytes]] = []
        rerun.init(APPLICATION)
        try:
            rerun.connect_grpc(_open_viewer()) if to is None else rerun.save(to)
            rerun.send_blueprint(rerun_blueprint(bodies))
            show_bodies(bodies)
        except Exception as error:
            raise ViewerError(f"no Rerun: {error}") from error

    def begin(self, channels: Mapping[int, ChannelDescription]) -> None:
        """Begin a log; pending messages belong to the last one."""
        self._flush()
        self._channels = channels

    def show(self, channel: int, unix_ns: int, data: bytes) -> None:
        """With the next batch."""
        self._pending.append((channel, unix_ns, data))
        if unix_ns - self._pending[0][1] >= BATCH_NS:
            self._flush()

    def close(self) -> None:
        """Hand over the rest."""
        self._flush()
        self._sdk.disconnect()

    def _flush(self) -> None:
        if self._pending:
            self._sdk.log_file_from_contents("live.mcap", file_of(self._channels, self._pending))
            self._pending = []


def _open_viewer() -> str:
    """Open Rerun's viewer, which by default serves every interface; its address on loopback. OSError where it ends."""
    port = free_loopback_port()
    viewer = subprocess.Popen(
        python_command("rerun_cli", "--bind", "127.0.0.1", "--port", str(port)),
        stdin=subprocess.DEVNULL, start_new_session=True, env=os.environ | {"RERUN_APP_ONLY": "true"},
    )  # fmt: skip
    while viewer.poll() is None:
        with suppress(OSError), socket.create_connection(("127.0.0.1", port)):
            return f"rerun+http://127.0.0.1:{port}/proxy"
        time.sleep(0.05)
    raise OSError(f"its viewer ended with exit code {viewer.returncode}")


def file_of(channels: Mapping[int, ChannelDescription], messages: list[tuple[int, int, bytes]]) -> bytes:
    """A whole MCAP file of these messages."""
    stream = BytesIO()
    writer = Writer(stream, compression=CompressionType.NONE)
    writer.start()
    schemas: dict[tuple[str, bytes], int] = {}
    numbers: dict[int, int] = {}
    for number, described in channels.items():
        key = (described.schema_name, described.descriptor_set)
        if key not in schemas:
            schemas[key] = writer.register_schema(described.schema_name, "protobuf", described.descriptor_set)
        numbers[number] = writer.register_channel(described.topic, "protobuf", schemas[key])
    for number, unix_ns, data in messages:
        writer.add_message(numbers[number], unix_ns, data, unix_ns)
    writer.finish()  # type: ignore[no-untyped-call]
    return stream.getvalue()


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

    def report_event(event: Event) -> None:
        report(f"{event.source}: {event.text}")

    stop = Stop(report_event)
    bus = await ZenohBus.open(link.joined, lab, protection=protection)
    live = Live(viewers, report)
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
        for viewer in viewers:
            viewer.close()
    return live.messages
