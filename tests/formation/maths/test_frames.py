"""Frames against hand-computed rotations, and their algebra as properties."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formation.maths import frames

HALF = np.sqrt(0.5)
unit = st.floats(-1.0, 1.0, allow_nan=False)
quaternions = (
    st.tuples(unit, unit, unit, unit)
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: frames.canonical(np.array(q)))
)
vectors = st.tuples(*[st.floats(-10.0, 10.0)] * 3).map(np.array)
angles = st.floats(-20.0, 20.0)


def test_yaw_left_by_quarter_turn_takes_forward_to_left():
    q_lab_from_flu = frames.from_yaw(np.pi / 2)
    np.testing.assert_allclose(q_lab_from_flu, [HALF, 0.0, 0.0, HALF])
    np.testing.assert_allclose(frames.rotate(q_lab_from_flu, np.array([1.0, 0.0, 0.0])), [0.0, 1.0, 0.0], atol=1e-15)


def test_positive_pitch_about_left_axis_points_the_nose_down():
    q_lab_from_flu = frames.from_rotation_vector(np.array([0.0, np.radians(30.0), 0.0]))
    forward_lab = frames.rotate(q_lab_from_flu, np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(forward_lab, [np.cos(np.radians(30.0)), 0.0, -0.5], atol=1e-15)


@pytest.mark.parametrize("angle_rad", [0.0, 1e-12, 1e-6])
def test_rotation_vector_is_regular_at_zero(angle_rad):
    q = frames.from_rotation_vector(np.array([angle_rad, 0.0, 0.0]))
    np.testing.assert_allclose(q, [1.0, 0.5 * angle_rad, 0.0, 0.0], atol=1e-15)


def test_wrap_angle_includes_pi_not_minus_pi():
    np.testing.assert_allclose(frames.wrap_angle(np.array([np.pi, -np.pi, 3 * np.pi, 0.1])), [np.pi, np.pi, np.pi, 0.1])


def test_lead_axes_follow_equation_2():
    """A follower 1 m ahead of a leader facing lab left is 1 m to lab left."""
    np.testing.assert_allclose(frames.rotate_about_z(np.pi / 2, np.array([1.0, 0.0, 0.2])), [0.0, 1.0, 0.2], atol=1e-15)


@given(quaternions, quaternions, vectors)
def test_composition_is_rotation_after_rotation(q_a_from_b, q_b_from_c, v_c):
    once = frames.rotate(frames.multiply(q_a_from_b, q_b_from_c), v_c)
    twice = frames.rotate(q_a_from_b, frames.rotate(q_b_from_c, v_c))
    np.testing.assert_allclose(once, twice, atol=1e-12)


@given(quaternions, vectors)
def test_inverse_undoes_and_length_is_kept(q_a_from_b, v_b):
    v_a = frames.rotate(q_a_from_b, v_b)
    np.testing.assert_allclose(frames.rotate(frames.inverse(q_a_from_b), v_a), v_b, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(v_a), np.linalg.norm(v_b), atol=1e-12)


@given(quaternions, vectors)
def test_matrix_is_the_same_rotation_and_proper(q_a_from_b, v_b):
    r_a_from_b = frames.matrix(q_a_from_b)
    np.testing.assert_allclose(r_a_from_b @ v_b, frames.rotate(q_a_from_b, v_b), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(r_a_from_b), 1.0, atol=1e-12)


@given(angles, vectors)
def test_yaw_of_a_heading_is_that_heading(yaw_rad, v_lead):
    q_lab_from_lead = frames.from_yaw(yaw_rad)
    assert q_lab_from_lead[0] >= 0.0
    difference = frames.wrap_angle(frames.yaw(q_lab_from_lead) - yaw_rad)
    assert min(abs(difference), abs(abs(difference) - 2 * np.pi)) < 1e-9
    np.testing.assert_allclose(
        frames.rotate(q_lab_from_lead, v_lead), frames.rotate_about_z(yaw_rad, v_lead), atol=1e-9
    )
