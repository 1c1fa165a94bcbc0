"""What is foretold of a lab: the slots that a turning leader carries along, and what lies beyond the fence."""

import numpy as np
import pytest

from formation.config import Fence, FlightConfig, FollowerConfig, LabConfig, LeaderConfig, TrajectoryConfig
from formation.guidance.preview import (
    beyond_text,
    carried,
    coordinates,
    expected_start,
    outside_m,
    preview,
    reshaped,
    trajectory_from,
)
from formation.guidance.shape import Shape, configured
from tests.formation.oracles.frames import to_lab

FENCE = Fence(low_m=(-1.0, -2.0, 0.0), high_m=(1.5, 2.5, 2.0))
PATH = TrajectoryConfig(kind="line", length_m=0.8, duration_s=4.0, yaw_rate_rad_s=0.5)


def lab(sysid: int | None = 1, path: TrajectoryConfig = PATH) -> LabConfig:
    return LabConfig(
        leader=LeaderConfig(body="L", sysid=sysid, trajectory=path, spawn_lab_m=(0.3, -0.2, 0.1), spawn_yaw_rad=0.4),
        followers=(FollowerConfig(body="A", sysid=2, offset_m=(-0.4, 0.5, 0.2)),
                   FollowerConfig(body="B", sysid=3, offset_m=(-0.6, -0.3, -0.1))),
        flight=FlightConfig(altitude_m=0.9),
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(4))
def test_slots_are_carried_with_coriolis_free_euler_and_centripetal_terms(seed: int) -> None:
    rng = np.random.default_rng(seed)
    leader, offsets = rng.normal(size=(5, 3, 4)), rng.normal(size=(3, 3))
    out = carried(leader, offsets)
    for k in range(5):
        for n in range(3):
            slot = np.zeros((3, 4))
            slot[0, :3] = offsets[n]
            np.testing.assert_allclose(out[k, n], to_lab(slot, leader[k])[:, :3], atol=1e-12)


def test_a_lab_begins_where_its_file_says_at_the_flights_altitude() -> None:
    config = lab()
    start = expected_start(config)
    np.testing.assert_allclose(start, [0.3, -0.2, 0.9, 0.4])
    ahead = preview(trajectory_from(config, start), configured(config), start)
    assert ahead.duration_s == 4.0
    assert ahead.length_m == pytest.approx(0.8)
    assert len(ahead.t_s) == 101  # a hundred looks at least; one more closes the last
    np.testing.assert_allclose(ahead.leader[-1, 0, :3], [1.1, -0.2, 0.9])
    c, s = np.cos(0.4), np.sin(0.4)
    np.testing.assert_allclose(ahead.at_start[0], [0.3 - 0.4 * c - 0.5 * s, -0.2 - 0.4 * s + 0.5 * c, 1.1])
    np.testing.assert_allclose(ahead.slots[0, :, 0], ahead.at_start)


def test_an_observed_leader_is_taken_to_stay() -> None:
    config = lab(sysid=None)
    start = expected_start(config)
    ahead = preview(trajectory_from(config, start), configured(config), start)
    assert ahead.length_m == 0.0
    assert np.ptp(ahead.leader[:, 0], axis=0).max() == 0.0


def test_a_long_trajectory_is_looked_at_every_fiftieth_and_five_thousand_times_at_most() -> None:
    looks = []
    for duration_s in (20.0, 1000.0):
        config = lab(path=TrajectoryConfig(kind="line", duration_s=duration_s))
        start = expected_start(config)
        looks.append(len(preview(trajectory_from(config, start), configured(config), start).t_s))
    assert looks == [401, 5001]


def test_a_preview_may_begin_on_the_way_and_change_its_shape() -> None:
    config = lab()
    start = expected_start(config)
    path = trajectory_from(config, start)
    late = preview(path, configured(config), start, from_s=1.5, samples=11)
    np.testing.assert_allclose(late.t_s, np.linspace(1.5, 4.0, 11))
    assert preview(path, configured(config), start, from_s=9.0, samples=3).t_s.tolist() == [4.0] * 3
    other = Shape("other", ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), (0.0, 0.0))
    np.testing.assert_allclose(reshaped(late, other).slots, preview(path, other, start, 1.5, 11).slots)


def test_outside_is_counted_along_the_worst_axis() -> None:
    points = np.array([[0.0, 0.0, 1.0], [1.7, 0.0, 1.0], [-1.1, 2.9, 1.0], [0.0, 0.0, -0.3], [0.0, -2.6, 2.1]])
    np.testing.assert_allclose(outside_m(points, FENCE), [-1.0, 0.2, 0.4, 0.3, 0.6])


def test_the_wall_that_is_passed_is_named() -> None:
    assert beyond_text(np.array([1.9, 2.6, 0.3]), FENCE) == (
        "at (1.90, 2.60, 0.30) m, 0.40 m beyond limits.fence.high_m x = 1.5"
    )
    assert beyond_text(np.array([0.0, 0.0, -0.25]), FENCE) == (
        "at (0.00, 0.00, -0.25) m, 0.25 m beyond limits.fence.low_m z = 0"
    )
    assert coordinates(np.array([-0.001, 1.255, -3.0])) == "(0.00, 1.25, -3.00)"
