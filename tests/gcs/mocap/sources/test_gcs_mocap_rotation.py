"""Rotation matrices as quaternions, against hand computation and the definition."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gcs.mocap.sources.rotation import quaternions


def test_matrices_are_what_scipy_makes_of_them():
    rotations = Rotation.random(500, random_state=7)
    ours = quaternions(rotations.as_matrix())
    theirs = rotations.as_quat(scalar_first=True)
    np.testing.assert_allclose(ours, theirs * np.where(theirs[:, :1] < 0.0, -1.0, 1.0), atol=1e-12)


@pytest.mark.parametrize(
    ("matrix", "expected"),
    [
        (np.diag([1.0, -1.0, -1.0]), [0.0, 1.0, 0.0, 0.0]),
        (np.diag([-1.0, 1.0, -1.0]), [0.0, 0.0, 1.0, 0.0]),
        (np.diag([-1.0, -1.0, 1.0]), [0.0, 0.0, 0.0, 1.0]),
        (np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]),
    ],
)
def test_half_turns_and_a_quarter_turn_by_hand(matrix, expected):
    np.testing.assert_allclose(quaternions(matrix[None])[0], expected, atol=1e-15)


@pytest.mark.parametrize(
    "matrix",
    [
        np.zeros((3, 3)),
        np.diag([1.0, 1.0, -1.0]),
        1.1 * np.eye(3),
        np.full((3, 3), np.nan),
        np.full((3, 3), 1e300),
        np.diag([np.inf, 1.0, 1.0]),
    ],
)
def test_what_is_no_rotation_is_no_quaternion(matrix):
    np.testing.assert_array_equal(quaternions(matrix[None])[0], np.zeros(4))


def test_none_at_all():
    assert quaternions(np.zeros((0, 3, 3))).shape == (0, 4)
