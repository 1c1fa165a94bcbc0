"""What a swarm's hover tells: whether it landed, and how near its drones came."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from formation import topics
from formation.maths.frames import IDENTITY
from formation.messages import LabFrame, LoopTiming, Phase, PhaseChange
from sim.studies.scale.swarm import Swarm, of_log, swarm
from wire.logs.mcap_log import LogWriter


@pytest.mark.nightly
def test_four_drones_hover_land_and_stay_as_far_apart_as_their_slots() -> None:
    result = swarm(3, 2.0, lambda _text: None)
    assert (result.drones, result.outcome, result.is_good) == (4, "landed", True)
    assert result.separation_m is not None
    assert result.tick is not None
    assert "4 drones" in result.text
    assert 0.55 < result.separation_m < 0.85  # they stand 0.6 m or more from each other
    assert 0.0 < result.tick.least_us <= result.tick.p50_us <= result.tick.p99_us
    assert json.loads(result.to_json())["tick"]["count"] == result.tick.count > 500
    assert not replace(result, separation_m=0.19).is_good
    assert not replace(result, outcome="aborted").is_good


def test_who_never_took_off_has_no_figures() -> None:
    result = Swarm(2, "aborted", 1.0, None, 0.2, None, 5.0)
    assert not result.is_good
    assert "tick" not in result.text
    assert json.loads(result.to_json())["separation_m"] is None


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
    ticks_us, separation_m, length_s = of_log(file, speed=0.5)
    assert ticks_us == pytest.approx([4000.0, 6000.0])
    assert (separation_m, length_s) == (pytest.approx(0.6), 3.0)
