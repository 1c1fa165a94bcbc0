"""What a soak tells of memory and log; how much that is, is the machine's business."""

import json
from itertools import pairwise
from pathlib import Path

import pytest

from bench.soak import Sample, Soak, soak


def test_growth_is_that_of_the_second_half() -> None:
    """By hand: from 10 s on 100 bytes a second of memory, 40 of log; before, start-up."""
    early = [Sample(0.0, 0, 0), Sample(5.0, 90_000, 7_000)]
    late = [Sample(10.0, 91_000, 8_000), Sample(15.0, 91_500, 8_200), Sample(20.0, 92_000, 8_400)]
    result = Soak(4, (*early, *late), "landed", 1.0)
    assert result.memory_bytes_h == pytest.approx(360_000.0)
    assert result.log_bytes_s_drone == pytest.approx(10.0)
    assert json.loads(result.to_json())["memory_bytes_h"] == pytest.approx(360_000.0)


@pytest.mark.nightly
def test_a_hover_is_sampled_in_the_air_and_its_log_grows(tmp_path: Path) -> None:
    result = soak(1, 20.0, tmp_path, lambda _text: None)
    assert (result.drones, result.outcome) == (2, "landed")
    times_s = [sample.t_s for sample in result.samples]
    assert len(times_s) >= 3
    assert all(5.0 <= b - a < 5.2 for a, b in pairwise(times_s))
    logged = [sample.log_bytes for sample in result.samples]
    assert logged == sorted(set(logged))
