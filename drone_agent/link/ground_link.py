"""The drone's end of its link to the ground, for agent and bridge alike."""

from drone_agent.config import AgentConfig
from wire.rejections import RejectionLog
from wire.security.bus_access import ExposedError
from wire.security.protection import Protection
from wire.transport.link import Deliver, Link
from wire.transport.udp_bus import open_udp_drone
from wire.transport.zenoh_bus import ZenohBus


async def open_ground_link(
    config: AgentConfig, bus: ZenohBus | None, deliver: Deliver, rejections: RejectionLog, protection: Protection
) -> Link:
    """By the bus where the configuration says so, else by UDP; OSError names the host and the port."""
    if config.link.kind == "zenoh" and bus is not None:
        return bus.drone_link(config.sysid, deliver)
    try:
        return await open_udp_drone(config.link, config.sysid, deliver, rejections, protection)
    except ExposedError:
        raise
    except OSError as error:
        port = config.link.drone_port_base + config.sysid
        raise OSError(f"link to {config.link.host}, own port {port}: {error.strerror or error}") from error
