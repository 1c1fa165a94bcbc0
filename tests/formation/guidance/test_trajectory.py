"""Motions from rest to rest: the leader's trajectories, and a gap that closes continuously from any motion."""

from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formation.config import TrajectoryConfig
from formation.guidance import reference_generator
from formation.guidance.reference_generator import add_gap
from formation.guidance.trajectory import (
    ACCELERATION_M_S2,
    Trajectory,
    anchored,
    braked,
    braking_s,
    closing_s,
    min_jerk,
    sample,
    stopping_s,
)
from formation.maths.arrays import Float

ANCHOR = np.array([0.1, 0.2, 0.3])
KINDS = [
    TrajectoryConfig(kind="hold", yaw_rate_rad_s=1.0),
    TrajectoryConfig(kind="line", length_m=1.0, duration_s=4.0),
    TrajectoryConfig(kind="circle", radius_m=0.3, period_s=6.0, duration_s=12.0, yaw_rate_rad_s=-0.5),
    TrajectoryConfig(kind="waypoints", waypoints_m=((1.0, 0.0, 0.5), (1.0, 1.0, 1.0), (0.0, 0.0, 0.3))),
    TrajectoryConfig(kind="figure8", length_m=1.2, period_s=8.0, laps=2),
    TrajectoryConfig(kind="lissajous", amplitude_m=(0.6, 0.4, 0.1), cycles=(3, 2, 1), phase_rad=(0.5, 0.0, 0.1)),
    TrajectoryConfig(kind="polynomial", waypoints_m=((1.0, 0.0, 0.5), (1.0, 1.0, 1.0), (0.0, 0.0, 0.3)), laps=2),
    TrajectoryConfig(kind="file", points=tuple((t, t * t / 9.0, 0.5 * t, 0.4, 1.2 * t) for t in (0.0, 1.0, 2.5, 3.0))),
]


def motion(path: Trajectory, t_s: float) -> Float:
    out = np.empty((3, 4))
    sample(path.kind, path.numbers, path.knots, t_s, out)
    return out


@pytest.mark.parametrize("config", KINDS, ids=lambda c: c.kind)
def test_rates_are_derivatives_and_nothing_jumps(config: TrajectoryConfig) -> None:
    path = anchored(config, ANCHOR, 0.5)
    h = 1e-4
    for t in np.linspace(-0.5, path.duration_s + 0.5, 331):
        before, now, after = (motion(path, t + k * h) for k in (-1, 0, 1))
        np.testing.assert_allclose(now[1], (after[0] - before[0]) / (2 * h), atol=2e-4)
        np.testing.assert_allclose(now[2], (after[1] - before[1]) / (2 * h), atol=2e-2)


@pytest.mark.parametrize("config", KINDS, ids=lambda c: c.kind)
def test_from_rest_to_rest(config: TrajectoryConfig) -> None:
    path = anchored(config, ANCHOR, 0.5)
    for t in (0.0, path.duration_s, path.duration_s + 5.0):
        np.testing.assert_allclose(motion(path, t)[1:], 0.0, atol=1e-9)


def test_line_goes_its_length_along_lab_x() -> None:
    path = anchored(KINDS[1], ANCHOR, 0.0)
    np.testing.assert_allclose(motion(path, 10.0)[0, :3], [1.1, 0.2, 0.3])


def test_circle_is_about_the_origin_at_the_anchors_height_with_whole_laps() -> None:
    path = anchored(KINDS[2], ANCHOR, 0.0)
    for t in np.linspace(0.0, path.duration_s, 50):
        p = motion(path, t)[0]
        assert np.hypot(p[0], p[1]) == pytest.approx(0.3)
        assert p[2] == 0.3
    np.testing.assert_allclose(motion(path, path.duration_s)[0, :2], [0.3, 0.0], atol=1e-9)
    assert np.linalg.norm(motion(path, 0.5 * path.duration_s)[1, :2]) == pytest.approx(0.3 * 2 * np.pi / 6.0)


def test_a_circle_is_flown_as_many_laps_as_asked_and_takes_a_period_each_and_the_ramp() -> None:
    path = anchored(TrajectoryConfig(kind="circle", radius_m=0.5, period_s=6.0, laps=5), ANCHOR, 0.0)
    assert path.duration_s == 5 * 6.0 + 1.5
    around = np.array([motion(path, t)[0, :2] for t in np.linspace(0.0, path.duration_s, 2000)])
    angle = np.unwrap(np.arctan2(around[:, 1], around[:, 0]))
    assert angle[-1] - angle[0] == pytest.approx(5 * 2 * np.pi)


def test_a_line_is_flown_there_and_back_as_often_as_asked() -> None:
    path = anchored(TrajectoryConfig(kind="line", length_m=2.0, duration_s=4.0, laps=2), ANCHOR, 0.0)
    assert path.duration_s == 16.0
    x = [motion(path, t)[0, 0] - ANCHOR[0] for t in (0.0, 2.0, 4.0, 8.0, 12.0, 16.0, 20.0)]
    np.testing.assert_allclose(x, [0.0, 1.0, 2.0, 0.0, 2.0, 0.0, 0.0], atol=1e-12)
    there = anchored(TrajectoryConfig(kind="line", length_m=2.0, duration_s=4.0), ANCHOR, 0.0)
    for t in np.linspace(0.0, 4.0, 30):
        np.testing.assert_allclose(motion(path, t), motion(there, t), atol=1e-12)


def test_waypoints_are_flown_as_often_as_asked() -> None:
    points = ((1.0, 0.0, 0.5), (0.0, 1.0, 0.5))
    path = anchored(TrajectoryConfig(kind="waypoints", waypoints_m=points, laps=3), ANCHOR, 0.0)
    np.testing.assert_allclose(path.knots[1:, 1:], points * 3)
    np.testing.assert_allclose(motion(path, path.duration_s)[0, :3], points[-1])


def test_what_is_compiled_is_what_is_plain() -> None:
    """A lab is judged by the plain functions and flown by the compiled ones: the same numbers to the last bit."""
    for config in KINDS:
        path = anchored(config, ANCHOR, 0.5)
        for t in np.linspace(-0.5, path.duration_s + 0.5, 101):
            compiled = np.empty((3, 4))
            reference_generator.sample(path.kind, path.numbers, path.knots, float(t), compiled)
            assert np.array_equal(compiled, motion(path, float(t))), (config.kind, t)


def test_waypoints_are_met_in_turn_within_the_speed() -> None:
    path = anchored(KINDS[3], ANCHOR, 0.0)
    for t, *point in path.knots:
        np.testing.assert_allclose(motion(path, t)[0, :3], point, atol=1e-9)
    speeds = [np.linalg.norm(motion(path, t)[1, :3]) for t in np.linspace(0.0, path.duration_s, 500)]
    assert max(speeds) <= KINDS[3].speed_m_s + 1e-9


def test_a_figure_of_eight_crosses_the_origin_and_reaches_its_length_and_width() -> None:
    path = anchored(TrajectoryConfig(kind="figure8", length_m=1.2, width_m=0.4, period_s=8.0), ANCHOR, 0.0)
    around = np.array([motion(path, t)[0] for t in np.linspace(0.0, path.duration_s, 4001)])
    np.testing.assert_allclose(around[[0, -1], :2], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.abs(around[:, :2]).max(axis=0), [0.6, 0.2], rtol=1e-4)
    # Gerono's lemniscate, x^4 = a^2 (x^2 - y^2) for a width of its length.
    x, y = around[:, 0] / 0.6, around[:, 1] / 0.2
    np.testing.assert_allclose(y * y, 4.0 * x * x * (1.0 - x * x), atol=1e-9)


def test_a_polynomial_passes_every_waypoint_at_speed_and_is_as_fast_as_asked() -> None:
    points = ((1.0, 0.0, 0.5), (1.0, 1.0, 0.8), (0.0, 1.0, 0.5), (0.0, 0.0, 0.3))
    path = anchored(TrajectoryConfig(kind="polynomial", waypoints_m=points, speed_m_s=0.7), ANCHOR, 0.3)
    for t, point in zip(path.knots[1:, 0], points, strict=False):
        now = motion(path, t)
        np.testing.assert_allclose(now[0, :3], point, atol=1e-9)
        assert np.linalg.norm(now[1, :3]) > 0.2
    np.testing.assert_allclose(motion(path, path.duration_s)[0], [*points[-1], 0.3], atol=1e-9)
    speeds = [np.linalg.norm(motion(path, t)[1, :3]) for t in np.linspace(0.0, path.duration_s, 1000)]
    assert max(speeds) == pytest.approx(0.7, rel=1e-3)


def test_one_polynomial_from_rest_to_rest_is_the_one_of_least_snap() -> None:
    """Between two points it is 35 u^4 - 84 u^5 + 70 u^6 - 20 u^7, which is known."""
    path = anchored(TrajectoryConfig(kind="polynomial", waypoints_m=((2.1, 0.2, 0.3),)), ANCHOR, 0.0)
    for u in np.linspace(0.0, 1.0, 11):
        step = u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3)
        assert motion(path, u * path.duration_s)[0, 0] == pytest.approx(0.1 + 2.0 * step, abs=1e-9)


def test_recorded_points_are_met_and_headings_unwound() -> None:
    points = tuple((0.01 * k, np.sin(0.02 * k), 0.0, 0.5, (0.05 * k + np.pi) % (2 * np.pi) - np.pi) for k in range(400))
    path = anchored(TrajectoryConfig(kind="file", points=points), ANCHOR, 0.0)
    assert path.duration_s == pytest.approx(3.99)
    for k in (0, 7, 150, 399):
        assert motion(path, points[k][0])[0] == pytest.approx([*points[k][1:4], 0.05 * k], abs=1e-9)


@pytest.mark.parametrize(("points", "told"), [
    (((0.0, 0.0, 0.0, 0.0, 0.0),), "1 points"),
    (((1.0, 0.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0, 0.0)), "first point is at t = 1 s"),
    (((0.0, 0.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0, 0.0)), "point 3 is at t = 2 s"),
])  # fmt: skip
def test_points_that_are_no_way_are_refused(points: tuple[tuple[float, ...], ...], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        TrajectoryConfig.model_validate({"kind": "file", "points": points})


def test_turn_reaches_its_rate_and_adds_to_the_heading() -> None:
    path = anchored(KINDS[0], ANCHOR, 0.5)
    assert motion(path, 4.0)[1, 3] == pytest.approx(1.0)
    assert motion(path, 99.0)[0, 3] == pytest.approx(0.5 + (8.0 - 2.0) * 1.0)


def test_min_jerk_golden() -> None:
    assert min_jerk(0.5) == pytest.approx((0.5, 1.875, 0.0))


def test_closing_takes_as_long_as_speed_acceleration_turn_and_braking_need() -> None:
    def gap(**rows: list[float]) -> np.ndarray:
        out = np.zeros((4, 4))
        for name, row in rows.items():
            out["pvah".index(name)] = row
        return out

    def closing(gap: np.ndarray, speed: float) -> float:
        return closing_s(gap, braking_s(gap), speed)

    assert closing(gap(p=[3.0, 4.0, 0.0, 0.0]), 1.5) == pytest.approx(1.875 * 5.0 / 1.5)
    assert closing(gap(p=[0.3, 0.0, 0.4, 0.0]), 9.0) == pytest.approx(sqrt(5.7735 * 0.5 / 2.5))
    assert closing(gap(p=[0.0, 0.0, 0.0, -2.0]), 9.0) == pytest.approx(1.875 * 2.0)
    assert closing(gap(h=[0.0, 0.0, 1.0, 0.0]), 0.5) == pytest.approx(3.4346 / 0.5)
    assert closing(gap(p=[1.0, 0.0, 0.0, 0.0], h=[0.0, 0.0, 1.0, 0.0]), 9.0) == pytest.approx(sqrt(29.7735 / 2.5))
    moving = gap(v=[2.0, 1.0, 2.0, 0.5])
    assert braking_s(moving) == pytest.approx(2.0 * 3.0 / 2.5)
    # It is braked along Hermite's cubic: half the speed times the time, plus a twelfth of the acceleration's share.
    braked = gap(v=[2.0, 1.0, 2.0, 0.0], a=[0.5, -0.5, 1.0, 0.0])
    ahead = 2.4 * (0.5 * np.array([2.0, 1.0, 2.0]) + np.array([0.5, -0.5, 1.0]) * 2.4 / 12.0)
    assert closing(braked, 0.4) == pytest.approx(1.875 * np.linalg.norm(ahead) / 0.4)
    assert closing(gap(), 0.5) == 0.6


numbers = st.lists(st.floats(-3.0, 3.0), min_size=16, max_size=16)


def at(gap: np.ndarray, t_s: float, duration_s: float) -> np.ndarray:
    out = np.zeros((3, 4))
    add_gap(gap, braking_s(gap), t_s, duration_s, out)
    return out


@given(numbers, st.floats(0.05, 0.95))
def test_it_begins_with_the_gap_ends_with_none_and_its_rates_are_its_slopes(values: list[float], share: float) -> None:
    gap = np.array(values).reshape(4, 4)
    duration_s = closing_s(gap, braking_s(gap), 0.4)
    np.testing.assert_allclose(at(gap, 0.0, duration_s), gap[:3], atol=1e-9)
    for t_s in (duration_s * (1.0 - 1e-9), duration_s, duration_s + 30.0):
        np.testing.assert_allclose(at(gap, t_s, duration_s), 0.0, atol=1e-6)
    t_s, h_s = share * duration_s, 1e-5
    before, after, here = (at(gap, t_s + d, duration_s) for d in (-h_s, h_s, 0.0))
    np.testing.assert_allclose((after[0] - before[0]) / (2.0 * h_s), here[1], atol=1e-4)
    np.testing.assert_allclose((after[1] - before[1]) / (2.0 * h_s), here[2], atol=1e-2)


@pytest.mark.parametrize("distance_m", [0.5, 1.5, 3.0])
def test_a_climb_taken_over_at_speed_does_not_overshoot(distance_m: float) -> None:
    """1.5 m below its goal and rising at 0.5 m/s: slowly there is no reason to go above it."""
    gap = np.zeros((4, 4))
    gap[0, 2], gap[1, 2], gap[2, 2] = -distance_m, 0.5, 2.0
    duration_s = closing_s(gap, braking_s(gap), 0.4)
    assert max(at(gap, t_s, duration_s)[0, 2] for t_s in np.linspace(0.0, duration_s, 200)) < 1e-9


def test_what_is_left_open_is_braked_within_the_gentle_acceleration() -> None:
    gap = np.zeros((4, 4))
    gap[1, 0] = 2.0
    brake_s = braking_s(gap)
    gap[0, 0] = -braked(gap, 0, brake_s)
    assert closing_s(gap, brake_s, 0.4) == brake_s
    assert -gap[0, 0] == pytest.approx(0.5 * 2.0 * brake_s)
    peak = max(np.abs(at(gap, t_s, brake_s)[2, 0]) for t_s in np.linspace(0.0, brake_s, 100))
    assert peak <= ACCELERATION_M_S2 * 1.01


def test_heading_is_no_part_of_the_distance_that_speed_bounds() -> None:
    gap = np.zeros((4, 4))
    gap[0] = 0.6, -0.3, 0.2, 0.0
    straight_s = closing_s(gap, braking_s(gap), 0.4)
    assert straight_s == pytest.approx(15.0 / 8.0 * 0.7 / 0.4)  # the quintic's peak speed is 15/8 of the mean
    gap[0, 3] = 0.5
    assert closing_s(gap, braking_s(gap), 0.4) == straight_s


def test_what_has_little_room_is_braked_harder_and_never_harder_than_a_tilt_can() -> None:
    gap = np.zeros((4, 4))
    gap[1, 2] = -1.5
    far, near, none = (np.array([9.0, 9.0, room_m]) for room_m in (2.0, 0.6, 0.0))
    assert stopping_s(gap, far) == braking_s(gap) == pytest.approx(1.2)
    assert stopping_s(gap, near) == pytest.approx(0.8)  # 0.6 m at a mean of 0.75 m/s
    hardest_s = stopping_s(gap, none)
    track = np.array([at_braked(gap, hardest_s, t_s)[2, 2] for t_s in np.linspace(0.0, hardest_s, 200)])
    assert np.abs(track).max() == pytest.approx(4.0, rel=0.02)


def at_braked(gap: np.ndarray, brake_s: float, t_s: float) -> np.ndarray:
    """Of a gap whose distance is all braked away."""
    resting = gap.copy()
    resting[0] = [-braked(gap, column, brake_s) for column in range(4)]
    out = np.zeros((3, 4))
    add_gap(resting, brake_s, t_s, brake_s * 1.001, out)
    return out
