from fuzz_natnet import fuzz


def test_any_packets_raise_nothing_and_lock_nobody_out():
    """`make fuzz` draws a million."""
    result = fuzz(3000, seed=1)
    assert result.faults == []
    assert result.taken > 200
    assert result.refused > 500
