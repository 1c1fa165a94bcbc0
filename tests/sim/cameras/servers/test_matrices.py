"""Matrices of quaternions, against scipy."""

import numpy as np
from scipy.spatial.transform import Rotation

from sim.cameras.servers.matrices import matrices


def test_quaternions_are_what_scipy_makes_of_them():
    rotations = Rotation.random(200, random_state=2)
    np.testing.assert_allclose(matrices(rotations.as_quat(scalar_first=True)), rotations.as_matrix(), atol=1e-14)
    assert matrices(np.zeros((0, 4))).shape == (0, 3, 3)
