"""From plan to reference: where each commanded vehicle is led at any time, without a jump at any change of plan."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from formation.config import CONFIGURED, FENCE_INSET_M, Fence, LabConfig, TrajectoryConfig
from formation.estimation.response import SECONDS
from formation.guidance import trajectory
from formation.guidance.plan import IDLE, Mode, Plan
from formation.guidance.trajectory import Trajectory, anchored, braked, braking_s, closing_s, stopping_s
from formation.maths.arrays import Flags, Float, Gap, Vec4
from formation.maths.frames import wrap_angle
from formation.maths.kernel import kernel
from formation.maths.records import Rows, blank, copied
from formation.paper.eq2_relative_frame import copy_motion, lab_from_lead, lead_from_lab

POINT, SLOT, TRAJECTORY = range(3)
LIFT_OFF_M = 0.02
LAB_FLOOR_M = 0.0
ENTRY_S = 3.0  # a leader off its trajectory's start takes this long to join it
NEAR_M = 0.02
POSITION_ERROR_M, VELOCITY_ERROR_M_S = (
    0.3,
    0.5,
)  # so far from its reference a vehicle is stopped where it is, not where that was

sample = kernel(trajectory.sample, calls=trajectory.PARTS)
add_gap = kernel(trajectory.add_gap, calls=(trajectory.braked,))


@dataclass(frozen=True, slots=True)
class Fleet:
    """Who flies, and where: followers (m) is each commanded vehicle's follower index, -1 for the leader.

    trajectories: the leader's, by name.
    """

    followers: tuple[int, ...]
    trajectories: Mapping[str, TrajectoryConfig]
    fence: Fence


def fleet(config: LabConfig) -> Fleet:
    """The fleet of a lab."""
    trajectories = {CONFIGURED: config.leader.trajectory, **config.leader.trajectories}
    return Fleet(tuple(i - 1 for i in config.commanded), trajectories, config.limits.fence)


@dataclass(slots=True)
class VehicleReference:
    """Where one commanded vehicle is being led, and from what motion it was picked up; a record.

    kind: POINT of the lab, SLOT in the leader's frame, or the leader's TRAJECTORY (of path_kind, begun at
    path_start_ns); target: the resting x, y, z, heading in that frame, of a POINT
    at gap_ns where it goes on at vel; gap, gap_ns, gap_s, brake_s: the gap to it
    (formation.guidance.trajectory) when the setpoint came, then, how long it decays, and how long its motion is braked.
    idle: to stand with motors at rest; airborne: false from then until lift-off; floor_m: the height at which it last
    stood idle, LAB_FLOOR_M if it flew from the first; release_ns: when it last ceased to be idle.
    """

    kind: int
    path_kind: int
    path_start_ns: int
    target: Vec4
    vel: Vec4
    gap: Gap
    gap_ns: int
    gap_s: float
    brake_s: float
    idle: bool
    airborne: bool
    floor_m: float
    release_ns: int


@dataclass(frozen=True, slots=True, eq=False)
class Generator:
    """The reference generator's state: the plan it follows, the m vehicles' references, the leader's trajectory."""

    plan: Plan
    vehicles: Rows[VehicleReference]
    trajectory: Trajectory

    @property
    def airborne(self) -> Flags:
        """Which vehicles have left the floor."""
        flying: Flags = self.vehicles["airborne"]
        return flying

    @property
    def in_formation(self) -> Flags:
        """Which vehicles are led in the leader's frame."""
        slots: Flags = self.vehicles["kind"] == SLOT
        return slots


@dataclass(frozen=True, slots=True, eq=False)
class References:
    """References of the m vehicles, each (m, 3, 4): in their own frame, that frame's motion, and both joined in `lab`.

    Motions are laid out as in formation.paper.eq2_relative_frame.
    """

    slot: Float
    frame: Float
    lab: Float


def start(plan: Plan, motion_lab: Float, t_ns: int) -> Generator:
    """The first state, from the vehicles' own estimated motion (m, 3, 4): those not IDLE are taken to be flying."""
    m = len(plan.setpoints)
    vehicles = blank(VehicleReference, m)
    vehicles["target"] = motion_lab[:, 0]
    vehicles["gap_ns"] = vehicles["release_ns"] = t_ns
    vehicles["gap_s"] = vehicles["brake_s"] = 1.0
    flies = np.array([setpoint.mode is not Mode.IDLE for setpoint in plan.setpoints])
    vehicles["airborne"] = flies
    vehicles["idle"] = True
    vehicles["floor_m"] = np.where(flies, LAB_FLOOR_M, motion_lab[:, 0, 2])
    return Generator(Plan((IDLE,) * m, plan.shape), vehicles, anchored(TrajectoryConfig(), np.zeros(3), 0.0))


def references(generator: Generator, t_ns: int, lead: Float) -> References:
    """The references of all m vehicles at t_ns, for the leader's motion lead (3, 4) at that time."""
    m = len(generator.vehicles)
    slot, frame, lab = np.empty((m, 3, 4)), np.empty((m, 3, 4)), np.empty((m, 3, 4))
    path = generator.trajectory
    _references(generator.vehicles, path.numbers, path.knots, t_ns, lead, slot, frame, lab)
    return References(slot, frame, lab)


@kernel
def reference_at(
    vehicle: VehicleReference, numbers: Float, knots: Float, t_ns: int, lead: Float, slot: Float, frame: Float,
    lab: Float,
) -> None:  # fmt: skip
    """One vehicle's reference at t_ns for the leader's motion lead (3, 4) then, into slot, frame, lab, each (3, 4).

    numbers, knots: of the leader's trajectory.
    """
    for order in range(3):
        for column in range(4):
            slot[order, column] = frame[order, column] = 0.0
    if vehicle.kind == TRAJECTORY:
        sample(vehicle.path_kind, numbers, knots, (t_ns - vehicle.path_start_ns) * SECONDS, slot)
    else:
        for column in range(4):
            slot[0, column] = vehicle.target[column]
            if vehicle.kind == POINT and vehicle.vel[column] != 0.0:
                slot[0, column] += vehicle.vel[column] * (t_ns - vehicle.gap_ns) * SECONDS
                slot[1, column] = vehicle.vel[column]
    add_gap(vehicle.gap, vehicle.brake_s, (t_ns - vehicle.gap_ns) * SECONDS, vehicle.gap_s, slot)
    if vehicle.kind == SLOT:
        copy_motion(lead, frame)
    lab_from_lead(slot, frame, lab)


@kernel
def _references(
    vehicles: Rows[VehicleReference], numbers: Float, knots: Float, t_ns: int, lead: Float, slot: Float, frame: Float,
    lab: Float,
) -> None:  # fmt: skip
    """`reference_at` for all vehicles."""
    for i in range(len(vehicles)):
        reference_at(vehicles[i], numbers, knots, t_ns, lead, slot[i], frame[i], lab[i])


def update(old: Generator, plan: Plan, who: Fleet, motion_lab: Float, lead: Float, t_ns: int) -> Generator:
    """The state after this tick's plan; the same object where nothing changed.

    motion_lab (m, 3, 4): the vehicles' estimated motions; lead (3, 4): the leader's; both at t_ns.
    Vehicles not airborne are led where they are, and picked up from their own motion at lift-off.
    """
    airborne = old.airborne
    if plan == old.plan and False not in airborne.tolist():
        return old
    lifted = ~airborne & (motion_lab[:, 0, 2] > old.vehicles["floor_m"] + LIFT_OFF_M)
    now: References | None = None
    draft = _Draft(old, plan, who, t_ns, lead)
    for i, setpoint in enumerate(plan.setpoints):
        was_idle = old.plan.setpoints[i].mode is Mode.IDLE
        if setpoint.mode is Mode.IDLE:
            draft.stand(i, motion_lab[i])
        elif not airborne[i] and (was_idle or not lifted[i]):
            draft.wait(i, motion_lab[i], was_idle)
        elif was_idle or not airborne[i]:
            draft.begin(i, motion_lab[i])
        elif draft.is_replanned(i):
            if now is None:
                now = references(old, t_ns, lead)
            draft.begin(i, _start_motion(setpoint.mode, now.lab[i], motion_lab[i]))
    return draft.finished()


def _start_motion(mode: Mode, ref: Float, own: Float) -> Float:
    """The motion (3, 4) from which a new course begins: where it is led, or its own where that has gone far from it.

    To stop, or to land, where a reference ran away to would first take it there.
    """
    far_m, far_m_s = (float(np.linalg.norm(ref[order, :3] - own[order, :3])) for order in range(2))
    if mode is not Mode.LAB or (far_m <= POSITION_ERROR_M and far_m_s <= VELOCITY_ERROR_M_S):
        return ref
    still = own.copy()
    still[2] = 0.0  # no push of what led it there goes on
    return still


class _Draft:
    """A state being rewritten, vehicle by vehicle; the one it came from is left alone."""

    def __init__(self, old: Generator, plan: Plan, who: Fleet, t_ns: int, lead: Float) -> None:
        self._old, self._plan, self._who, self._t_ns, self._lead = old, plan, who, t_ns, lead
        self._vehicles, self._trajectory = copied(old.vehicles), old.trajectory
        self._joined: list[int] = []

    def is_replanned(self, i: int) -> bool:
        """Whether the plan asks something new of vehicle i."""
        setpoint, plan, before = self._plan.setpoints[i], self._plan, self._old.plan
        if setpoint.mode is not Mode.FORMATION or setpoint != before.setpoints[i]:
            return setpoint != before.setpoints[i]
        if self._who.followers[i] < 0:
            return plan.trajectory_start_ns != before.trajectory_start_ns
        return plan.shape != before.shape

    def stand(self, i: int, motion: Float) -> None:
        """On the floor, motors at rest."""
        self._hold_at(i, motion)
        new = self._vehicles[i]
        new.idle, new.airborne, new.floor_m = True, False, motion[0, 2]

    def wait(self, i: int, motion: Float, just_released: bool) -> None:
        """On the floor, thrust rising, until it lifts."""
        self._hold_at(i, motion)
        self._vehicles[i].idle = False
        if just_released:
            self._vehicles[i].release_ns = self._t_ns

    def begin(self, i: int, motion: Float) -> None:
        """Picks vehicle i up from a lab motion (3, 4) and leads it to its setpoint."""
        setpoint, start_ns = self._plan.setpoints[i], self._plan.trajectory_start_ns
        new = self._vehicles[i]
        new.idle, new.airborne, new.gap_ns = False, True, self._t_ns
        if setpoint.mode is Mode.FORMATION and self._who.followers[i] >= 0:
            self._join(i, motion)
        elif setpoint.mode is Mode.FORMATION and start_ns is not None:
            self._start_trajectory(i, motion, start_ns)
        else:
            self._go(i, motion)

    def finished(self) -> Generator:
        """The new state; vehicles that set out for slots in one tick arrive together, so straight paths keep apart."""
        if self._joined:
            gap_s = self._vehicles["gap_s"]
            gap_s[self._joined] = np.max(gap_s[self._joined])
        return Generator(self._plan, self._vehicles, self._trajectory)

    def _hold_at(self, i: int, motion: Float) -> None:
        """Led exactly where it is."""
        new = self._vehicles[i]
        new.kind = POINT
        new.target[:] = motion[0]
        new.vel[:] = new.gap[:] = 0.0

    def _join(self, i: int, motion: Float) -> None:
        """To the slot, along a gap that decays in the leader's own frame, by way of the plan's detour."""
        new, follower, shape = self._vehicles[i], self._who.followers[i], self._plan.shape
        new.kind = SLOT
        new.target[:] = [*shape.offset_lead_m[follower], shape.yaw_offset_rad[follower]]
        lead_from_lab(motion, self._lead, new.gap)
        new.gap[0] -= new.target
        new.gap[3] = 0.0
        new.gap[3, 2] = self._plan.rise_m[follower] if self._plan.rise_m else 0.0
        self._set_duration(i, braking_s(new.gap))
        self._joined.append(i)

    def _start_trajectory(self, i: int, motion: Float, start_ns: int) -> None:
        """Onto the leader's trajectory, anchored where the reference is, or was when it began before."""
        new, path = self._vehicles[i], self._trajectory
        if not self._plan.resumes:
            trajectory = self._who.trajectories[self._plan.trajectory]
            path = self._trajectory = anchored(trajectory, motion[0, :3], float(motion[0, 3]))
        new.kind, new.path_kind, new.path_start_ns = TRAJECTORY, path.kind, start_ns
        on_path = np.zeros((3, 4))
        sample(path.kind, path.numbers, path.knots, (self._t_ns - start_ns) * SECONDS, on_path)
        new.gap[:3], new.gap[3] = motion - on_path, 0.0
        self._set_duration(i, braking_s(new.gap))
        if float(np.linalg.norm(new.gap[0, :3])) > NEAR_M:
            new.gap_s = max(new.gap_s, ENTRY_S)

    def _go(self, i: int, motion: Float) -> None:
        """To a point of the lab; what the setpoint leaves open is braked where it is, to rest or to its velocity."""
        new, setpoint = self._vehicles[i], self._plan.setpoints[i]
        new.kind = POINT
        wanted = (*setpoint.target_lab_m, setpoint.yaw_rad)
        new.target[:] = [motion[0, k] if value is None else value for k, value in enumerate(wanted)]
        new.vel[:] = setpoint.vel_lab
        new.gap[:3], new.gap[3] = motion, 0.0
        new.gap[0] -= new.target
        new.gap[1] -= new.vel
        holds = setpoint.target_lab_m[2] is None
        low, high = self._flight_volume(new, motion, holds=holds)
        margin_m = np.where(motion[1, :3] > 0.0, high - motion[0, :3], motion[0, :3] - low)
        brake_s = braking_s(new.gap) if new.vel.any() else stopping_s(new.gap, margin_m)
        for k, value in enumerate(wanted):
            if value is None:
                new.target[k] += braked(new.gap, k, brake_s)
        if not holds:
            low[2] = -np.inf  # landing goes beneath the floor
        new.target[:3] = np.clip(new.target[:3], low, high)
        new.gap[0] = motion[0] - new.target
        self._set_duration(i, brake_s)

    def _flight_volume(self, vehicle: VehicleReference, motion: Float, *, holds: bool) -> tuple[Float, Float]:
        """The corners (3), (3) between which a vehicle is led: within the fence, and above the floor if it holds."""
        low, high = np.array(self._who.fence.low_m), np.array(self._who.fence.high_m)
        low += FENCE_INSET_M
        low[2] = min(vehicle.floor_m + (FENCE_INSET_M if holds else 0.0), motion[0, 2])
        return low, high - FENCE_INSET_M

    def _set_duration(self, i: int, brake_s: float) -> None:
        """How long vehicle i's gap takes to decay, its motion braked so long; a turn goes the short way round."""
        new = self._vehicles[i]
        new.gap[0, 3] = wrap_angle(new.gap[0, 3])
        new.brake_s = brake_s
        new.gap_s = closing_s(new.gap, brake_s, self._plan.setpoints[i].speed_m_s)
