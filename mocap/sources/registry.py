"""The source that a lab file names; raw frames that somebody publishes on the lab's bus are one."""

import asyncio
from collections.abc import Callable

from formation.config import LabConfig
from formation.messages import RawFrame
from formation.mocap_config import QualisysConfig, ViconConfig
from mocap.sources.recordings import Frame, Recording
from mocap.sources.source import Feed, Source, SourceStatus
from wire.transport.mocap_bus import MocapBus


class BusSource:
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


def open_source(config: LabConfig, bus: MocapBus, feed: Feed, deliver: Callable[[Frame], None]) -> Source:
    """The source that `[mocap] source` names; nothing is reached before it is run.

    deliver: of frames that are raw frames already, or a log's. Raises MocapFileError for a file that cannot be used,
    ValueError for `mavlink`, which no mocap process serves.
    """
    lab = tuple(v.body for v in config.vehicles)
    latency_ns = round(1e9 * config.mocap.constant_latency_s)
    match config.mocap.source:
        case "zenoh":
            return BusSource(bus, deliver)
        case "csv" | "mcap":
            return Recording(config, deliver, lambda: bus.has_subscribers, feed)
        case "vrpn":
            from mocap.sources.vrpn.session import vrpn_source

            return vrpn_source(config, feed)
        case "chingmu":
            from mocap.sources.vrpn.session import chingmu_source

            return chingmu_source(config, feed)
        case "natnet":
            from mocap.sources.natnet.session import NatNet

            return NatNet(config, feed)
        case "qualisys":
            from mocap.sources.qualisys import Qualisys

            return Qualisys(config.mocap.qualisys or QualisysConfig(), lab, latency_ns, feed)
        case "vicon":
            from mocap.sources.vicon import Vicon

            return Vicon(config.mocap.vicon or ViconConfig(), lab, latency_ns, feed)
        case "mavlink":
            raise ValueError("the ground hears poses from the drones themselves")
