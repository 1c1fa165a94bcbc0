"""Which poses the mocap process did not believe: body by body and reason by reason, with their times."""

from dataclasses import dataclass

import numpy as np

from analysis.load import Flight
from formation.rejection import rejection_text


@dataclass(frozen=True, slots=True)
class Rejected:
    """One body's poses that were rejected for one reason; frames: how many, in `stretches`, s from the log's start."""

    body: str
    reason: str
    frames: int
    stretches: int
    first_s: float
    last_s: float


def rejections(flight: Flight) -> tuple[Rejected, ...]:
    """All there are, in order of their first."""
    poses = flight.poses
    found = []
    for i, vehicle in enumerate(flight.vehicles):
        codes = poses.rejected[:, i] if len(poses.t_s) else np.zeros(0, np.uint8)
        for code in np.unique(codes[codes > 0]).tolist():
            met = codes == code
            begins = int(met[0]) + int((met[1:] & ~met[:-1]).sum())
            t_s = poses.t_s[met]
            reason = rejection_text(code)
            found.append(Rejected(vehicle.body, reason, int(met.sum()), begins, float(t_s[0]), float(t_s[-1])))
    return tuple(sorted(found, key=lambda one: one.first_s))
