"""Tilts of many attitudes at once are those of each, to the bit."""

import numpy as np

from formation.safety.attitude_innovation import tilt, tilts


def test_tilts_of_many_are_those_of_each_to_the_bit() -> None:
    q = np.random.default_rng(2).normal(size=(50, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    assert tilts(q) == [tilt(row) for row in q.tolist()]


def test_a_roll_to_the_left_shows_gravity_to_its_side() -> None:
    """0.2 rad about x: sin 0.2 along y."""
    ((x, y),) = tilts(np.array([[np.cos(0.1), np.sin(0.1), 0.0, 0.0]]))
    assert (x, round(y, 12)) == (0.0, round(float(np.sin(0.2)), 12))
