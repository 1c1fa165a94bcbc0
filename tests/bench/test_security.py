"""The figures of `python -m bench.security` are of what they say: what was sent arrives, and a flood was one."""

from pathlib import Path

import pytest

from bench.security.datagram_flood import setpoints_beside
from bench.security.lab import keyed_lab
from bench.security.link_cost import HOPS, bus_hop
from formation.config import LinkConfig
from tests.free_ports import free_port

pytestmark = pytest.mark.processes


def test_every_signed_setpoint_is_accepted_beside_hostile_datagrams(tmp_path: Path) -> None:
    """However busy the machine: the peer's packets have a buffer of their own, which holds all of these."""
    links = LinkConfig(kind="udp", ground_port_base=free_port() - 1, drone_port_base=free_port() - 1)
    arrivals = setpoints_beside(1e5, 100, keyed_lab(tmp_path, free_port()), links)
    assert arrivals.accepted == 100
    assert arrivals.hostile_hz > 1000.0


@pytest.mark.parametrize("with_keys", [False, True])
def test_a_hop_of_the_bus_is_timed_with_keys_and_without(with_keys: bool, tmp_path: Path) -> None:
    endpoint = f"{'tls' if with_keys else 'tcp'}/127.0.0.1:{free_port()}"
    hop = bus_hop(keyed_lab(tmp_path, free_port()), endpoint, with_keys=with_keys)
    assert hop.received == HOPS - HOPS // 10
    assert 0.0 < hop.p50_us <= hop.p99_us
