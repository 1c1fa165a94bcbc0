"""Where everybody will be led, before anybody flies: the leader's trajectory, and the slots it carries along.

Followers are taken to be in their slots. What comes before, take-off and joining, is found in flight
(formation.guidance.transition).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from formation.config import Fence, LabConfig, TrajectoryConfig
from formation.guidance.shape import Shape
from formation.guidance.trajectory import Trajectory, anchored, sample
from formation.maths.arrays import Float, Vec3s
from formation.maths.frames import rotate_about_z

SAMPLE_S, SAMPLES_MIN, SAMPLES_MAX = 0.05, 100, 5_000


@dataclass(frozen=True, slots=True, eq=False)
class Preview:
    """The formation phase in advance: where it begins, and the motion of leader and slots from then on, in `lab`.

    start (4): the leader's x, y, z and heading when the formation is taken up; at_start (n, 3): the slots then.
    t_s (k,) counts from the trajectory's beginning to its end. leader (k, 3, 4): position, velocity, acceleration
    (rows) of x, y, z, heading; slots (k, n, 3, 3): the same of x, y, z of each of the n followers' slots.
    """

    start: Float
    at_start: Vec3s
    t_s: Float
    leader: Float
    slots: Float

    @property
    def duration_s(self) -> float:
        """How long the leader's trajectory lasts."""
        return float(self.t_s[-1])

    @property
    def length_m(self) -> float:
        """How long the leader's way is."""
        return float(np.linalg.norm(np.diff(self.leader[:, 0, :3], axis=0), axis=-1).sum())


def expected_start(config: LabConfig) -> Float:
    """Where, by the file alone, the leader is when the formation is taken up: x, y, z, heading (4)."""
    leader = config.leader
    return np.array([*leader.spawn_lab_m[:2], config.flight.altitude_m, leader.spawn_yaw_rad])


def trajectory_from(config: LabConfig, start: Float) -> Trajectory:
    """The leader's trajectory from `start` (4): x, y, z, heading; one that is only observed is taken to stay there."""
    path = TrajectoryConfig() if config.leader.sysid is None else config.leader.trajectory
    return anchored(path, start[:3], float(start[3]))


def preview(path: Trajectory, shape: Shape, start: Float, from_s: float = 0.0, samples: int | None = None) -> Preview:
    """The formation phase in that shape, taken up with the leader at `start` (4), along its path from from_s on.

    looks: at how many times it is looked at; by default some twenty a second.
    """
    if samples is None:
        samples = min(max(round(path.duration_s / SAMPLE_S), SAMPLES_MIN), SAMPLES_MAX) + 1
    t_s = np.linspace(min(from_s, path.duration_s), path.duration_s, samples)
    leader = np.empty((samples, 3, 4))
    for at_s, motion in zip(t_s, leader, strict=True):
        sample(path.kind, path.numbers, path.knots, float(at_s), motion)
    return _with_slots(start, t_s, leader, shape)


def reshaped(ahead: Preview, shape: Shape) -> Preview:
    """The same in another shape."""
    return _with_slots(ahead.start, ahead.t_s, ahead.leader, shape)


def _with_slots(start: Float, t_s: Float, leader: Float, shape: Shape) -> Preview:
    at_start = start[:3] + rotate_about_z(np.full(len(shape.offsets), start[3]), shape.offsets)
    return Preview(start, at_start, t_s, leader, carried(leader, shape.offsets))


def carried(leader: Float, offset_lead_m: Vec3s) -> Float:
    """Motions (k, n, 3, 3) in `lab` of points fixed in the leader's frame, for the leader's motion (k, 3, 4)."""
    yaw, rate, turn = leader[:, 0, 3, None], leader[:, 1, 3, None], leader[:, 2, 3, None]
    cosine, sine, (x, y, z) = np.cos(yaw), np.sin(yaw), offset_lead_m.T
    arm_x, arm_y = cosine * x - sine * y, sine * x + cosine * y
    motion = np.empty((len(leader), len(offset_lead_m), 3, 3))
    motion[:] = leader[:, None, :, :3]
    # By component: whole vectors, stacked, took four times as long.
    motion[..., 0, 0] += arm_x
    motion[..., 0, 1] += arm_y
    motion[..., 0, 2] += z
    motion[..., 1, 0] -= rate * arm_y
    motion[..., 1, 1] += rate * arm_x
    motion[..., 2, 0] -= turn * arm_y + rate * rate * arm_x
    motion[..., 2, 1] += turn * arm_x - rate * rate * arm_y
    return motion


def outside_m(pos_lab_m: Float, fence: Fence, half_m: ArrayLike = 0.0) -> Float:
    """How far points (..., 3) are beyond the fence, along the axis where they are farthest; negative inside.

    half_m (...): of the width of the bodies there, which are then held against the floor, too; 0: points.
    """
    half = np.asarray(half_m)[..., None]
    low, high = np.asarray(fence.low_m) + half, np.asarray(fence.high_m) - half
    low[..., 2] = np.where(half[..., 0] > 0.0, np.maximum(low[..., 2], half[..., 0]), low[..., 2])
    along = np.maximum(low - pos_lab_m, pos_lab_m - high)
    beyond: Float = np.maximum(np.maximum(along[..., 0], along[..., 1]), along[..., 2])
    return beyond


def beyond_text(point: Float, fence: Fence, half_m: float = 0.0) -> str:
    """Where a point outside the fence is, and which wall it is beyond: `at (2.90, 0.00, 0.30) m, 0.40 m beyond ...`.

    half_m: of the width of a body there, as for `outside_m`.
    """
    walls = [
        (half_m + (wall - x if side == "low" else x - wall), f"limits.fence.{side}_m {axis} = {wall:g}")
        for side, corner in (("low", fence.low_m), ("high", fence.high_m))
        for axis, x, wall in zip("xyz", point.tolist(), corner, strict=True)
    ]
    beyond, wall = max([*walls, (half_m - float(point[2]), "the floor")] if half_m else walls)
    body = f"its body, {2.0 * half_m:.2f} m wide, " if half_m else ""
    return f"at {coordinates(point)} m, {body}{beyond:.2f} m beyond {wall}"


def coordinates(point: Float) -> str:
    """`(1.00, -0.40, 0.30)`."""
    return "(" + ", ".join(f"{round(x, 2) + 0.0:.2f}" for x in point.tolist()) + ")"
