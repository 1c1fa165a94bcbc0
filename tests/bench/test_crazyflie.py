"""The world of firmware in the loop: what its gyroscope shows is what its body does."""

import struct

import numpy as np
import pytest

from bench.crazyflie import GYRO_DEG_S, STEP_NS, World
from formation.maths.frames import rotation_vector

LOW, HIGH = 10_000, 50_000


@pytest.mark.parametrize(
    ("axis", "pwm"),
    [(0, (LOW, LOW, HIGH, HIGH)), (1, (LOW, HIGH, HIGH, LOW)), (2, (LOW, HIGH, LOW, HIGH))],
    ids=["roll", "pitch", "yaw"],
)
def test_its_gyroscope_shows_what_its_attitude_turns_by(axis: int, pwm: tuple[int, int, int, int]) -> None:
    world, shown_rad = World(1), np.zeros(3)
    world.x[2] = 5.0
    world.receive_motors(*pwm)
    for _ in range(100):
        rates = struct.unpack("<6h", world.step()[2:])[3:]
        shown_rad += np.radians(np.array(rates) * GYRO_DEG_S) * STEP_NS * 1e-9
    turned_rad = rotation_vector(world.x[6:10])
    assert turned_rad[axis] > 0.05
    assert shown_rad == pytest.approx(turned_rad, rel=0.02, abs=0.002)
