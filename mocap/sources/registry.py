"""The source that a lab file names."""

from collections.abc import Callable

from formation.config import LabConfig
from formation.mocap_config import QualisysConfig, ViconConfig
from mocap.sources.published import Published
from mocap.sources.recordings import Frame, Recording
from mocap.sources.source import Feed, Source
from wire.transport.mocap_bus import MocapBus


def open_source(config: LabConfig, bus: MocapBus, feed: Feed, deliver: Callable[[Frame], None]) -> Source:
    """What `[mocap] source` says; nothing is reached before it is run.

    deliver: of frames that are raw frames already, or a log's. Raises MocapFileError for a file that cannot be used,
    ValueError for `mavlink`, which no mocap process serves.
    """
    lab = tuple(v.body for v in config.vehicles)
    latency_ns = round(1e9 * config.mocap.constant_latency_s)
    match config.mocap.source:
        case "zenoh":
            return Published(bus, deliver)
        case "csv" | "mcap":
            return Recording(config, deliver, lambda: bus.has_subscribers, feed)
        case "vrpn":
            from mocap.sources.vrpn.client import vrpn_source

            return vrpn_source(config, feed)
        case "chingmu":
            from mocap.sources.vrpn.client import chingmu_source

            return chingmu_source(config, feed)
        case "natnet":
            from mocap.sources.natnet.client import NatNet

            return NatNet(config, feed)
        case "qualisys":
            from mocap.sources.qualisys.source import Qualisys

            return Qualisys(config.mocap.qualisys or QualisysConfig(), lab, latency_ns, feed)
        case "vicon":
            from mocap.sources.vicon.source import Vicon

            return Vicon(config.mocap.vicon or ViconConfig(), lab, latency_ns, feed)
        case "mavlink":
            raise ValueError("the ground hears poses from the drones themselves")
