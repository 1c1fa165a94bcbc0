"""The bodies of one connection, a row each in every frame, in the order in which they first came. Pure."""

import numpy as np

from formation.maths.arrays import Bool, Float
from mocap.sources.vrpn.assembly import Exposure
from mocap.sources.vrpn.repeats import Repeats

MOST_BODIES = 256
NOWHERE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
"""x y z, quaternion x y z w."""


class Rows:
    """repeats_are_lost: whether a pose that repeats to the last bit, of a body with noise, shows a lost one."""

    def __init__(self, repeats_are_lost: bool) -> None:
        self.names: tuple[str, ...] = ()
        self._by_sensor: dict[tuple[int, int], int | None] = {}
        self._poses = np.zeros((0, 7))
        self._raw: list[bytes] = []
        self._repeats = Repeats() if repeats_are_lost else None

    def find(self, sender: int, sensor: int) -> tuple[bool, int | None]:
        """Whether it is known, and its row; None where it is no body."""
        known = self._by_sensor.get((sender, sensor), -1)
        return known != -1, known

    @property
    def is_full(self) -> bool:
        """Whether no more are remembered."""
        return len(self._by_sensor) >= MOST_BODIES

    def add(self, sender: int, sensor: int, name: str | None) -> int | None:
        """Its row from now on; None where it is no body (`name` None)."""
        row = None if name is None else len(self.names)
        self._by_sensor[sender, sensor] = row
        if name is not None:
            self.names = (*self.names, name)
            self._poses = np.vstack((self._poses, NOWHERE))
            self._raw.append(b"")
        return row

    def fill(self, exposure: Exposure) -> tuple[Float, Bool]:
        """The frame: poses as they came (n, 7), seen (n,). Who did not come keeps its last pose."""
        poses = exposure.poses
        rows = np.fromiter(poses, np.intp, len(poses))
        values = np.frombuffer(b"".join(poses.values()), ">f8").reshape(-1, 7).astype(np.float64)
        seen = np.zeros(len(self.names), np.bool_)
        seen[rows] = True
        if self._repeats is not None:
            same = np.array([self._raw[row] == pose for row, pose in poses.items()], np.bool_)
            seen[rows] = ~self._repeats.lost(rows, values, same)
        for row, pose in poses.items():
            self._raw[row] = pose
        self._poses[rows] = values
        return self._poses, seen
