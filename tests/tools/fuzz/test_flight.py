import pytest

from tools.fuzz.flight import fuzz


@pytest.mark.parametrize("name", ["ground", "mocap", "agent", "bridge", "page", "live"])
def test_nothing_that_comes_ends_a_process(name):
    """`make fuzz` sends a million to each."""
    assert fuzz(2_000, seed=1, names=[name]).faults == []
