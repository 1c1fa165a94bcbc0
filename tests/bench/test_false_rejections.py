"""What is right is never rejected: a real recording, and drones thrown about, through the whole mocap core."""

from pathlib import Path

import pytest

from bench.false_rejections import AGGRESSIVE, Job, judge, motion_of, replay

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
