"""The source that a lab file names."""

from collections.abc import Callable

from formation.config import LabConfig
from gcs.mocap.sources.published import Published
from gcs.mocap.sources.recordings import Frame, Recording
from gcs.mocap.sources.source import Feed, Source
from wire.transport.mocap_bus import MocapBus


def open_source(config: LabConfig, bus: MocapBus, feed: Feed, deliver: Callable[[Frame], None]) -> Source:
    """What `[mocap] source` says; nothing is reached before it is run.

    deliver: of frames that are raw frames already, or a log's. Raises MocapFileError for a file that cannot be used.
    """
    match config.mocap.source:
        case "csv" | "mcap":
            return Recording(config, deliver, lambda: bus.is_heard, feed)
        case "zenoh":
            return Published(bus, deliver)
        case "natnet":
            from gcs.mocap.sources.natnet.client import NatNet

            return NatNet(config, feed)
        case other:
            raise NotImplementedError(other)
