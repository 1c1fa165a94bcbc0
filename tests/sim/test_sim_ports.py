import socket

from formation.config import LinkConfig
from sim.ports import private_link


def test_the_usual_udp_ports_where_free_else_others_and_a_bus_of_its_own() -> None:
    usual = LinkConfig()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        first = private_link("udp", (1, 2, 3))
        second = private_link("udp", (1, 2, 3))
    assert first.kind == "udp"
    assert first.zenoh_connect != second.zenoh_connect
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", first.drone_port_base + 2))
        other = private_link("udp", (1, 2, 3))
    assert other.drone_port_base != first.drone_port_base
    assert other.ground_port_base - usual.ground_port_base == other.drone_port_base - usual.drone_port_base
