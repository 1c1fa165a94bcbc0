"""Formations: a named set of slots in the leader's frame, and the least-travel way from one to the next."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from formation.arrays import Float
from formation.config import LabConfig, Vec3Tuple


@dataclass(frozen=True, slots=True)
class Shape:
    """One slot per follower, in the order of `LabConfig.followers`, in the leader's frame (lead)."""

    name: str
    offset_lead_m: tuple[Vec3Tuple, ...]
    yaw_offset_rad: tuple[float, ...]

    @property
    def offsets(self) -> Float:
        """The slots as an array (followers, 3)."""
        return np.array(self.offset_lead_m, dtype=np.float64).reshape(-1, 3)


def configured(config: LabConfig) -> Shape:
    """The shape that the lab's configuration spells out, slot by slot, raised where the leader is only observed."""
    rise = 0.0 if config.leader.sysid is not None else config.flight.observed_leader_altitude_offset_m
    return Shape(
        "configured",
        tuple((f.offset_m[0], f.offset_m[1], f.offset_m[2] + rise) for f in config.followers),
        tuple(f.yaw_offset_rad for f in config.followers),
    )


def assigned(shape: Shape, slot_now_lead_m: Float) -> Shape:
    """The same shape with its slots dealt to the followers so that the sum of squared travel is least.

    slot_now_lead_m: (followers, 3). Straight, simultaneous paths under this assignment do not cross
    (Turpin, Michael, Kumar, CAPT, IJRR 2014).
    """
    gap = slot_now_lead_m[:, None, :] - shape.offsets[None, :, :]
    _, slot_of = linear_sum_assignment(np.sum(gap * gap, axis=-1))
    return Shape(
        shape.name,
        tuple(shape.offset_lead_m[j] for j in slot_of),
        tuple(shape.yaw_offset_rad[j] for j in slot_of),
    )
