from fuzz_vrpn import fuzz


def test_any_bytes_of_a_vrpn_server_raise_nothing_and_stall_nothing():
    """`make fuzz` draws a million."""
    result = fuzz(6000, seed=1)
    assert result.faults == []
    assert result.frames > 1000
    assert result.ended > 10
    assert result.refused > 100
