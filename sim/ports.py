"""Network ports of this machine that nobody uses at the moment, so that several flights can run side by side."""

import socket
from collections.abc import Iterable

from formation.config import LinkConfig

UDP_SHIFT = 200
UDP_BLOCKS = 50


def private_link(kind: str, sysids: Iterable[int]) -> LinkConfig:
    """A link configuration on this machine alone; the usual UDP ports where they are free. OSError if none is."""
    port = _free_tcp_port()
    ground, drone = _free_udp_bases(tuple(sysids))
    return LinkConfig.model_validate(
        {
            "kind": kind,
            "ground_port_base": ground,
            "drone_port_base": drone,
            "zenoh_connect": (f"tcp/127.0.0.1:{port}",),
        }
    )


def _free_tcp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def _free_udp_bases(sysids: tuple[int, ...]) -> tuple[int, int]:
    usual = LinkConfig()
    for block in range(UDP_BLOCKS):
        ground, drone = (base + block * UDP_SHIFT for base in (usual.ground_port_base, usual.drone_port_base))
        if all(_is_free(base + sysid) for base in (ground, drone) for sysid in sysids):
            return ground, drone
    raise OSError(f"no free UDP ports for drones {sysids} in {UDP_BLOCKS} blocks from {usual.ground_port_base}")


def _is_free(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
        return True
