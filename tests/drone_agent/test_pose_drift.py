"""Poses that begin to slide, against inertial sensors that are wrong and noisy; nothing else is found."""

from collections.abc import Callable

import numpy as np
import pytest

from drone_agent.flight.pose_drift import PoseDrift
from drone_agent.stages import Stage
from formation.maths.arrays import Float
from formation.maths.frames import from_rotation_vector
from tests.drone_agent.agent_harness import LEVEL, MS, Harness, S, hover_at, hover_over, target
from wire.link_messages.motion import LocalPosition
from wire.link_messages.setpoints import AttitudeSetpoint

STEP_S = 0.015
STILL = (0.0, 0.0, 0.0)
WALK = 0.03
"""Velocity random walk of an accelerometer with 0.3 m/s^2 RMS in samples at 100 Hz, m/s per root second."""


def wandering(seconds: float, seed: int, noise_m: float, bias_m_s2: Float, walk: float = WALK) -> Float:
    """Offsets of true poses from dead reckoning: what bias and noise of the accelerometer make of it."""
    rng = np.random.default_rng(seed)
    steps = round(seconds / STEP_S)
    vel = np.cumsum(bias_m_s2 * STEP_S + walk * np.sqrt(STEP_S) * rng.standard_normal((steps, 3)), axis=0)
    offset: Float = -np.cumsum(vel * STEP_S, axis=0) + noise_m * rng.standard_normal((steps, 3))
    return offset


def slid(offsets: Float, slide: Float | None = None, from_s: float = 1e9) -> list[bool]:
    drift, told = PoseDrift(), []
    for k, offset in enumerate(offsets):
        pushed = offset if slide is None else offset + slide * max(k * STEP_S - from_s, 0.0)
        told.append(drift.update(round(k * STEP_S * S), pushed.tolist(), STILL, [WALK * WALK] * 3))
    return told


@pytest.mark.parametrize("heading_rad", [0.0, 2.0, 4.0])
@pytest.mark.parametrize("speed_m_s", [0.15, 0.2, 0.5, 2.0])
def test_a_slide_is_found_within_a_third_of_a_second(speed_m_s: float, heading_rad: float) -> None:
    slide = speed_m_s * np.array([np.cos(heading_rad), np.sin(heading_rad), 0.0])
    for seed in range(5):
        told = slid(wandering(12.0, seed, 0.0003, np.array([0.3, -0.2, 0.1])), slide, 10.0)
        first_s = told.index(True) * STEP_S
        assert 10.0 < first_s < 10.33, (seed, first_s)


@pytest.mark.parametrize(("noise_m", "bias_m_s2"), [(0.0003, 0.1), (0.001, 0.8), (0.004, 0.3), (0.01, 0.0)])
def test_nothing_is_found_where_nothing_slides(noise_m: float, bias_m_s2: float) -> None:
    for seed in range(3):
        assert not any(slid(wandering(600.0, seed, noise_m, np.full(3, bias_m_s2))))


def test_a_change_of_what_the_sensor_is_wrong_by_is_none() -> None:
    """A lean of 2 degrees between the sensor's level and the markers', seen as the drone turns."""
    steps = round(60.0 / STEP_S)
    turned = 0.6 * np.arange(steps) * STEP_S
    force = 0.35 * np.stack([np.cos(turned), np.sin(turned), 0.0 * turned], axis=1)
    assert not any(slid(-np.cumsum(np.cumsum(force * STEP_S, axis=0) * STEP_S, axis=0)))


def test_by_a_noisy_accelerometer_the_body_is_known_from_just_before() -> None:
    """1 m/s^2 of noise at 120 Hz, as PX4's own simulation shows: reckoned on from a second before, the velocity was off
    by 0.13 m/s RMS, 0.3 m/s at most, and a drone that was held by it rose by half a metre."""
    walk, missed = 0.09, []
    for seed in range(40):
        rng, drift = np.random.default_rng(seed), PoseDrift()
        vel, pos = np.zeros(3), np.zeros(3)
        for k in range(round(6.0 / STEP_S)):
            t_s = k * STEP_S
            vel = vel + walk * np.sqrt(STEP_S) * rng.standard_normal(3)
            pos = pos + STEP_S * vel
            slide = np.array([0.5 * max(t_s - 5.0, 0.0), 0.0, 0.0])
            shown = pos + slide + 0.0003 * rng.standard_normal(3)
            if drift.update(round(t_s * S), shown.tolist(), STILL, [walk * walk] * 3):
                missed.append(np.array(drift.offset(round(t_s * S))[1]) - vel)
                break
    assert len(missed) == 40
    assert np.sqrt(np.mean(np.square(missed))) < 0.06


def test_what_it_was_off_by_is_carried_on_and_a_pose_that_comes_back_is_taken() -> None:
    drift = PoseDrift()
    for k in range(2000):
        t_s = k * STEP_S
        slide = 0.4 * (t_s - 15.0) if 15.0 < t_s < 15.6 else 0.0
        told = drift.update(round(t_s * S), [0.1 * t_s + slide, -0.05 * t_s * t_s, 0.0], STILL)
        if 15.1 < t_s < 15.6:
            assert told
            place, rate = drift.offset(round(t_s * S))
            assert place == pytest.approx([0.1 * t_s, -0.05 * t_s * t_s, 0.0], abs=0.03)
            assert rate == pytest.approx([0.1, -0.1 * t_s, 0.0], abs=0.08)
        elif t_s < 15.0 or t_s > 16.2:
            assert not told


def test_a_pose_that_is_not_newer_changes_nothing() -> None:
    drift = PoseDrift()
    for k in range(200):
        drift.update(k * 15 * MS, [0.0, 0.0, 0.0], STILL)
    for t_ns in (2985 * MS, 100 * MS):
        assert not drift.update(t_ns, [5.0, 0.0, 0.0], STILL)
    assert not drift.update(3000 * MS, [0.0, 0.0, 0.0], STILL)


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("speed_m_s", [0.15, 0.5])
def test_in_flight_the_drone_leaves_the_setpoints_holds_and_comes_down(autopilot: str, speed_m_s: float) -> None:
    options = {"GUID_OPTIONS": 8.0} if autopilot == "ardupilot" else {}
    harness = Harness(pose="mocap", autopilot=autopilot, profile="px4_quad", parameters=options)
    harness.fly_offboard(1.0, hover_over(0.0, 0.0, 1.0))
    shown = np.zeros(3)

    def by_what_is_shown(drone: Harness) -> AttitudeSetpoint:
        """A ground that believes the poses: it holds the drone where it seems to be."""
        truth, seems_m_s = drone.truth, drone.truth.vel_lab_m_s[:2] + np.array([speed_m_s, 0.0])
        asked = -1.5 * (truth.pos_lab_m + shown)[:2] - 2.2 * seems_m_s
        lean = np.clip(asked / 9.8, -0.2, 0.2)
        level = hover_at(1.0)(drone)
        assert level is not None
        return level._replace(q_lab_from_flu=from_rotation_vector(np.array([-lean[1], lean[0], 0.0])))

    start = harness.truth.pos_lab_m
    for _ in range(500):
        shown[0] += 0.01 * speed_m_s
        harness.run(0.01, by_what_is_shown, mocap=False)
        harness.show(harness.truth.pos_lab_m + shown)
    texts = harness.texts()
    assert texts.count("Pose rejected, pose drift: hold") == 1
    assert any("pose is rejected" in text and "from the ground, 255/" in text for text in texts)
    assert np.linalg.norm((harness.truth.pos_lab_m - start)[:2]) < 0.25
    assert harness.truth.on_ground
    harness.run(3.0)
    assert not harness.core.autopilot.armed


def shown_at(harness: Harness, steps: int, up_m: Callable[[int], float]) -> list[float]:
    """It hovers, shown that much too high at every step; when its poses were refused as sliding, s."""
    refused_s = []
    for k in range(steps):
        harness.run(0.01, hover_over(0.0, 0.0, 1.0), mocap=False)
        harness.show(harness.truth.pos_lab_m + np.array([0.0, 0.0, up_m(k)]))
        refused_s += [0.01 * k] if harness.core.autopilot.positioning.is_drifting else []
    return refused_s


def assert_believes_the_truth(harness: Harness, within: float) -> None:
    belief, truth = harness.core.autopilot.belief(harness.now_ns), harness.truth
    np.testing.assert_allclose(belief.vel_lab_m_s, truth.vel_lab_m_s, atol=within)
    np.testing.assert_allclose(belief.pos_lab_m, truth.pos_lab_m, atol=within)


def test_poses_that_strayed_before_they_jumped_leave_no_trace() -> None:
    """Right after a gap a slide is not told from what is learned anew, and believed until the pose is 0.3 m off: the
    drone took itself to sink at 1.7 m/s, and climbed to correct that."""
    harness = Harness(pose="mocap", profile="px4_quad")
    harness.fly_offboard(1.0, hover_over(0.0, 0.0, 1.0))
    harness.run(0.3, hover_over(0.0, 0.0, 1.0), mocap=False)
    shown_at(harness, 80, lambda k: -0.01 * k if k < 40 else -1.0)
    assert harness.core.autopilot.positioning.silent_s(harness.now_ns) > 0.1
    assert_believes_the_truth(harness, 0.1)


def test_right_poses_do_not_slide_for_ever_after_wrong_ones() -> None:
    """What had crept up on it was taken for the truth: a drone on the floor believed that it sank, and rose."""
    harness = Harness(pose="mocap", profile="px4_quad")
    harness.fly_offboard(1.0, hover_over(0.0, 0.0, 1.0))
    refused_s = shown_at(harness, 1200, lambda k: 0.05 * (0.01 * k) ** 2 if k < 400 else 0.0)
    assert 4.0 <= refused_s[0] < refused_s[-1] < 10.5
    assert_believes_the_truth(harness, 0.05)


def test_after_five_seconds_without_a_pose_nothing_is_left_of_wrong_ones() -> None:
    """Behind a bridge that shows none while they are wrong: what it was off by then was held against the right ones,
    and a drone that came down blind let go of its thrust."""
    harness = Harness(pose="mocap", profile="px4_quad")
    harness.fly_offboard(1.0, hover_over(0.0, 0.0, 1.0))
    shown_at(harness, 415, lambda k: 0.05 * (0.01 * k) ** 2 if k < 400 else 0.0)
    assert harness.core.autopilot.positioning.silent_s(harness.now_ns) > 0.1
    last_ns = harness.now_ns - round(harness.core.autopilot.positioning.silent_s(harness.now_ns) * S)
    while harness.now_ns < last_ns + 4.95 * S:
        harness.run(0.01, hover_over(0.0, 0.0, 1.0), mocap=False)
    assert shown_at(harness, 60, lambda _: 0.0) == []
    assert_believes_the_truth(harness, 0.02)


@pytest.mark.parametrize("late", [15, 30])
def test_late_poses_are_found_by_an_attitude_that_is_not_felt(late: int) -> None:
    """It leans to and fro; they were believed until they were 0.3 m off, and what was reckoned from them was wrong."""
    harness = Harness(pose="mocap", profile="px4_quad")
    harness.fly_offboard(1.0, hover_over(0.0, 0.0, 1.0))
    hover, shown, refused_s = harness.config.true_vehicle().hover_thrust_norm, [], []
    for k in range(360):
        lean_rad = 0.2 * np.sin(2.0 * np.pi * 0.8 * 0.01 * k)
        q = np.array([np.cos(lean_rad / 2.0), 0.0, np.sin(lean_rad / 2.0), 0.0])
        harness.run(0.01, lambda harness, q=q: target(harness, hover, q), mocap=False)
        shown.append((harness.truth.pos_lab_m, harness.truth.q_lab_from_flu))
        if not 250 <= k < 250 + late:
            harness.show(*shown[k if k < 250 else k - late])
        silent_s = harness.core.autopilot.positioning.silent_s(harness.now_ns)
        refused_s += [0.01 * (k - 250 - late)] if k >= 250 + late and silent_s > 0.05 else []
    assert 0.1 < refused_s[0] < 0.5
    assert "late poses?" in str(harness.core.autopilot.positioning.fault(harness.now_ns))
    np.testing.assert_allclose(
        harness.core.autopilot.belief(harness.now_ns).vel_lab_m_s, harness.truth.vel_lab_m_s, atol=0.1
    )


def test_a_moment_of_it_is_held_through() -> None:
    harness = Harness(pose="mocap", profile="px4_quad")
    harness.fly_offboard(1.0, hover_over(0.0, 0.0, 1.0))
    for k in range(60):
        harness.run(0.01, hover_over(0.0, 0.0, 1.0), mocap=False)
        harness.show(harness.truth.pos_lab_m + np.array([0.003 * min(k, 15), 0.0, 0.0]) * (k < 25), LEVEL)
        if k == 20:
            assert harness.core.autopilot.stream.stage is Stage.HOLD
    harness.run(0.5, hover_over(0.0, 0.0, 1.0))
    assert harness.core.autopilot.stream.stage is Stage.FOLLOW
    assert harness.last(LocalPosition).pos_lab_m == pytest.approx(harness.truth.pos_lab_m, abs=0.03)


def test_poses_that_come_late_do_not_take_the_reckoning_with_them() -> None:
    """A drone that rises faster and faster, 0.28 s later than its poses say: it was taken to sink while it rose."""
    drift, found = PoseDrift(), []
    for k in range(1, 800):
        t_s = k * STEP_S
        rise_s = max(t_s - 8.0, 0.0)
        vel_m_s = min(4.0 * rise_s, 3.0)
        told = drift.update(round(t_s * S), (0.0, 0.0, -0.28 * vel_m_s), (0.0, 0.0, vel_m_s))
        if told:
            found.append(t_s)
            assert abs(drift.offset(round(t_s * S))[1][2]) < 0.1
    assert 8.0 < found[0] < 8.6
