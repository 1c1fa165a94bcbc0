"""The quaternions of compiled loops against rotation matrices."""

import numpy as np
import pytest

from formation.maths import frames
from formation.maths.quaternion import multiply_into, rotate_into, turn_into
from tests.formation.oracles.frames import axis_angle, rotation_matrix

RNG = np.random.default_rng(2)
PAIRS = [tuple(q / np.linalg.norm(q) for q in RNG.normal(size=(2, 4))) for _ in range(8)]


@pytest.mark.parametrize(("a", "b"), PAIRS)
def test_a_product_is_the_product_of_the_matrices(a: np.ndarray, b: np.ndarray) -> None:
    out = np.empty(4)
    multiply_into(a, b, out)
    np.testing.assert_allclose(rotation_matrix(out), rotation_matrix(a) @ rotation_matrix(b), atol=1e-12)
    np.testing.assert_allclose(frames.multiply(a, b), out, atol=1e-15)
    assert a[0] * b[0] - a[1:] @ b[1:] == pytest.approx(out[0])  # not its negative


@pytest.mark.parametrize(("a", "b"), PAIRS)
def test_a_rotated_vector_is_the_matrix_times_it(a: np.ndarray, b: np.ndarray) -> None:
    out = np.empty(3)
    rotate_into(a, b[:3], out)
    np.testing.assert_allclose(out, rotation_matrix(a) @ b[:3], atol=1e-12)
    np.testing.assert_allclose(frames.rotate(a, b[:3]), out, atol=1e-12)


@pytest.mark.parametrize(("a", "b"), PAIRS)
def test_a_small_turn_is_the_exponential_to_second_order(a: np.ndarray, b: np.ndarray) -> None:
    angle = 0.01 * b[:3]
    out = np.empty(4)
    turn_into(a, angle, out)
    size = np.linalg.norm(angle)
    np.testing.assert_allclose(rotation_matrix(out), rotation_matrix(a) @ axis_angle(angle / size, size), atol=1e-6)
    assert out[0] >= 0.0
    assert np.linalg.norm(out) == pytest.approx(1.0, abs=1e-12)
    turn_into(-a, angle, out)
    assert out[0] >= 0.0
