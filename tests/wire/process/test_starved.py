"""A simulator held against its own schedule."""

import pytest

from wire.process.starved import LATE_NS, Punctuality, StarvedError


def test_on_time_and_a_little_late_is_well():
    punctual = Punctuality("the mocap emulator", "its exposure")
    for late_ns in (-5, 0, LATE_NS):
        punctual.check(10**9, 10**9 + late_ns)


def test_too_late_says_who_and_how_late():
    with pytest.raises(StarvedError, match=r"the mocap emulator is starved: its exposure 400 ms late"):
        Punctuality("the mocap emulator", "its exposure").check(10**9, 10**9 + 400_000_000)
