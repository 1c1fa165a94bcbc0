"""Late poses of a body that rises and falls, against inertial sensors that are wrong and noisy; no others are found."""

import numpy as np
import pytest

from drone_agent.flight.pose_lag import PoseLag
from formation.maths.arrays import Float
from tests.drone_agent.agent_harness import Harness, S, hover_over, target

STEP_S = 0.01
NOISE_M = 0.001


def swinging(seconds: float, seed: int) -> tuple[Float, Float]:
    """Height and its rate of a body that rises and falls by four swings of any frequency from 0.3 to 0.8 Hz."""
    rng = np.random.default_rng(seed)
    t_s = STEP_S * np.arange(round(seconds / STEP_S))
    pos, vel = np.zeros_like(t_s), np.zeros_like(t_s)
    for rate, phase in zip(2.0 * np.pi * rng.uniform(0.3, 0.8, 4), rng.uniform(0.0, 2.0 * np.pi, 4), strict=True):
        pos += 0.25 / rate * np.sin(rate * t_s + phase)
        vel += 0.25 * np.cos(rate * t_s + phase)
    return pos, vel


def told(
    seconds: float, seed: int, late_s: float, from_s: float, walk: float = 0.0
) -> tuple[PoseLag, Float, list[float]]:
    """The follower after that flight, what velocities were reckoned off by, and when poses were found late, s."""
    rng = np.random.default_rng([seed, 1])
    pos, vel = swinging(seconds, seed)
    wrong = np.cumsum(walk * np.sqrt(STEP_S) * rng.standard_normal(len(pos)) + 0.2 * STEP_S)
    reckoned = pos + np.cumsum(wrong) * STEP_S
    lag, found = PoseLag(0, 0.0, 0.0), []
    for k in range(1, len(pos)):
        shown = pos[max(k - round(late_s / STEP_S), 0)] if k * STEP_S > from_s else pos[k]
        offset = shown + NOISE_M * rng.standard_normal() - reckoned[k]
        if lag.update(round(k * STEP_S * S), offset, vel[k] + wrong[k], NOISE_M**2, walk * walk):
            found.append(k * STEP_S)
    return lag, wrong, found


@pytest.mark.parametrize("late_s", [0.12, 0.19, 0.25])
def test_poses_that_are_late_are_found_and_what_reckoning_is_off_by_is_known(late_s: float) -> None:
    for seed in range(20):
        lag, wrong, found = told(16.0, seed, late_s, 10.0)
        assert 10.0 < found[0] < 14.0, (seed, found[:1])
        assert lag.on_time[1] == pytest.approx(-wrong[-1], abs=0.2), seed


@pytest.mark.parametrize(("late_s", "walk"), [(0.0, 0.0), (0.04, 0.0), (0.0, 0.03), (0.04, 0.09)])
def test_nothing_is_found_where_they_are_not(late_s: float, walk: float) -> None:
    for seed in range(3):
        assert told(300.0, seed, late_s, 0.0, walk)[2] == []


def test_a_drone_that_bobs_by_late_poses_refuses_them_and_knows_its_velocity() -> None:
    """They came 0.19 s late after a gap as long; what it took its climb for was wrong by 0.5 m/s, and it fell."""
    harness = Harness(pose="mocap", profile="px4_quad")
    harness.fly_offboard(1.5, hover_over(0.0, 0.0, 1.5))
    hover, shown, refused_s = harness.config.true_vehicle().hover_thrust_norm, [], []
    level, late, begins = np.array([1.0, 0.0, 0.0, 0.0]), 19, 300
    for k in range(begins + late + 300):
        thrust = hover * (1.0 + 0.25 * np.sin(2.0 * np.pi * 0.5 * 0.01 * k + 0.5 * np.pi))
        harness.run(0.01, lambda harness, thrust=thrust: target(harness, thrust, level), mocap=False)
        shown.append((harness.truth.pos_lab_m, harness.truth.q_lab_from_flu))
        if not begins <= k < begins + late:
            harness.show(*shown[k if k < begins else k - late])
        if harness.core.autopilot.positioning.is_drifting:
            refused_s.append(0.01 * (k - begins - late))
            belief = harness.core.autopilot.belief(harness.now_ns)
            assert abs(belief.vel_lab_m_s[2] - harness.truth.vel_lab_m_s[2]) < 0.15
    assert 0.0 <= refused_s[0] < 2.0
