"""Where each drone comes down: straight under itself, unless another will stand there. Pure."""

import numpy as np

from formation.config import LimitsConfig
from formation.maths.arrays import Float

CLEARANCE = 1.5  # of the minimum separation: drones on the floor are not led any more
RINGS, DIRECTIONS = 12, 16
INSET_M = 0.1


def landing_spots(pos_lab_m: Float, limits: LimitsConfig) -> Float:
    """A spot on the floor for each drone, (m, 2); its own x, y where that is free of lower drones' spots.

    pos_lab_m: (m, 3). One above another gets the nearest free spot beside, inside the fence; if there is none, its own.
    """
    clear_m = CLEARANCE * limits.min_separation_m
    spots = pos_lab_m[:, :2].copy()
    occupied: list[int] = []
    for i in np.argsort(pos_lab_m[:, 2], kind="stable"):
        if occupied and _distance(spots[occupied], spots[i]) < clear_m:
            others = [j for j in range(len(spots)) if j != i]
            spots[i] = _beside(spots[i], spots[others], clear_m, limits)
        occupied.append(int(i))
    return spots


def _beside(own: Float, others: Float, clear_m: float, limits: LimitsConfig) -> Float:
    low = np.array(limits.fence.low_m[:2]) + INSET_M
    high = np.array(limits.fence.high_m[:2]) - INSET_M
    angles = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    for k in range(1, RINGS + 1):
        candidates = own + 0.5 * k * clear_m * ring
        for spot in candidates[((candidates >= low) & (candidates <= high)).all(axis=-1)]:
            if _distance(others, spot) >= clear_m:
                return np.asarray(spot)
    return own


def _distance(spots: Float, spot: Float) -> float:
    return float(np.linalg.norm(spots - spot, axis=-1).min())
