"""What is drawn of a lab from above, in metres of the lab; `plan_text` and `plan_svg` draw it."""

from dataclasses import dataclass

import numpy as np

from formation.config import LabConfig
from formation.guidance.preview import Preview
from formation.maths.arrays import Float, Vec3s
from formation.model import Vec3Tuple

BEYOND_SHARE = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """The lab from above: x forward is up on the sheet, y left is to the left.

    low_m, high_m: the fence; leader (2), slots (n, 2): at the start; path (k, 2): the leader's; swept (n, k, 2):
    the slots' paths; heading_rad: the leader's at the start; bodies: the names, leader first.
    """

    name: str
    bodies: tuple[str, ...]
    observed: bool
    low_m: Vec3Tuple
    high_m: Vec3Tuple
    leader: Float
    heading_rad: float
    slots: Vec3s
    path: Float
    swept: Float
    min_separation_m: float

    @property
    def bounds(self) -> tuple[Float, Float]:
        """The corners (2), (2) of what is shown: the fence, and what is outside of it as far as half its size."""
        low, high = np.array(self.low_m[:2]), np.array(self.high_m[:2])
        points = np.concatenate([self.path, self.swept.reshape(-1, 2), self.slots, [self.leader]])
        beyond = BEYOND_SHARE * float((high - low).max())
        return (
            np.maximum(np.minimum(points.min(axis=0), low), low - beyond),
            np.minimum(np.maximum(points.max(axis=0), high), high + beyond),
        )

    @property
    def beyond(self) -> str:
        """Who is not on the sheet at the start, in words; nothing where all are."""
        low, high = self.bounds
        at = zip(self.bodies, [self.leader, *self.slots], strict=True)
        names = [body for body, point in at if (point < low).any() or (point > high).any()]
        return f"beyond the drawing: {', '.join(names)}" if names else ""


def drawn(config: LabConfig, ahead: Preview) -> Drawing:
    """The drawing of a lab and its formation phase."""
    return Drawing(
        name=config.name,
        bodies=tuple(v.body for v in config.vehicles),
        observed=config.leader.sysid is None,
        low_m=config.limits.fence.low_m,
        high_m=config.limits.fence.high_m,
        leader=ahead.start[:2],
        heading_rad=float(ahead.start[3]),
        slots=ahead.at_start[:, :2],
        path=ahead.leader[:, 0, :2],
        swept=np.moveaxis(ahead.slots[:, :, 0, :2], 1, 0),
        min_separation_m=config.limits.min_separation_m,
    )
