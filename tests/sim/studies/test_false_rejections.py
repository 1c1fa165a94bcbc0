"""What is right is never rejected: a real recording, and drones thrown about, through the whole mocap core."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from formation.maths.frames import IDENTITY
from sim.studies.false_rejections import AGGRESSIVE, Job, judge, motion_of, replay

NAME = "shared/data/vicon_v2_03.csv"
VICON = [folder / NAME for folder in Path(__file__).parents if (folder / NAME).exists()]


@pytest.mark.skipif(not VICON, reason=f"no {NAME} beside the repository: a leader recorded by a Vicon system")
def test_a_recorded_leader_is_always_believed():
    judged = judge(Job(str(VICON[0]), 100.0))
    assert judged.poses > 11_000
    assert judged.rejected == ()


def test_drones_thrown_about_are_always_believed():
    for seed in (1, 2):
        poses, rejected = replay(motion_of(AGGRESSIVE, seed), seed)
        assert poses > 30_000
        assert rejected == []


def test_what_is_not_right_is_counted() -> None:
    """Two bodies swapped at random are reassigned or rejected; either is reported."""
    motion = motion_of(AGGRESSIVE, 1)
    pos_m = motion.pos_lab_m.copy()
    pos_m[1000:1100, [0, 1]] = pos_m[1000:1100, [1, 0]]
    assert replay(replace(motion, pos_lab_m=pos_m), 1)[1] != []
    still = replace(motion, pos_lab_m=np.zeros_like(pos_m), q_lab_from_flu=np.tile(IDENTITY, (*pos_m.shape[:2], 1)))
    still.pos_lab_m[:, :, 0] = 0.6 * np.arange(pos_m.shape[1])
    assert replay(still, 1)[1] == []
    still.pos_lab_m[1000:1100, [0, 1]] = still.pos_lab_m[1000:1100, [1, 0]]
    assert any(text.startswith("no bodies are swapped any more") for text in replay(still, 1)[1])
