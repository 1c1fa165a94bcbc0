from fuzz_datagrams import MTU, crafted, fuzz

from wire.link_messages.address import GROUND
from wire.mavlink.codec import Codec
from wire.mavlink.framing import FRAMES_MOST


def test_any_datagrams_raise_nothing_and_lock_nobody_out():
    """`make fuzz` draws a million."""
    assert fuzz(2000, seed=1).faults == []


def test_no_crafted_datagram_is_read_further_than_its_share():
    """What it costs is bounded by what is counted: a few false starts and a few frames, however it is made."""
    for data in crafted():
        codec = Codec(GROUND)
        packets = codec.receive(data)
        assert len(data) <= MTU
        assert len(packets) + codec.misaddressed_packets + codec.bad_packets <= FRAMES_MOST
