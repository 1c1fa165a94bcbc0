"""Poses from rows of matrices and quaternions, against hand computation and the definition."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mocap.sources.poses import from_matrices, from_quaternions


def quaternions(matrices):
    """Of matrices that are written row by row, and, the same, column by column."""
    n = len(matrices)
    _, q, _ = from_matrices(np.hstack((np.ones((n, 3)), matrices.reshape(n, 9))), False, 1.0, False)
    columns = matrices.swapaxes(1, 2).reshape(n, 9)
    np.testing.assert_array_equal(from_matrices(np.hstack((np.ones((n, 3)), columns)), True, 1.0, False)[1], q)
    return q


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
        np.diag([1.0, 1.0, -1.0]),
        1.1 * np.eye(3),
        np.full((3, 3), np.nan),
        np.full((3, 3), 1e300),
    ],
)
def test_what_is_no_rotation_is_no_quaternion(matrix):
    np.testing.assert_array_equal(quaternions(matrix[None])[0], np.zeros(4))


def test_lost_is_what_the_system_writes_for_it_and_every_other_number_is_passed_on():
    nan, inf = np.nan, np.inf
    positions = np.array([[nan, 1.0, 2.0], [1000.0, nan, 2.0], [0.0, 0.0, 0.0], [inf, 0.0, -500.0]])
    rows = np.hstack((positions, np.tile(np.eye(3).ravel(), (4, 1))))
    pos_m, _, seen = from_matrices(np.float32(rows), True, 0.001, True)
    assert seen.tolist() == [False, False, True, True]
    np.testing.assert_allclose(pos_m, [[0.0] * 3, [0.0] * 3, [0.0] * 3, [inf, 0.0, -0.5]])
    pos_m, _, seen = from_matrices(rows, True, 0.001, False)
    assert seen.tolist() == [True, True, False, True]
    np.testing.assert_allclose(pos_m, [[nan, 0.001, 0.002], [1.0, nan, 0.002], [0.0] * 3, [inf, 0.0, -0.5]])


@pytest.mark.parametrize("numbers", [np.float32, np.float64])
def test_quaternions_have_w_in_front_and_positions_are_metres(numbers):
    signalling = np.array([0x7FF0000000000001], np.uint64).view(np.float64)[0]
    rows = np.array([[1.0, 2.0, 3.0, 0.5, -0.5, 0.25, 0.75], [np.nan, np.inf, 0.0, 0.0, np.nan, 0.0, 1.0]], numbers)
    if numbers is np.float64:
        rows[1, 0] = signalling
    pos_m, q = from_quaternions(rows, 0.25)
    np.testing.assert_array_equal(pos_m, [[0.25, 0.5, 0.75], [np.nan, np.inf, 0.0]])
    np.testing.assert_array_equal(q, [[0.75, 0.5, -0.5, 0.25], [1.0, 0.0, np.nan, 0.0]])
    assert from_quaternions(rows[:0], 1.0)[0].shape == (0, 3)
