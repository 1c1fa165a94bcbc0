"""Distinguishes lost bodies, whose last pose is repeated, from bodies at rest. Pure.

Cameras have noise: the pose of a body at rest varies. A body is lost when its pose has varied and then stays the same
to the last bit. Bodies without noise, as simulators show them, are never lost here.
"""

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Bool, Float

REVERSALS = 5
"""So many steps in a row against the one before: no smooth motion has them, noise has them within 0.3 s at 100 Hz."""


class Repeats:
    """Of all bodies of one source, by row."""

    def __init__(self) -> None:
        self._pos = np.full((0, 3), np.nan)
        self._step = np.zeros((0, 3))
        self._reversals = np.zeros(0, np.int64)
        self._noisy = np.zeros(0, np.bool_)

    def lost(self, rows: NDArray[np.intp], poses: Float, same: Bool) -> Bool:
        """Which of the poses (k, 7) of `rows` (k,) show a lost body; same: those that are the last ones, bit by bit."""
        self._grow(int(rows.max(initial=-1)) + 1)
        noisy = self._noisy[rows]
        if noisy.all():
            return same
        with np.errstate(all="ignore"):  # any numbers at all come
            step = poses[:, :3] - self._pos[rows]
            back = (step * self._step[rows]).sum(axis=1) < 0.0
        moved = rows[~same]
        self._reversals[moved] = np.where(back, self._reversals[rows] + 1, 0)[~same]
        self._pos[moved], self._step[moved] = poses[~same, :3], step[~same]
        self._noisy[moved] |= self._reversals[moved] >= REVERSALS
        lost: Bool = same & noisy
        return lost

    def _grow(self, n: int) -> None:
        more = n - len(self._pos)
        if more > 0:
            self._pos = np.vstack((self._pos, np.full((more, 3), np.nan)))
            self._step = np.vstack((self._step, np.zeros((more, 3))))
            self._reversals = np.append(self._reversals, np.zeros(more, np.int64))
            self._noisy = np.append(self._noisy, np.zeros(more, np.bool_))
