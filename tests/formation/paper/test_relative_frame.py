import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from formation.maths import frames
from formation.maths.arrays import Float
from formation.paper.eq2_relative_frame import lab_from_lead, lead_from_lab

small = st.floats(-3.0, 3.0)
motions = st.lists(small, min_size=12, max_size=12).map(lambda v: np.array(v).reshape(3, 4))


def at(motion: Float, t: float) -> Float:
    """Position and heading a time t along a motion of constant acceleration."""
    return motion[0] + t * motion[1] + 0.5 * t * t * motion[2]


def seen_from(motion_lab: Float, frame: Float, t: float) -> Float:
    """Eq. (2), literally."""
    x, origin = at(motion_lab, t), at(frame, t)
    c, s = np.cos(origin[3]), np.sin(origin[3])
    d = x - origin
    return np.array([c * d[0] + s * d[1], -s * d[0] + c * d[1], d[2], d[3]])


@given(motions, motions)
def test_lead_from_lab_is_eq_2_and_its_numerical_derivatives(motion: Float, frame: Float) -> None:
    out = np.empty((3, 4))
    lead_from_lab(motion, frame, out)
    h = 1e-4
    before, now, after = (seen_from(motion, frame, t) for t in (-h, 0.0, h))
    np.testing.assert_allclose(out[0], now, atol=1e-12)
    np.testing.assert_allclose(out[1], (after - before) / (2.0 * h), atol=1e-4)
    np.testing.assert_allclose(out[2], (after - 2.0 * now + before) / h**2, atol=1e-3)


@given(motions, motions)
def test_lab_from_lead_is_the_inverse(motion: Float, frame: Float) -> None:
    inside, back = np.empty((3, 4)), np.empty((3, 4))
    lead_from_lab(motion, frame, inside)
    lab_from_lead(inside, frame, back)
    np.testing.assert_allclose(back, motion, atol=1e-10)


def test_a_slot_of_a_leader_turning_on_the_spot_moves_in_a_circle() -> None:
    slot, frame, out = np.zeros((3, 4)), np.zeros((3, 4)), np.empty((3, 4))
    slot[0, 0], frame[1, 3] = -0.5, 2.0
    lab_from_lead(slot, frame, out)
    np.testing.assert_allclose(out[1, :3], [0.0, -1.0, 0.0])
    np.testing.assert_allclose(out[2, :3], [2.0, 0.0, 0.0])  # centripetal, towards the leader


def test_position_agrees_with_frames() -> None:
    slot, frame, out = np.zeros((3, 4)), np.zeros((3, 4)), np.empty((3, 4))
    slot[0, :3], frame[0] = [-0.4, 0.3, 0.1], [1.0, 2.0, 3.0, 0.7]
    lab_from_lead(slot, frame, out)
    np.testing.assert_allclose(out[0, :3], frame[0, :3] + frames.rotate_about_z(np.array(0.7), slot[0, :3]))
