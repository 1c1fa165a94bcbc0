"""What a soak tells of memory and log; how much that is, is the machine's business."""

import asyncio
import json
import math
from itertools import pairwise
from pathlib import Path

import pytest

from sim.studies.scale.soak import CAPACITY_MAH, Sample, Soak, hover, memory_bytes, soak, soak_by_processes
from tests.end_to_end.flights import SPEED
from wire.clock import Clock


def test_growth_is_that_of_the_second_half() -> None:
    """By hand: from 10 s on 100 bytes a second of memory, 40 of log; before, start-up."""
    early = [Sample(0.0, 0, 0), Sample(5.0, 90_000, 7_000)]
    late = [Sample(10.0, 91_000, 8_000), Sample(15.0, 91_500, 8_200), Sample(20.0, 92_000, 8_400)]
    result = Soak(4, (*early, *late), "landed", 1.0)
    assert result.memory_bytes_h == pytest.approx(360_000.0)
    assert result.log_bytes_s_drone == pytest.approx(10.0)
    assert json.loads(result.to_json())["memory_bytes_h"] == pytest.approx(360_000.0)


def test_of_one_sample_nothing_is_said() -> None:
    assert math.isnan(Soak(1, (Sample(0.0, 1, 1),), "landed", 1.0).memory_bytes_h)


def test_memory_that_is_taken_is_measured() -> None:
    before = memory_bytes()
    held = bytearray(b"x" * 50_000_000)
    assert memory_bytes() - before > 0.9 * len(held)


@pytest.mark.nightly
def test_a_hover_is_sampled_in_the_air_and_its_log_grows(tmp_path: Path) -> None:
    result = soak(1, 20.0, tmp_path, lambda _text: None)
    assert (result.drones, result.outcome) == (2, "landed")
    times_s = [sample.t_s for sample in result.samples]
    assert len(times_s) >= 3
    assert all(5.0 <= b - a < 5.2 for a, b in pairwise(times_s))
    logged = [sample.log_bytes for sample in result.samples]
    assert logged == sorted(set(logged))


@pytest.mark.nightly
@pytest.mark.processes
def test_by_processes_the_memory_is_the_grounds_and_its_cycles_are_counted(tmp_path: Path) -> None:
    result = asyncio.run(soak_by_processes(1, 12.0, tmp_path, lambda _text: None, 1, Clock(SPEED)))
    assert (result.drones, result.outcome) == (2, "landed")
    first, last = result.samples[0], result.samples[-1]
    assert last.t_s - first.t_s >= 10.0
    assert 10.0 * (last.t_s - first.t_s) < last.cycles - first.cycles < 200.0 * (last.t_s - first.t_s)
    assert last.log_bytes > first.log_bytes
    assert last.memory_bytes > 50e6


def test_no_battery_ends_the_hover() -> None:
    lab = hover(2, 60.0).lab
    assert all(lab.profile_of(vehicle).battery.capacity_mah == CAPACITY_MAH for vehicle in lab.vehicles)
