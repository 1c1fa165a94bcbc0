"""Compiles what the mocap process runs, before it serves."""

import numpy as np

from formation.config import LabConfig
from formation.maths.frames import IDENTITY
from formation.messages import RawFrame
from mocap.core import MocapCore
from mocap.sources import poses

QUATERNIONS = {"vrpn": np.float64, "chingmu": np.float64, "natnet": np.float32}
MATRICES = {"qualisys": np.float32, "vicon": np.float64}
"""The numbers that each source sends, and as what."""


def warm_up(config: LabConfig) -> None:
    """Read and align one frame that nobody sees."""
    bodies = tuple(v.body for v in config.vehicles)
    n = len(bodies)
    frame = RawFrame(0, 0, bodies, np.zeros((n, 3)), np.tile(IDENTITY, (n, 1)), np.ones(n, np.bool_))
    MocapCore(config).receive(frame, 1)
    read(config.mocap.source)


def read(source: str) -> None:
    """Read one body as the source's client does, where it has poses to convert."""
    if source in QUATERNIONS:
        poses.from_quaternions(np.zeros((1, 7), QUATERNIONS[source]), 1.0)
    elif source in MATRICES:
        poses.from_matrices(np.zeros((1, 12), MATRICES[source]), by_columns=True, unit_m=1.0, lost_is_nan=True)
