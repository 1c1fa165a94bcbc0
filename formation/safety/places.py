"""Where bodies are against a box and against each other. Compiled; nothing is decided here."""

import numpy as np

from formation.maths.arrays import Flags, Scalars, Vec3s
from formation.maths.kernel import kernel
from formation.model import Vec3Tuple


@kernel
def outside_box(pos_lab_m: Vec3s, low_m: Vec3Tuple, high_m: Vec3Tuple) -> Scalars:
    """How far each point is outside the box, along the axis where it is farthest; zero inside; shape (n,)."""
    outside = np.zeros(len(pos_lab_m))
    for i in range(len(pos_lab_m)):
        for axis in range(3):
            beyond = max(low_m[axis] - pos_lab_m[i, axis], pos_lab_m[i, axis] - high_m[axis])
            outside[i] = max(outside[i], beyond)
    return outside


@kernel
def nearest(pos_lab_m: Vec3s, known: Flags) -> Scalars:
    """Distance of each point to the nearest other, among those `known` (n,); infinite for the rest; shape (n,)."""
    near = np.full(len(pos_lab_m), np.inf)
    for i in range(len(pos_lab_m)):
        for j in range(i if known[i] else 0):
            if not known[j]:
                continue
            dx, dy = pos_lab_m[i, 0] - pos_lab_m[j, 0], pos_lab_m[i, 1] - pos_lab_m[j, 1]
            dz = pos_lab_m[i, 2] - pos_lab_m[j, 2]
            distance = np.sqrt(dx * dx + dy * dy + dz * dz)
            near[i], near[j] = min(near[i], distance), min(near[j], distance)
    return near
