from fuzz_frames import fuzz


def test_any_frames_raise_nothing_and_lock_nobody_out():
    """`make fuzz` draws a million. Two bodies with one pose once ended the ground, one stamp blinded it for good."""
    result = fuzz(5000, seed=1)
    assert result.faults == []
    assert result.taken > 500
    assert result.flown > 5
