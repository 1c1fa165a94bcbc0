"""The camera systems that can be served in a box, by the protocol's name, and a lab that takes its poses from one."""

from dataclasses import replace

from formation.config import LabConfig
from formation.messages import RawFrame
from formation.mocap_config import CAMERA_SYSTEMS, MocapConfig
from sim.cameras.servers.server import Server
from wire.clock import Clock

SOURCE_OF = {
    "vrpn": "vrpn",
    "chingmu": "chingmu",
    "nokov": "nokov",
    "natnet": "natnet",
    "qtm": "qualisys",
    "vicon": "vicon",
    "ros2": "ros2",
}
"""The `[mocap] source` that hears each protocol."""
CAMERA_PORT = 292
"""Counted from the first of a flight's block: above every drone's."""
LOOPBACK, OTHER_LOOPBACK = "127.0.0.1", "127.0.0.2"
"""NatNet's server and its client cannot share one address: both listen at the same ports."""


def is_camera_system(mocap: MocapConfig) -> bool:
    """Whether poses come by a vendor's protocol rather than by a bus or a file of ours."""
    return mocap.source in CAMERA_SYSTEMS


def server_for(mocap: MocapConfig, bodies: tuple[str, ...], clock: Clock) -> Server:
    """The server that the lab's mocap process will look for; each body goes by the source's own name for it."""
    if mocap.source == "chingmu":  # has numbers, not names
        from sim.cameras.servers.vrpn import chingmu_server

        return chingmu_server(mocap, bodies, clock)
    return _BySourceNames(mocap, _named_server(mocap, _source_names(mocap, bodies), clock))


def _named_server(mocap: MocapConfig, names: tuple[str, ...], clock: Clock) -> Server:
    match mocap.source:
        case "vrpn" | "nokov":
            from sim.cameras.servers.vrpn import vrpn_server

            return vrpn_server(mocap, names, clock)
        case "natnet":
            from sim.cameras.servers.natnet import natnet_server

            return natnet_server(mocap, names, clock)
        case "qualisys":
            from sim.cameras.servers.qtm import qtm_server

            return qtm_server(mocap, names, clock)
        case "vicon":
            from sim.cameras.servers.vicon import vicon_server

            return vicon_server(mocap, names, clock)
        case "ros2":
            from sim.cameras.servers.ros2 import ros2_server

            return ros2_server(mocap)
        case other:
            raise ValueError(f"{other} is no camera system")


def lab_with(lab: LabConfig, protocol: str) -> LabConfig:
    """The lab with its poses by that protocol from this machine, at ports of the flight's own block (sim.ports).

    What the lab file says of that system is kept but for addresses and ports.
    """
    source = SOURCE_OF[protocol]
    port = lab.link.ground_port_base + CAMERA_PORT
    match source:
        case "natnet":
            own = {
                "host": OTHER_LOOPBACK, "interface": LOOPBACK, "multicast": "", "command_port": port,
                "data_port": port + 1,
            }  # fmt: skip
        case _:
            own = {"host": LOOPBACK, "port": port}
    table = getattr(lab.mocap, source)
    configured = {} if table is None else table.model_dump()
    values = lab.mocap.model_dump(exclude_none=True) | {"source": source, source: configured | own}
    return lab.model_copy(update={"mocap": MocapConfig.model_validate(values)})


def _source_names(mocap: MocapConfig, bodies: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(mocap.source_name(body) for body in bodies)


class _BySourceNames:
    """A server whose frames' bodies go by what the source calls them."""

    def __init__(self, mocap: MocapConfig, server: Server) -> None:
        self._mocap = mocap
        self._server = server

    async def start(self) -> None:
        """Listen."""
        await self._server.start()

    def publish(self, frame: RawFrame) -> None:
        """Send one exposure."""
        self._server.publish(replace(frame, bodies=_source_names(self._mocap, frame.bodies)))

    async def close(self) -> None:
        """Listen no more."""
        await self._server.close()
