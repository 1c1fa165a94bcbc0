"""Inputs of any content to everything that reads them; `make fuzz` draws a million of each."""

import pytest

from tools.fuzz.__main__ import TARGETS, fuzz
from tools.fuzz.draw import MTU, crafted
from wire.link_messages import GROUND
from wire.mavlink.codec import Codec
from wire.mavlink.framing import FRAMES_MOST

TAKEN = {
    "frames": {"taken": 500},
    "qualisys": {"taken": 100, "rejected": 100, "connections ended": 50},
    "vicon": {"taken": 100, "rejected": 50, "connections ended": 50},
    "natnet": {"taken": 200, "rejected": 500},
    "vrpn": {"taken": 500, "rejected": 100, "connections ended": 10},
    "chingmu": {"taken": 500, "rejected": 100, "connections ended": 10},
    "ros2": {"taken": 500, "rejected": 500},
    "bridge": {"passed": 500},
    "agent": {"answers": 500},
    "import": {"imported": 20, "damaged": 50, "rejected": 50},
}
"""What is not taken is not tried: of 3,000 inputs so many at least."""


@pytest.mark.parametrize("name", TARGETS)
def test_any_input_raises_nothing_and_locks_nobody_out(name: str) -> None:
    """Two bodies with one pose once ended the ground, one stamp blinded it for good."""
    outcome = fuzz(name, 3000 if TARGETS[name].share == 1.0 else 30_000, seed=1)
    assert outcome.faults == []
    assert {what: most for what, most in TAKEN.get(name, {}).items() if outcome.counts[what] < most} == {}


def test_no_crafted_datagram_is_read_further_than_its_share() -> None:
    """What it costs is bounded by what is counted: a few false starts and a few frames, however it is made."""
    for data in crafted():
        codec = Codec(GROUND)
        packets = codec.receive(data)
        assert len(data) <= MTU
        assert len(packets) + codec.misaddressed_packets + codec.bad_packets <= FRAMES_MOST
