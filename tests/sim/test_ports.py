import socket
import subprocess
import sys

from formation.config import LinkConfig
from sim.ports import BLOCK, private_link

SYSIDS = (1, 2, 250)
LEASE = "from sim.ports import private_link\nwith private_link('udp', (1,)) as link: print(link.drone_port_base)"


def udp_ports(link: LinkConfig) -> set[int]:
    return {base + sysid for base in (link.ground_port_base, link.drone_port_base) for sysid in SYSIDS}


def test_two_flights_at_once_share_no_port_and_the_first_of_them_has_what_was_free() -> None:
    with private_link("udp", SYSIDS) as first, private_link("udp", SYSIDS) as second:
        assert first.kind == "udp"
        assert first.zenoh_connect != second.zenoh_connect
        assert not udp_ports(first) & udp_ports(second)
    with private_link("zenoh", SYSIDS) as third:
        assert third == first.model_copy(update={"kind": "zenoh"})


def test_a_flight_in_another_process_is_given_other_ports() -> None:
    """Both found the same ports free, and the second to bind them failed."""
    with private_link("udp", (1,)) as ours:
        other = subprocess.run([sys.executable, "-c", LEASE], capture_output=True, text=True, check=True)
        assert abs(int(other.stdout) - ours.drone_port_base) >= BLOCK


def test_a_block_in_which_a_stranger_has_a_port_is_passed_over() -> None:
    usual = LinkConfig()
    with private_link("udp", SYSIDS) as first:
        pass
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind(("127.0.0.1", first.drone_port_base + 2))
        with private_link("udp", SYSIDS) as other:
            assert other.ground_port_base - usual.ground_port_base == other.drone_port_base - usual.drone_port_base
            assert not udp_ports(other) & udp_ports(first)
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as stranger:
        # As a server does: a connection may just have ended there.
        stranger.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        stranger.bind(("127.0.0.1", first.ground_port_base))
        stranger.listen()
        with private_link("udp", SYSIDS) as other:
            assert not udp_ports(other) & udp_ports(first)
