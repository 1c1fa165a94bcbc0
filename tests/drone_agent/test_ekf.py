"""The simulated autopilot's filter against the textbook: dense matrices, and a motion that is known in closed form."""

import numpy as np
import pytest

from drone_agent.flight import ekf
from formation.maths.arrays import Float
from formation.maths.frames import from_rotation_vector, matrix, rotate
from formation.vehicle.body import GRAVITY_M_S2

DT_S = 0.005
UP_G = np.array([0.0, 0.0, GRAVITY_M_S2])


class Filter:
    """One filter and its history."""

    def __init__(self, q_lab_from_flu: Float | None = None) -> None:
        self.x, self.cov = np.empty(16), np.empty((15, 15))
        self.history, self.row = np.full((ekf.HISTORY, 5), -np.inf), 0
        self.climbed, self.rate = np.zeros(1), np.zeros(3)
        ekf.begin(self.x, self.cov, np.array([1.0, -2.0, 0.5]), 0.0)
        self.history[0] = 0.0
        if q_lab_from_flu is not None:
            self.x[:4] = q_lab_from_flu
        self.t_s = 0.0

    def predict(self, force: Float, rate: Float) -> None:
        self.row, self.t_s = (self.row + 1) % ekf.HISTORY, self.t_s + DT_S
        sample = np.concatenate([force, rate])
        ekf.predict(
            self.x, self.cov, sample, self.t_s, DT_S, self.history, self.row, self.climbed, self.rate
        )  # fmt: skip

    def observe(self, t_s: float, pose: Float, noise: Float) -> Float:
        ratios = np.zeros(3)
        ekf.observe_pose(self.x, self.cov, self.history, self.row, t_s, pose, noise, ratios)
        return ratios


def cross(v: Float) -> Float:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def test_the_covariance_advances_as_dense_matrices_say() -> None:
    """F P F' + Q, F = 1 + A dt of the error equations; Q by PX4's EKF2_*_NOISE, (noise * 10 ms)^2 a step of 10 ms."""
    rng = np.random.default_rng(3)
    filter_ = Filter(from_rotation_vector(np.array([0.3, -0.2, 0.9])))
    root = rng.standard_normal((15, 15))
    filter_.cov[:] = root @ root.T
    before, r = filter_.cov.copy(), matrix(filter_.x[:4])
    force, rate = np.array([0.4, -1.1, 10.3]), np.array([0.5, 0.2, -0.3])
    halfway = matrix(from_rotation_vector(r @ rate * DT_S / 2.0)) @ r @ force
    a = np.zeros((15, 15))
    a[0:3, 9:12] = -r
    a[3:6, 0:3], a[3:6, 12:15] = -cross(halfway), -r
    a[6:9, 3:6] = np.eye(3)
    f = np.eye(15) + DT_S * a
    q = np.diag(np.repeat([0.015**2, 0.35**2, 0.0, 0.001**2, 0.003**2], 3)) * 0.01 * DT_S
    filter_.predict(force, rate)
    np.testing.assert_allclose(filter_.cov, f @ before @ f.T + q, rtol=1e-4, atol=1e-4)


def test_a_turning_body_that_accelerates_is_followed() -> None:
    """Constant rate about its own axis and a constant push in the lab: closed form, no noise, ten seconds."""
    rate, push = np.array([0.6, -0.4, 0.3]), np.array([0.2, -0.1, 0.05])
    filter_ = Filter()
    for k in range(2000):
        halfway = from_rotation_vector(rate * (k + 0.5) * DT_S)
        inverse = halfway * [1.0, -1.0, -1.0, -1.0]
        filter_.predict(rotate(inverse, push + UP_G), rate)
    np.testing.assert_allclose(filter_.x[4:7], 10.0 * push, atol=2e-3)
    np.testing.assert_allclose(filter_.x[7:10], [1.0, -2.0, 0.5] + 50.0 * push, atol=1e-2)
    assert abs(filter_.x[:4] @ from_rotation_vector(rate * 10.0)) == pytest.approx(1.0, abs=1e-9)


def test_a_pose_is_observed_where_the_body_was_at_its_capture() -> None:
    """At 2 m/s a pose 50 ms old lies 0.1 m behind: no innovation, and none of the estimate moves."""
    filter_ = Filter()
    filter_.x[4] = 2.0
    for _ in range(100):
        filter_.predict(UP_G, np.zeros(3))
    before = filter_.x.copy()
    pose = np.array([1.0 + 2.0 * (filter_.t_s - 0.05), -2.0, 0.5, 0.0])
    ratios = filter_.observe(filter_.t_s - 0.05, pose, np.array([0.01, 0.1, 5.0, 2.6]))
    assert np.all(ratios < 1e-12)
    np.testing.assert_allclose(filter_.x, before, atol=1e-9)


def test_a_scalar_is_weighed_as_kalman_says() -> None:
    filter_ = Filter()
    for _ in range(10):
        filter_.predict(UP_G, np.zeros(3))
    before, height_m = filter_.cov.copy(), filter_.x[9]
    noise = np.array([0.1, 1e6, 5.0, 5.0])  # of the heading, nothing is believed
    pose = np.array([*filter_.x[7:9], height_m + 0.2, 0.0])
    filter_.observe(filter_.t_s, pose, noise)
    gain = before[:, 8] / (before[8, 8] + 0.01)
    assert filter_.x[9] - height_m == pytest.approx(0.2 * gain[8], rel=1e-3)
    assert filter_.x[6] == pytest.approx(0.2 * gain[5], rel=1e-3)
    assert filter_.cov[8, 8] == pytest.approx(before[8, 8] * (1.0 - gain[8]), rel=1e-3)


def test_what_lies_outside_its_limit_is_not_observed() -> None:
    filter_ = Filter()
    filter_.cov[6:9, 6:9] = 1e-4 * np.eye(3)
    filter_.predict(UP_G, np.zeros(3))
    before = filter_.x.copy()
    # Five standard deviations are 0.07 m: noise and variance of 0.01 m squared each, and 0.5 m/s over 5 ms.
    ratios = filter_.observe(filter_.t_s, np.array([1.1, -2.0, 0.5, 0.0]), np.array([0.01, 0.1, 5.0, 2.6]))
    assert ratios[0] == pytest.approx(0.1**2 / (25.0 * (2e-4 + (0.5 * DT_S) ** 2)), rel=1e-3)
    assert filter_.x[7] == pytest.approx(before[7])
