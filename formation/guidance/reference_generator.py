"""From plan to reference: where each commanded vehicle is led at any time, without a jump at any change of plan."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from formation.config import FENCE_INSET_M, Fence, LabConfig, TrajectoryConfig
from formation.control.relative_frame import copy_motion, lab_from_lead, lead_from_lab
from formation.guidance import blend, trajectory
from formation.guidance.plan import IDLE, Mode, Plan
from formation.guidance.trajectory import Trajectory, anchored
from formation.maths.arrays import Flags, Float
from formation.maths.frames import wrap_angle
from formation.maths.kernel import kernel
from formation.vehicle.response import SECONDS

POINT, SLOT, TRAJECTORY = 0, 1, 2
LIFT_OFF_M = 0.02
ENTRY_S = 3.0  # a leader off its trajectory's start takes this long to join it
NEAR_M = 0.02

sample = kernel(trajectory.sample, calls=trajectory.PARTS)


@dataclass(frozen=True, slots=True)
class Crew:
    """Who flies, and where: followers (m) is each commanded vehicle's follower index, -1 for the leader."""

    followers: tuple[int, ...]
    trajectory: TrajectoryConfig
    fence: Fence


def crew(config: LabConfig) -> Crew:
    """The crew of a lab."""
    return Crew(tuple(i - 1 for i in config.commanded), config.leader.trajectory, config.limits.fence)


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Where the m commanded vehicles are being led, and from what motion they were picked up.

    kind (m): POINT of the lab, SLOT in the leader's frame, or the leader's TRAJECTORY; base (m, 4): the resting
    target x, y, z, heading in that frame; gap (m, 4, 4), gap_ns, gap_s: the gap to it (formation.guidance.blend)
    when the leg began, then, and how long it decays. airborne: false from IDLE until lift-off; floor_m: the height at
    which the vehicle last stood idle; release_ns: when it last left IDLE.
    """

    plan: Plan
    kind: NDArray[np.int64]
    base: Float
    gap: Float
    gap_ns: NDArray[np.int64]
    gap_s: Float
    airborne: Flags
    floor_m: Float
    release_ns: NDArray[np.int64]
    trajectory: Trajectory
    trajectory_ns: int

    @property
    def in_formation(self) -> Flags:
        """Which vehicles are led in the leader's frame."""
        slots: Flags = self.kind == SLOT
        return slots


@dataclass(frozen=True, slots=True, eq=False)
class Guidance:
    """References of the m vehicles, each (m, 3, 4): in their own frame, that frame's motion, and both joined in `lab`.

    Motions are laid out as in formation.control.relative_frame.
    """

    slot: Float
    frame: Float
    lab: Float


def depart(plan: Plan, motion_lab: Float, t_ns: int) -> Course:
    """The first course, from the vehicles' own estimated motion (m, 3, 4): those not IDLE are taken to be flying."""
    m = len(plan.legs)
    now = np.full(m, t_ns, dtype=np.int64)
    flying = np.array([leg.mode is not Mode.IDLE for leg in plan.legs])
    return Course(
        Plan((IDLE,) * m, plan.shape), np.zeros(m, dtype=np.int64), motion_lab[:, 0].copy(), np.zeros((m, 4, 4)), now,
        np.ones(m), flying, motion_lab[:, 0, 2].copy(), now, anchored(TrajectoryConfig(), np.zeros(3), 0.0), t_ns,
    )  # fmt: skip


def evaluate(course: Course, t_ns: int, lead: Float) -> Guidance:
    """The references of all m vehicles at t_ns, for the leader's motion lead (3, 4) at that time."""
    m = len(course.kind)
    slot, frame, lab = np.empty((m, 3, 4)), np.empty((m, 3, 4)), np.empty((m, 3, 4))
    path = course.trajectory
    _evaluate(
        t_ns, lead, course.kind, course.base, course.gap, course.gap_ns, course.gap_s, path.kind, path.numbers,
        path.knots, course.trajectory_ns, slot, frame, lab,
    )  # fmt: skip
    return Guidance(slot, frame, lab)


class Way(NamedTuple):
    """The arrays of a Course, as kernels pass them on."""

    kind: NDArray[np.int64]
    base: Float
    gap: Float
    gap_ns: NDArray[np.int64]
    gap_s: Float
    path_kind: int
    path_numbers: Float
    path_knots: Float
    path_ns: int


@kernel
def reference_at(i: int, t_ns: int, lead: Float, way: Way, slot: Float, frame: Float, lab: Float) -> None:
    """Vehicle i's reference at t_ns for the leader's motion lead (3, 4) then, into slot, frame, lab, each (3, 4)."""
    for order in range(3):
        for column in range(4):
            slot[order, column] = frame[order, column] = 0.0
    if way.kind[i] == TRAJECTORY:
        sample(way.path_kind, way.path_numbers, way.path_knots, (t_ns - way.path_ns) * SECONDS, slot)
    else:
        for column in range(4):
            slot[0, column] = way.base[i, column]
    blend.add_gap(way.gap[i], (t_ns - way.gap_ns[i]) * SECONDS, way.gap_s[i], slot)
    if way.kind[i] == SLOT:
        copy_motion(lead, frame)
    lab_from_lead(slot, frame, lab)


@kernel
def _evaluate(
    t_ns: int, lead: Float, kind: NDArray[np.int64], base: Float, gap: Float, gap_ns: NDArray[np.int64],
    gap_s: Float, path_kind: int, path_numbers: Float, path_knots: Float, path_ns: int, slot: Float, frame: Float,
    lab: Float,
) -> None:  # fmt: skip
    """`reference_at` for all vehicles."""
    way = Way(kind, base, gap, gap_ns, gap_s, path_kind, path_numbers, path_knots, path_ns)
    for i in range(len(kind)):
        reference_at(i, t_ns, lead, way, slot[i], frame[i], lab[i])


def steer(course: Course, plan: Plan, who: Crew, motion_lab: Float, lead: Float, t_ns: int) -> Course:
    """The course after this tick's plan; the same object where nothing changed.

    motion_lab (m, 3, 4): the vehicles' estimated motions; lead (3, 4): the leader's; both at t_ns.
    Vehicles not airborne are led where they are, and picked up from their own motion at lift-off.
    """
    if plan == course.plan and course.airborne.all():
        return course
    lifted = ~course.airborne & (motion_lab[:, 0, 2] > course.floor_m + LIFT_OFF_M)
    now: Guidance | None = None
    draft = _Draft(course, plan, who, t_ns, lead)
    for i, leg in enumerate(plan.legs):
        was_idle = course.plan.legs[i].mode is Mode.IDLE
        if leg.mode is Mode.IDLE:
            draft.stand(i, motion_lab[i])
        elif not course.airborne[i] and (was_idle or not lifted[i]):
            draft.wait(i, motion_lab[i], was_idle)
        elif was_idle or not course.airborne[i]:
            draft.begin(i, motion_lab[i])
        elif draft.asks_anew(i):
            if now is None:
                now = evaluate(course, t_ns, lead)
            draft.begin(i, now.lab[i])
    return draft.finished()


class _Draft:
    """A course being rewritten, vehicle by vehicle; the one it came from is left alone."""

    def __init__(self, old: Course, plan: Plan, who: Crew, t_ns: int, lead: Float) -> None:
        self._old, self._plan, self._who, self._t_ns, self._lead = old, plan, who, t_ns, lead
        self._new = replace(
            old, plan=plan, kind=old.kind.copy(), base=old.base.copy(), gap=old.gap.copy(), gap_ns=old.gap_ns.copy(),
            gap_s=old.gap_s.copy(), airborne=old.airborne.copy(), floor_m=old.floor_m.copy(),
            release_ns=old.release_ns.copy(),
        )  # fmt: skip
        self._joined: list[int] = []

    def asks_anew(self, i: int) -> bool:
        """Whether the plan asks something new of vehicle i."""
        leg, plan, before = self._plan.legs[i], self._plan, self._old.plan
        if leg.mode is not Mode.FORMATION or leg != before.legs[i]:
            return leg != before.legs[i]
        if self._who.followers[i] < 0:
            return plan.trajectory_start_ns != before.trajectory_start_ns
        return plan.shape != before.shape

    def stand(self, i: int, motion: Float) -> None:
        """On the floor, motors at rest."""
        self._hold_at(i, motion)
        self._new.airborne[i] = False
        self._new.floor_m[i] = motion[0, 2]

    def wait(self, i: int, motion: Float, just_released: bool) -> None:
        """On the floor, thrust rising, until it lifts."""
        self._hold_at(i, motion)
        if just_released:
            self._new.release_ns[i] = self._t_ns

    def begin(self, i: int, motion: Float) -> None:
        """Picks vehicle i up from a lab motion (3, 4) and leads it to the target of its leg."""
        leg, start_ns = self._plan.legs[i], self._plan.trajectory_start_ns
        self._new.airborne[i] = True
        self._new.gap_ns[i] = self._t_ns
        if leg.mode is Mode.FORMATION and self._who.followers[i] >= 0:
            self._join(i, motion)
        elif leg.mode is Mode.FORMATION and start_ns is not None:
            self._start_trajectory(i, motion, start_ns)
        else:
            self._go(i, motion)

    def finished(self) -> Course:
        """The new course; vehicles that set out for slots in one tick arrive together, so straight paths keep apart."""
        if self._joined:
            self._new.gap_s[self._joined] = np.max(self._new.gap_s[self._joined])
        return self._new

    def _hold_at(self, i: int, motion: Float) -> None:
        """Led exactly where it is."""
        self._new.kind[i] = POINT
        self._new.base[i] = motion[0]
        self._new.gap[i] = 0.0

    def _join(self, i: int, motion: Float) -> None:
        """To the slot, along a gap that decays in the leader's own frame, by way of the plan's detour."""
        new, follower, shape = self._new, self._who.followers[i], self._plan.shape
        new.kind[i] = SLOT
        new.base[i] = [*shape.offset_lead_m[follower], shape.yaw_offset_rad[follower]]
        lead_from_lab(motion, self._lead, new.gap[i])
        new.gap[i, 0] -= new.base[i]
        new.gap[i, 3] = 0.0
        new.gap[i, 3, 2] = self._plan.rise_m[follower] if self._plan.rise_m else 0.0
        self._take_time(i)
        self._joined.append(i)

    def _start_trajectory(self, i: int, motion: Float, start_ns: int) -> None:
        """Onto the leader's trajectory, anchored where the reference is."""
        path = anchored(self._who.trajectory, motion[0, :3], float(motion[0, 3]))
        self._new = new = replace(self._new, trajectory=path, trajectory_ns=start_ns)
        new.kind[i] = TRAJECTORY
        on_path = np.zeros((3, 4))
        sample(path.kind, path.numbers, path.knots, (self._t_ns - start_ns) * SECONDS, on_path)
        new.gap[i, :3], new.gap[i, 3] = motion - on_path, 0.0
        self._take_time(i)
        if float(np.linalg.norm(new.gap[i, 0, :3])) > NEAR_M:
            new.gap_s[i] = max(new.gap_s[i], ENTRY_S)

    def _go(self, i: int, motion: Float) -> None:
        """To a point of the lab; what the leg leaves open is braked to rest where it is."""
        new, leg = self._new, self._plan.legs[i]
        new.kind[i] = POINT
        wanted = (*leg.target_lab_m, leg.yaw_rad)
        new.base[i] = [motion[0, k] if value is None else value for k, value in enumerate(wanted)]
        new.gap[i, :3], new.gap[i, 3] = motion, 0.0
        new.gap[i, 0] -= new.base[i]
        brake_s = blend.braking_s(new.gap[i])
        for k, value in enumerate(wanted):
            if value is None:
                new.base[i, k] += blend.braked(new.gap[i], k, brake_s)
        self._inside(new.base[i])
        new.gap[i, 0] = motion[0] - new.base[i]
        self._take_time(i)

    def _inside(self, point: Float) -> None:
        """Draws a target back into the fence; only the floor is left alone, for landing goes beneath it."""
        low, high = np.array(self._who.fence.low_m), np.array(self._who.fence.high_m)
        point[:2] = np.clip(point[:2], low[:2] + FENCE_INSET_M, high[:2] - FENCE_INSET_M)
        point[2] = min(point[2], high[2] - FENCE_INSET_M)

    def _take_time(self, i: int) -> None:
        """How long vehicle i's gap takes to decay; a turn goes the short way round."""
        gap = self._new.gap[i]
        gap[0, 3] = wrap_angle(gap[0, 3])
        self._new.gap_s[i] = blend.closing_s(gap, self._plan.legs[i].speed_m_s)
