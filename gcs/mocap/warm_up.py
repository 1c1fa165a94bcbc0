"""Compiles what the mocap process runs, before it serves."""

import numpy as np

from formation.config import LabConfig
from formation.maths.frames import IDENTITY
from formation.messages import RawFrame
from gcs.mocap.core import MocapCore


def warm_up(config: LabConfig) -> None:
    """Align one frame that nobody sees."""
    bodies = tuple(v.body for v in config.vehicles)
    n = len(bodies)
    frame = RawFrame(0, 0, bodies, np.zeros((n, 3)), np.tile(IDENTITY, (n, 1)), np.ones(n, np.bool_))
    MocapCore(config).receive(frame, 1)
