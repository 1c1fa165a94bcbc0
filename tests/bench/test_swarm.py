"""What a swarm's hover tells: whether it landed, and how near its drones came."""

from pathlib import Path

import numpy as np
import pytest

from bench.swarm import of_log
from formation import topics
from formation.maths.frames import IDENTITY
from formation.messages import LabFrame, LoopTiming, Phase, PhaseChange
from wire.logs.mcap_write import LogWriter


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
