"""Capture times that cannot be right hide every body, in frames that say so and are in order with the others."""

import itertools

import pytest

from formation.messages import Rejection
from mocap.validator import StampWatch
from tests.mocap.validator_rig import MS, ValidatorRig


def in_order(rig: ValidatorRig) -> bool:
    stamps = [frame.t_capture_ns for frame in rig.shown]
    return all(a < b for a, b in itertools.pairwise(stamps))


@pytest.mark.parametrize("ahead_ms", [11, 900])
def test_a_capture_that_runs_ahead_is_rejected_at_once_and_as_long_as_drones_fly(ahead_ms):
    r = ValidatorRig()
    for _ in range(80):
        r.show(stamp_ns=ahead_ms * MS)
    assert all((frame.rejected == Rejection.STAMP).all() for frame in r.shown)
    assert len(r.shown) == 80
    r.fly(100)
    assert in_order(r)
    assert [frame.seen.all() for frame in r.shown[-98:]] == [True] * 98
    assert sum("validator-stamp" in text for text in r.events) == 6


def test_growing_latency_is_rejected_beyond_150_ms():
    r = ValidatorRig()
    for k in range(300):
        r.show(stamp_ns=-k * MS)
    shown = [int(frame.seen.all()) for frame in r.shown]
    assert shown == [1] * 151 + [0] * (len(shown) - 151)
    assert in_order(r)


def test_another_rhythm_is_taken_up_on_the_floor():
    r = ValidatorRig()
    r.arm(False)
    for _ in range(60):
        r.show(stamp_ns=-400 * MS)
    assert [frame.seen.all() for frame in r.shown] == [False] * 50 + [True] * 10


def test_a_source_that_starts_late_settles_at_its_quickest():
    """Its first frame took 90 ms, which says nothing against the second."""
    watch = StampWatch()
    arrivals = [(8 + 90, 90), *[(8 + 10 * k, 8) for k in range(10, 200)]]
    assert not any(watch.rejects((at - delay) * MS, at * MS, True) for at, delay in arrivals)
    assert watch.likely_ns(2000 * MS) == pytest.approx(1992 * MS, abs=1000)
