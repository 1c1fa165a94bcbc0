"""`make fuzz` draws a million packets of each."""

import fuzz_qtm
import fuzz_vicon
import pytest


@pytest.mark.parametrize("system", [fuzz_qtm, fuzz_vicon])
def test_any_packets_raise_nothing_and_lock_nobody_out(system):
    result = system.run(3000, seed=1)
    assert result.faults == []
    assert result.taken > 100
    assert result.refused > 100
    assert result.dropped > 50
