"""Inputs of any content to everything that reads them; `make fuzz` draws a million of each."""

from types import ModuleType

import pytest

from tools.fuzz import datagrams, frames, natnet, qtm, vicon, vrpn
from wire.link_messages import GROUND
from wire.mavlink.codec import Codec
from wire.mavlink.framing import FRAMES_MOST


def test_any_datagrams_raise_nothing_and_lock_nobody_out() -> None:
    assert datagrams.fuzz(2000, seed=1).faults == []


def test_no_crafted_datagram_is_read_further_than_its_share() -> None:
    """What it costs is bounded by what is counted: a few false starts and a few frames, however it is made."""
    for data in datagrams.crafted():
        codec = Codec(GROUND)
        packets = codec.receive(data)
        assert len(data) <= datagrams.MTU
        assert len(packets) + codec.misaddressed_packets + codec.bad_packets <= FRAMES_MOST


def test_any_frames_raise_nothing_and_lock_nobody_out() -> None:
    """Two bodies with one pose once ended the ground, one stamp blinded it for good."""
    result = frames.fuzz(5000, seed=1)
    assert result.faults == []
    assert result.taken > 500
    assert result.flown > 5


@pytest.mark.parametrize("system", [qtm, vicon])
def test_any_packets_over_tcp_raise_nothing_and_lock_nobody_out(system: ModuleType) -> None:
    result = system.run(3000, seed=1)
    assert result.faults == []
    assert result.taken > 100
    assert result.refused > 100
    assert result.dropped > 50


def test_any_packets_of_natnet_raise_nothing_and_lock_nobody_out() -> None:
    result = natnet.fuzz(3000, seed=1)
    assert result.faults == []
    assert result.taken > 200
    assert result.refused > 500


def test_any_bytes_of_a_vrpn_server_raise_nothing_and_stall_nothing() -> None:
    result = vrpn.fuzz(6000, seed=1)
    assert result.faults == []
    assert result.frames > 1000
    assert result.ended > 10
    assert result.refused > 100
