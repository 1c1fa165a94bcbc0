"""What a soak tells of memory and log; how much that is, is the machine's business."""

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from bench.soak import Sample, Soak, of_log, soak
from formation import topics
from formation.maths.frames import IDENTITY
from formation.messages import LabFrame, LoopTiming, Phase, PhaseChange
from wire.logs.mcap_write import LogWriter


def test_growth_is_that_of_the_second_half() -> None:
    """By hand: from 10 s on 100 bytes a second of memory, 40 of log; before, start-up."""
    early = [Sample(0.0, 0, 0), Sample(5.0, 90_000, 7_000)]
    late = [Sample(10.0, 91_000, 8_000), Sample(15.0, 91_500, 8_200), Sample(20.0, 92_000, 8_400)]
    result = Soak(4, (*early, *late), "landed", 1.0)
    assert result.memory_bytes_h == pytest.approx(360_000.0)
    assert result.log_bytes_s_drone == pytest.approx(10.0)
    assert json.loads(result.to_json())["memory_bytes_h"] == pytest.approx(360_000.0)


def test_ticks_and_separation_of_a_log_are_those_in_the_air(tmp_path: Path) -> None:
    file, seen = tmp_path / "flight.mcap", np.ones(3, np.bool_)
    frames = ((0.1, 0.004, None), (0.7, 0.002, Phase.TAKEOFF), (0.6, 0.003, None), (0.2, 0.005, Phase.GROUND))
    with LogWriter(file, {}, threaded=False) as log:
        for k, (apart_m, latency_s, phase) in enumerate(frames):
            t_ns = 1_000_000_000 * (k + 1)
            pos = apart_m * np.arange(3.0)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
            if phase is not None:
                log.write(topics.PHASE, PhaseChange(phase, ""), t_ns)
            log.write(topics.MOCAP, LabFrame(k, t_ns, ("a", "b", "c"), pos, np.tile(IDENTITY, (3, 1)), seen), t_ns)
            log.write(topics.TIMING, LoopTiming(k, latency_s, False), t_ns)
    ticks_us, separation_m = of_log(file, speed=0.5)
    assert ticks_us == pytest.approx([4000.0, 6000.0])
    assert separation_m == pytest.approx(0.6)


@pytest.mark.nightly
def test_a_hover_is_sampled_in_the_air_and_its_log_grows(tmp_path: Path) -> None:
    result = soak(1, 20.0, tmp_path, lambda _text: None)
    assert (result.drones, result.outcome, result.is_good) == (2, "landed", True)
    assert not replace(result, min_separation_m=2.0 * result.separation_m).is_good
    times_s = [sample.t_s for sample in result.samples]
    assert len(times_s) >= 3
    assert all(5.0 <= b - a < 5.2 for a, b in pairwise(times_s))
    logged = [sample.log_bytes for sample in result.samples]
    assert logged == sorted(set(logged))
