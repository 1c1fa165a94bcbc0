"""Formations: a named set of slots in the leader's frame, out of the configuration or a pattern."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from formation.config import CONFIGURED, LabConfig
from formation.guidance.patterns import PATTERNS
from formation.guidance.shape_request import ShapeRequest
from formation.maths.arrays import Float, Vec3s
from formation.maths.frames import rotate_about_z
from formation.model import Vec3Tuple
from formation.names import unknown


@dataclass(frozen=True, slots=True)
class Shape:
    """One slot per follower, in the order of `LabConfig.followers`, in the leader's frame (lead)."""

    name: str
    offset_lead_m: tuple[Vec3Tuple, ...]
    yaw_offset_rad: tuple[float, ...]

    @property
    def offsets(self) -> Vec3s:
        """The slots as an array (followers, 3)."""
        return np.array(self.offset_lead_m, dtype=np.float64).reshape(-1, 3)

    def part(self, rows: Sequence[int]) -> "Shape":
        """The same with these followers' slots alone."""
        return Shape(self.name, tuple(self.offset_lead_m[i] for i in rows), tuple(self.yaw_offset_rad[i] for i in rows))


def configured(config: LabConfig) -> Shape:
    """The shape that the followers' own entries in the configuration make."""
    return shape_for(config, ShapeRequest(CONFIGURED))


def shape_for(config: LabConfig, request: ShapeRequest) -> Shape:
    """The shape asked for: scaled and turned as a whole, raised where the leader is only observed.

    ValueError names the shapes there are.
    """
    offsets, yaw = _slots(config, request.name)
    turned = rotate_about_z(np.array(request.heading_rad), request.scale * offsets)
    if config.leader.sysid is None:
        turned = turned + np.array([0.0, 0.0, config.flight.observed_leader_altitude_offset_m])
    return Shape(
        request.text,
        tuple((float(x), float(y), float(z)) for x, y, z in turned),
        tuple(angle + request.heading_rad for angle in yaw),
    )


def separations(slot_lead_m: Float) -> Float:
    """Distances between the leader (first, at the origin) and all followers (n, 3), infinite to oneself."""
    bodies = np.vstack([np.zeros((1, 3)), slot_lead_m])
    square = (bodies[:, None] - bodies[None]) ** 2
    distances_m: Float = np.sqrt(square[..., 0] + square[..., 1] + square[..., 2])
    np.fill_diagonal(distances_m, np.inf)
    return distances_m


def known(config: LabConfig) -> tuple[str, ...]:
    """The names of all shapes of a lab."""
    return (CONFIGURED, *config.formation.shapes, *(name for name in PATTERNS if name not in config.formation.shapes))


def _slots(config: LabConfig, name: str) -> tuple[Vec3s, tuple[float, ...]]:
    """Offsets (n, 3) and headings of a shape at its usual size."""
    n = len(config.followers)
    listed = config.followers if name == CONFIGURED else config.formation.shapes.get(name)
    if listed is not None:
        return np.array([slot.offset_m for slot in listed]), tuple(slot.yaw_offset_rad for slot in listed)
    pattern = PATTERNS.get(name.lower())
    if pattern is None:
        raise ValueError(f"no shape {unknown(name, known(config))}")
    return pattern(n, config.formation.spacing_m), (0.0,) * n
