"""Limits on a demanded force and the rates of its attitude, in vectors. Imports nothing of the product."""

from dataclasses import dataclass

import numpy as np

from tests.formation.oracles.frames import attitude_matrix

TILT, LOW, HIGH, FENCE = 1, 2, 4, 16


@dataclass(frozen=True)
class Bounds:
    tilt: float
    low: np.ndarray
    high: np.ndarray
    margin: float = 0.05


def inside(motion: np.ndarray, acc: np.ndarray, bounds: Bounds, lands: bool = False) -> tuple[np.ndarray, int]:
    """No more acceleration towards a wall than lets the vehicle brake with 4 m/s^2; landing, not of the floor."""
    acc, bits = acc.copy(), 0
    for axis in range(3):
        for outward, wall in ((-1.0, bounds.low[axis]), (1.0, bounds.high[axis])):
            if lands and (axis, outward) == (2, -1.0):
                continue
            room = outward * (wall - motion[0, axis]) - bounds.margin
            speed = outward * motion[1, axis]
            if room > 0.0:
                allowed = np.sqrt(2.0 * 4.0 * room)
                most = 4.0 * (allowed - speed) - 4.0 * max(speed, 0.0) / allowed
            else:
                most = 4.0 * (4.0 * room - speed)
            if outward * acc[axis] > most:
                acc[axis], bits = outward * most, FENCE
    return acc, bits


def bounded(force: np.ndarray, least: float, lift_most: float, tilt: float) -> tuple[np.ndarray, int]:
    """Height before sideways: from the least to 0.88 of the lift, then what tilt and thrust leave."""
    up = float(np.clip(force[2], least, 0.88 * lift_most))
    bits = LOW if force[2] < up else HIGH if force[2] > up else 0
    flat = force[:2]
    most = min(up * np.tan(tilt), np.sqrt(lift_most**2 - up**2))
    size = np.linalg.norm(flat)
    if size > most:
        flat, bits = flat * most / size, bits | TILT
    return np.array([flat[0], flat[1], up]), bits


def turned(force: np.ndarray, now: np.ndarray, authority: float, length: float, full: float) -> np.ndarray:
    """Sideways no further from the force of now than the motors' torque can turn."""
    gap = force[:2] - now[:2]
    share = np.interp(force[2], [0.5 * full, full], [1.0, length**2])
    most = authority * force[2] * max(min(force[2], share * (full - force[2])), 0.0)
    size = np.linalg.norm(gap)
    flat = now[:2] + gap * min(1.0, most / size) if size > 0.0 else force[:2]
    return np.array([flat[0], flat[1], force[2]])


def flat_rates(force: np.ndarray, force_rate: np.ndarray, yaw: float, yaw_rate: float) -> np.ndarray:
    """Body rates of the attitude along a changing force, R^T R' = [w]x by central differences."""
    h = 1e-6
    ahead, behind = (attitude_matrix(force + k * h * force_rate, yaw + k * h * yaw_rate) for k in (1, -1))
    spin = attitude_matrix(force, yaw).T @ (ahead - behind) / (2.0 * h)
    return np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
