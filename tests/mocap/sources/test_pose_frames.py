"""One message a body, and what exposures are made of them."""

import random

import numpy as np
import pytest

from mocap.sources.pose_frames import Assembly, Exposure, Pacing

MS, US = 1_000_000, 1000
PERIOD_NS = 4_166_667


def pose(k: int, row: int) -> bytes:
    return random.Random(1000 * k + row).randbytes(56)


def fresh() -> Assembly:
    assembly = Assembly(2 * MS)
    assembly.set_period(PERIOD_NS)
    return assembly


def fed(assembly: Assembly, k: int, rows: range | list[int], spacing_ns: int = 0, now_ns: int | None = None) -> int:
    now_ns = k * PERIOD_NS if now_ns is None else now_ns
    for place, row in enumerate(rows):
        assembly.add(row, 10**18 + k * PERIOD_NS + place * spacing_ns, pose(k, row), now_ns)
    return now_ns


@pytest.mark.parametrize("spacing_ns", [0, 10 * US, 50 * US])
def test_twenty_bodies_are_one_exposure(spacing_ns: int):
    assembly, ready = fresh(), []
    for k in range(100):
        now_ns = fed(assembly, k, range(20), spacing_ns)
        ready.append(assembly.pop_ready(now_ns))
    assert ready[0] == []  # the first waits: who is there is not known yet
    assert [len(exposures) for exposures in ready[1:]] == [2] + 98 * [1]
    assert all(len(e.poses) == 20 for exposures in ready for e in exposures)
    assert assembly.late == 0


def test_one_that_is_whole_does_not_wait():
    assembly = fresh()
    fed(assembly, 0, [0, 1])
    assert assembly.due_ns == 2 * MS
    assert assembly.pop_ready(2 * MS - 1) == []
    assert len(assembly.pop_ready(2 * MS)) == 1
    now_ns = fed(assembly, 1, [0])
    assert assembly.pop_ready(now_ns) == []
    fed(assembly, 1, [1])
    assert assembly.pop_ready(now_ns) == [Exposure(10**18 + PERIOD_NS, now_ns, {0: pose(1, 0), 1: pose(1, 1)})]
    assert assembly.due_ns is None


@pytest.mark.parametrize("in_pairs", [False, True])
@pytest.mark.parametrize("spacing_ns", [0, 100 * US])
def test_a_second_copy_is_neither_a_new_exposure_nor_a_late_pose(in_pairs: bool, spacing_ns: int):
    assembly, ready = fresh(), []
    for k in range(50):
        rows = [0, 0, 1, 1, 2, 2] if in_pairs else [0, 1, 2, 0, 1, 2]
        for place, row in enumerate(rows):
            later_ns = spacing_ns * (place % 2 if in_pairs else place // 3)
            assembly.add(row, 10**18 + k * PERIOD_NS + later_ns, pose(k, row), k * PERIOD_NS + place)
            ready += assembly.pop_ready(k * PERIOD_NS + place)
    ready += assembly.pop_ready(10**12)
    assert len(ready) == 50
    assert all(len(e.poses) == 3 for e in ready)
    assert assembly.late == 0


def test_a_pose_after_its_exposure_is_counted_and_waited_for_next_time():
    assembly = fresh()
    fed(assembly, 0, [0])
    assembly.pop_ready(2 * MS)
    fed(assembly, 0, [1], now_ns=3 * MS)
    assert assembly.pop_ready(10 * MS) == []
    assert assembly.late == 1
    now_ns = fed(assembly, 1, [0])
    assert assembly.pop_ready(now_ns) == []


def test_a_datagram_that_was_overtaken_makes_no_exposure():
    assembly = fresh()
    fed(assembly, 0, [0])
    fed(assembly, 2, [0])
    fed(assembly, 1, [0])
    fed(assembly, 3, [0])
    assert [e.stamp_ns for e in assembly.pop_ready(10**9)] == [10**18 + k * PERIOD_NS for k in (0, 2, 3)]
    assert assembly.late == 1


@pytest.mark.parametrize("hours", [-1, 1])
def test_a_clock_that_was_set_keeps_no_exposure_back(hours: int):
    assembly = fresh()
    fed(assembly, 0, [0, 1])
    assembly.pop_ready(2 * MS)
    for row in (0, 1):
        assembly.add(row, 10**18 + hours * 3_600_000 * MS, pose(1, row), 4 * MS)
    assert [len(e.poses) for e in assembly.pop_ready(4 * MS)] == [2]
    assert assembly.late == 0


def test_exposures_are_numbered_and_a_gap_counts_as_lost():
    pacing = Pacing(1e9 / 100)
    stamps = [k * PERIOD_NS for k in range(200) if k not in (150, 151, 170)]
    numbers = [pacing.number(10**18 + stamp) for stamp in stamps]
    assert numbers == [k for k in range(200) if k not in (150, 151, 170)]
    assert pacing.lost == 3
    assert pacing.period_ns == pytest.approx(PERIOD_NS, rel=1e-3)


@pytest.mark.parametrize("every", [100, 0])
def test_stamps_that_jitter_by_up_to_two_fifths_of_a_period_are_no_loss_and_hide_none(every: int):
    rng, period_ns = np.random.default_rng(3), 1e9 / 240.0
    jitter_ns = np.clip(rng.normal(0.0, 0.12 * period_ns, 5000), -0.4 * period_ns, 0.4 * period_ns)
    stamps = np.arange(5000) * period_ns + jitter_ns
    kept = [k for k in range(5000) if k < 200 or not every or k % every]
    pacing = Pacing(1e9 / 100)
    assert [pacing.number(round(stamps[k])) for k in kept] == kept
    assert pacing.lost == 5000 - len(kept)


def test_a_pause_or_a_clock_that_was_set_is_no_loss():
    pacing = Pacing(1e9 / 100)
    for k in range(100):
        pacing.number(k * 10 * MS)
    assert pacing.number(99 * 10 * MS + 3_600_000 * MS) == 100
    assert pacing.number(99 * 10 * MS) == 101
    pacing.restart()
    assert pacing.number(10**18) == 102
    assert pacing.lost == 0
