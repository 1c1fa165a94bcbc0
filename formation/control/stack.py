"""The control stack: frame in, attitude targets out. Pure functions in a row, and the one place that remembers."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from formation.config import LabConfig
from formation.control.attitude import TILT, Target, attitude
from formation.control.composite_law import Demand, LawMemory, demand, no_memory
from formation.control.limits.barriers import bounded
from formation.control.presets import Preset, preset_for
from formation.control.settings import attitude_settings, barrier_settings, law_settings, observer_settings
from formation.estimation.state import VehicleEstimate, initial, swarm_state
from formation.estimation.update import estimate
from formation.guidance.followed_leader import FollowedLeader, Led, as_estimated, follow
from formation.guidance.plan import Mode, Plan
from formation.guidance.reference_generator import Generator, References, fleet, references, start, update
from formation.maths.arrays import Scalars, Vec3s
from formation.maths.records import Rows, copied, like
from formation.messages import AttitudeTarget, Command, LabFrame, LawFailure, Reference, SwarmState
from formation.own_law.flight import Asked, OwnLaws
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleProfile
from formation.vehicle.response import NEVER_NS, SentCommands, no_history, remember

HISTORY_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Stages:
    """One message per stage of one tick, all stamped with the frame's capture time.

    The reference holds at that time; the command's errors and demand hold when the command takes effect.
    """

    state: SwarmState
    reference: Reference
    command: Command
    target: AttitudeTarget


class ControlStack:
    """Estimates, leads and commands the vehicles of one lab; same inputs, bit-identical outputs.

    profiles: of the n vehicles in the order of `config.vehicles`; chosen: the gains, by default those that
    `config.control_preset` names (ValueError if there is no such preset); without: monitors that are switched off, of
    formation.control.limits.MONITORS (ValueError for others); own: the lab's own laws, which take over where they fly.
    """

    def __init__(
        self,
        config: LabConfig,
        profiles: tuple[VehicleProfile, ...],
        chosen: Preset | None = None,
        without: frozenset[str] = frozenset(),
        own: OwnLaws | None = None,
    ) -> None:
        gains = tuple(
            preset_for(config.control_preset, p, config.mocap) if chosen is None else chosen for p in profiles
        )
        self._fleet = fleet(config)
        self._commanded = np.array(config.commanded, dtype=np.int64)
        self._observers = observer_settings(config, profiles, gains)
        self._law = law_settings(config, gains)
        self._barriers = barrier_settings(config, profiles, without)
        self._attitude = attitude_settings(config, profiles)
        self._own = own
        m = len(self._commanded)
        self._history: Rows[SentCommands] = no_history(m)
        self._memory: Rows[LawMemory] = no_memory(m)
        self._yaw_acc_command: Scalars = np.zeros(len(config.vehicles))
        self._estimates: Rows[VehicleEstimate] | None = None
        self._generator: Generator | None = None
        self._leader: Rows[FollowedLeader] | None = None
        self._slot_speeds_m_s = config.limits.speed_m_s, config.flight.reform_m_s

    def step(
        self, t_now_ns: int, frame: LabFrame, plan: Plan, hover_thrust_norm: Scalars, felt_flu_m_s2: Vec3s | None = None
    ) -> Stages:
        """One tick at t_now_ns (>= the frame's capture) on the newest frame, bodies in the order of the config.

        A frame already seen is predicted on from. hover_thrust_norm (m): what hovers each vehicle, as known so far.
        felt_flu_m_s2 (n, 3): specific force by each vehicle's own accelerometer, mean since the frame before; NaN where
        it was not measured, None for all.
        """
        before = self._begin(frame, plan) if self._estimates is None else self._estimates
        airborne = np.zeros(len(frame.bodies), dtype=np.bool_)
        if self._generator is not None:
            airborne[self._commanded] = self._generator.airborne
        felt = np.full((len(frame.bodies), 3), np.nan) if felt_flu_m_s2 is None else felt_flu_m_s2
        estimates = estimate(before, self._observers, frame, self._history, airborne, self._yaw_acc_command, felt)
        t_ns, motion = int(estimates["t_ns"][0]), estimates["motion"]
        mine = motion[self._commanded]
        old = start(plan, mine, t_ns) if self._generator is None else self._generator
        before_it = as_estimated(motion[0], t_ns) if self._leader is None else self._leader
        arm_m = plan.shape.arm_m if True in airborne.tolist() else -1.0
        followed = follow(before_it, motion[0], t_ns, arm_m, self._slot_speeds_m_s)
        leader = followed["motion"][0]
        generator = update(old, plan, self._fleet, mine, leader, t_ns)
        path = generator.trajectory
        led_by = Led(generator.vehicles, path.numbers, path.knots, followed)
        wanted = demand(self._law, self._observers, estimates, self._history, led_by, self._memory, t_now_ns)
        if self._own is not None:
            asked = Asked(self._law, self._observers, estimates, self._history, led_by, self._memory, t_now_ns)
            wanted = self._own.take_over(wanted, asked)
        kept = bounded(self._barriers, wanted, estimates, generator.vehicles, t_now_ns)
        target = attitude(self._attitude, kept, estimates, generator.vehicles, hover_thrust_norm, t_now_ns)
        self._history = remember(self._history, t_now_ns, target["force"])
        self._memory = _remembered(self._memory, wanted, target, t_now_ns)
        self._estimates, self._generator, self._leader = estimates, generator, followed
        led = references(generator, t_ns, leader)
        self._yaw_acc_command = np.zeros(len(frame.bodies))
        self._yaw_acc_command[self._commanded] = led.lab[:, 2, 3]
        return Stages(
            swarm_state(estimates),
            _reference(generator, led, t_ns),
            _command(wanted, estimates, self._commanded, t_ns),
            _target(target, t_ns),
        )

    def forget(self, bodies: Collection[int]) -> None:
        """Begin these bodies' estimates anew, at rest where the next frame sees them: made of poses that were wrong."""
        if not bodies or self._estimates is None:
            return
        self._estimates, self._memory = copied(self._estimates), copied(self._memory)
        for i in bodies:
            self._estimates[i].seen_ns = NEVER_NS
        for place in np.flatnonzero(np.isin(self._commanded, list(bodies))).tolist():
            self._memory[place] = no_memory(1)[0]

    def law_failures(self) -> list[LawFailure]:
        """Those of the lab's own laws since it was asked last."""
        return [] if self._own is None else self._own.take_failures()

    def _begin(self, frame: LabFrame, plan: Plan) -> Rows[VehicleEstimate]:
        """The first estimate; vehicles not idle are taken to hover, as after a restart in flight."""
        flying = np.zeros(len(frame.bodies), dtype=np.bool_)
        flying[self._commanded] = [setpoint.mode is not Mode.IDLE for setpoint in plan.setpoints]
        force = np.zeros((len(plan.setpoints), 4))
        force[:, 2] = force[:, 3] = np.where(flying[self._commanded], GRAVITY_M_S2, 0.0)
        self._history = remember(self._history, frame.t_capture_ns - HISTORY_NS, force)
        return initial(frame, flying)


def _remembered(memory: Rows[LawMemory], wanted: Rows[Demand], target: Rows[Target], now_ns: int) -> Rows[LawMemory]:
    """What the law is to remember of this tick."""
    new = like(memory)
    new["z_m"], new["asked_ns"], new["saturated"] = wanted["z_m_lead_m_s2"], now_ns, target["saturation"] >= TILT
    return new


def _reference(generator: Generator, at: References, t_ns: int) -> Reference:
    """The references as their message."""
    return Reference(
        t_ns,
        at.frame[:, 0, :3], at.frame[:, 1, :3], at.frame[:, 2, :3],
        at.frame[:, 0, 3], at.frame[:, 1, 3], at.frame[:, 2, 3],
        at.slot[:, 0, :3], at.slot[:, 1, :3], at.slot[:, 2, :3],
        at.slot[:, 0, 3], at.slot[:, 1, 3],
        generator.in_formation,
    )  # fmt: skip


def _command(
    wanted: Rows[Demand], estimates: Rows[VehicleEstimate], commanded: NDArray[np.int64], t_ns: int
) -> Command:
    """The demand as its message."""
    return Command(
        t_ns, wanted["e_lead_m"], wanted["e_rate_lead_m_s"], wanted["s_lead_m_s"],
        wanted["t_m_lead_m_s2"], wanted["z_m_lead_m_s2"], estimates["dist_lab_m_s2"][commanded],
        wanted["acc_lab_m_s2"], wanted["yaw_rad"], wanted["yaw_rate_rad_s"],
    )  # fmt: skip


def _target(target: Rows[Target], t_ns: int) -> AttitudeTarget:
    """The targets as their message."""
    return AttitudeTarget(
        t_ns, target["q_lab_from_flu"], target["rate_flu_rad_s"], target["thrust_norm"], target["saturation"]
    )
