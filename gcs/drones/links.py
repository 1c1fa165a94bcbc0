"""The ground's links to its drones, by sysid: the shared bus or sockets, and each drone's own if it has one."""

from collections.abc import Mapping

from formation.config import LabConfig
from wire.process.port_holder import why_not_bound
from wire.security.bus_access import ExposedError
from wire.transport.link import Deliver, Link
from wire.transport.udp_bus import open_udp_direct, open_udp_ground
from wire.transport.zenoh_bus import ZenohBus


async def open_links(config: LabConfig, bus: ZenohBus, deliver: Deliver) -> Mapping[int, Link]:
    """Open what the configuration says; what the links refuse is noted in the bus's `refusals`.

    OSError for a port that is taken, ValueError for a link that is none.
    """
    own = {v.sysid: v.link for v in config.vehicles if v.sysid is not None and v.link is not None}
    shared = [v.sysid for v in config.vehicles if v.sysid is not None and v.link is None]
    links: dict[int, Link] = {}
    for sysid, text in own.items():
        links[sysid] = await open_udp_direct(text, sysid, deliver, bus.rejections, bus.protection)
    if shared:
        common = await open_shared(config, bus, shared, deliver)
        links.update((sysid, common) for sysid in shared)
    return links


def close_links(links: Mapping[int, Link]) -> None:
    """Close each, those that drones share once."""
    for link in {id(link): link for link in links.values()}.values():
        link.close()


async def open_shared(config: LabConfig, bus: ZenohBus, sysids: list[int], deliver: Deliver) -> Link:
    """Open the links of these system ids that the configuration says how. OSError for a port that is taken."""
    if config.link.kind == "zenoh":
        return bus.ground_link(sysids, deliver)
    try:
        return await open_udp_ground(config.link, sysids, deliver, bus.rejections, bus.protection)
    except ExposedError:
        raise
    except OSError as error:
        ports = [config.link.ground_port_base + sysid for sysid in sysids]
        whys = (why_not_bound(error, "udp", port) for port in ports)
        raise OSError(f"UDP ports {', '.join(map(str, ports))} on {config.link.host}: {max(whys, key=len)}") from error
