"""The control stack: frame in, attitude targets out. Pure functions in a row, and the one place that remembers."""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from formation.config import LabConfig
from formation.control.law import Demand, LawMemory, demand, no_memory
from formation.control.limits.attitude import TILT, Target, attitude
from formation.control.limits.barriers import limit_demands
from formation.control.limits.target import SetpointHoldOff, correct_level
from formation.control.prediction import LawContext
from formation.control.presets import Preset, preset_for
from formation.control.settings import (
    attitude_settings,
    barrier_settings,
    force_limits,
    law_settings,
    observer_settings,
)
from formation.estimation.response import NEVER_NS, SentCommands, no_history, remember
from formation.estimation.state import VehicleEstimate
from formation.estimation.update import estimate, initial, swarm_state
from formation.guidance.followed_leader import FollowedLeader, as_estimated, follow, slots_arm_m
from formation.guidance.plan import Mode, Plan
from formation.guidance.reference_generator import Generator, References, fleet, references, start, update
from formation.maths.arrays import Bool, Flags, Float, Scalars, Vec3s
from formation.maths.records import Rows, copied, like
from formation.messages import AttitudeTarget, Command, LabFrame, LawFailure, Reference, SwarmState
from formation.own_law.flight import Asked, OwnLaws
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleProfile

HISTORY_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Stages:
    """One message per stage of one tick, all stamped with the frame's capture time.

    The reference holds at that time; the command's errors and demand hold when the command takes effect. The target is
    what is sent, after every limit and correction.
    """

    state: SwarmState
    reference: Reference
    command: Command
    target: AttitudeTarget


@dataclass(frozen=True, slots=True, eq=False)
class _Memory:
    """All that the stack remembers from tick to tick.

    law, history: of the m commanded vehicles; airborne, yaw_acc_command_rad_s2 (n): of the last references.
    """

    estimates: Rows[VehicleEstimate]
    generator: Generator | None
    leader: Rows[FollowedLeader] | None
    history: Rows[SentCommands]
    law: Rows[LawMemory]
    airborne: Flags
    yaw_acc_command_rad_s2: Scalars


class ControlStack:
    """Estimates, leads and commands the vehicles of one lab; same inputs, bit-identical outputs.

    profiles: of the n vehicles in the order of `config.vehicles`; chosen: the gains, by default those that
    `config.control_preset` names (ValueError if there is no such preset); without: monitors that are switched off, of
    formation.control.limits.MONITORS; own: the lab's own laws, which take over where they fly;
    hold_off: withholds setpoints from rejected poses, if given.
    """

    def __init__(
        self,
        config: LabConfig,
        profiles: tuple[VehicleProfile, ...],
        chosen: Preset | None = None,
        without: frozenset[str] = frozenset(),
        own: OwnLaws | None = None,
        hold_off: SetpointHoldOff | None = None,
    ) -> None:
        gains = tuple(
            preset_for(config.control_preset, p, config.mocap) if chosen is None else chosen for p in profiles
        )
        self._fleet = fleet(config)
        self._commanded = np.array(config.commanded, dtype=np.int64)
        self._observers = observer_settings(config, profiles, gains)
        self._law = law_settings(config, gains)
        self._barriers = barrier_settings(config, profiles, without)
        self._force_limits = force_limits(config, profiles)
        self._attitude = attitude_settings(config, profiles)
        self._own, self._hold_off = own, hold_off
        self._memory: _Memory | None = None
        self._speeds_m_s = config.limits.speed_m_s, config.flight.formation_change_m_s

    def step(
        self, t_now_ns: int, frame: LabFrame, plan: Plan, hover_thrust_norm: Scalars,
        force_meas_flu_m_s2: Vec3s | None = None, level_bias_rad: Float | None = None, flies: Bool | None = None,
    ) -> Stages:  # fmt: skip
        """One tick at t_now_ns (>= the frame's capture) on the newest frame, bodies in the order of the config.

        A frame already seen is predicted on from. hover_thrust_norm (m): what hovers each vehicle, as known so far.
        force_meas_flu_m_s2 (n, 3): specific force by each vehicle's own accelerometer, mean since the frame before; NaN
        where it was not measured, None for all. level_bias_rad (m, 2): of the autopilots' attitudes (`correct_level`).
        flies (m): which drones are in the air, for the setpoint hold-off.
        """
        if self._hold_off is not None:
            self._reinitialise(self._hold_off.receive(frame))
        before = self._begin(frame, plan) if self._memory is None else self._memory
        force_meas = np.full((len(frame.bodies), 3), np.nan) if force_meas_flu_m_s2 is None else force_meas_flu_m_s2
        estimates = estimate(
            before.estimates, self._observers, frame, before.history, before.airborne, before.yaw_acc_command_rad_s2,
            force_meas,
        )  # fmt: skip
        state, motion = swarm_state(estimates), estimates["motion"]
        t_ns, mine = state.t_ns, motion[self._commanded]
        arm_m = slots_arm_m(plan.shape) if True in before.airborne.tolist() else -1.0
        led = as_estimated(motion[0], t_ns) if before.leader is None else before.leader
        followed = follow(led, motion[0], t_ns, arm_m, self._speeds_m_s)
        leader = followed["motion"][0]
        old = start(plan, mine, t_ns) if before.generator is None else before.generator
        generator = update(old, plan, self._fleet, mine, leader, t_ns)
        vehicles, path = generator.vehicles, generator.trajectory
        refs = references(generator, t_ns, leader)
        context = LawContext(estimates, self._observers, before.history, vehicles, path.numbers, path.knots, followed)
        wanted = demand(self._law, context, before.law, t_now_ns)
        if self._own is not None:
            wanted = self._own.take_over(wanted, Asked(self._law, context, before.law, t_now_ns))
        limited = limit_demands(self._barriers, wanted, estimates, vehicles, t_now_ns)
        target = attitude(self._attitude, self._force_limits, limited, estimates, vehicles, hover_thrust_norm, t_now_ns)
        airborne, yaw_acc_command = before.airborne.copy(), before.yaw_acc_command_rad_s2.copy()
        airborne[self._commanded], yaw_acc_command[self._commanded] = generator.airborne, refs.lab[:, 2, 3]
        self._memory = _Memory(
            estimates, generator, followed, remember(before.history, t_now_ns, target["force"]),
            _remembered(before.law, wanted, target, t_now_ns), airborne, yaw_acc_command,
        )  # fmt: skip
        command = _command(wanted, estimates["dist_lab_m_s2"][self._commanded], t_ns)
        sent = self._as_sent(_target(target, t_ns), hover_thrust_norm, level_bias_rad, flies)
        return Stages(state, _reference(refs, generator.in_formation, t_ns), command, sent)

    def _as_sent(
        self, target: AttitudeTarget, hover_thrust_norm: Scalars, level_bias_rad: Float | None, flies: Bool | None
    ) -> AttitudeTarget:
        """The limits that act on a finished target, in the order in which they act."""
        if self._hold_off is not None:
            in_air = np.zeros(len(target.thrust_norm), np.bool_) if flies is None else flies
            target = self._hold_off.limit(target, hover_thrust_norm, in_air)
        return target if level_bias_rad is None else correct_level(target, level_bias_rad)

    def _reinitialise(self, bodies: Collection[int]) -> None:
        """Begin these bodies' estimates anew, at rest where the next frame sees them: made of poses that were wrong."""
        if not bodies or self._memory is None:
            return
        estimates, law = copied(self._memory.estimates), copied(self._memory.law)
        for i in bodies:
            estimates[i].seen.t_ns = NEVER_NS
        for commanded_index in np.flatnonzero(np.isin(self._commanded, list(bodies))).tolist():
            law[commanded_index] = no_memory(1)[0]
        self._memory = replace(self._memory, estimates=estimates, law=law)

    def law_failures(self) -> list[LawFailure]:
        """Those of the lab's own laws since it was asked last."""
        return [] if self._own is None else self._own.pop_failures()

    def _begin(self, frame: LabFrame, plan: Plan) -> _Memory:
        """Before the first tick; vehicles not idle are taken to hover, as after a restart in flight."""
        n, m = len(frame.bodies), len(plan.setpoints)
        flying = np.zeros(n, dtype=np.bool_)
        flying[self._commanded] = [setpoint.mode is not Mode.IDLE for setpoint in plan.setpoints]
        force = np.zeros((m, 4))
        force[:, 2] = force[:, 3] = np.where(flying[self._commanded], GRAVITY_M_S2, 0.0)
        history = remember(no_history(m), frame.t_capture_ns - HISTORY_NS, force)
        airborne, yaw_acc = np.zeros(n, np.bool_), np.zeros(n)
        return _Memory(initial(frame, flying), None, None, history, no_memory(m), airborne, yaw_acc)


def _remembered(memory: Rows[LawMemory], wanted: Rows[Demand], target: Rows[Target], now_ns: int) -> Rows[LawMemory]:
    """What the law is to remember of this tick."""
    new = like(memory)
    new["z_m"], new["asked_ns"], new["saturated"] = wanted["z_m_lead_m_s2"], now_ns, target["saturation"] >= TILT
    return new


def _reference(at: References, in_formation: Flags, t_ns: int) -> Reference:
    """The references as their message."""
    origin, slot = at.frame[:, :, :3], at.slot[:, :, :3]
    heading, slot_heading = at.frame[:, :, 3], at.slot[:, :, 3]
    return Reference(
        t_ns,
        origin_lab_m=origin[:, 0],
        origin_vel_lab_m_s=origin[:, 1],
        origin_acc_lab_m_s2=origin[:, 2],
        heading_rad=heading[:, 0],
        heading_rate_rad_s=heading[:, 1],
        heading_acc_rad_s2=heading[:, 2],
        slot_lead_m=slot[:, 0],
        slot_vel_lead_m_s=slot[:, 1],
        slot_acc_lead_m_s2=slot[:, 2],
        slot_yaw_rad=slot_heading[:, 0],
        slot_yaw_rate_rad_s=slot_heading[:, 1],
        in_formation=in_formation,
    )


def _command(wanted: Rows[Demand], dist_lab_m_s2: Vec3s, t_ns: int) -> Command:
    """The demand as its message; dist_lab_m_s2 (m, 3): the Z3 that it answers."""
    return Command(
        t_ns,
        e_lead_m=wanted["e_lead_m"],
        e_rate_lead_m_s=wanted["e_rate_lead_m_s"],
        s_lead_m_s=wanted["s_lead_m_s"],
        t_m_lead_m_s2=wanted["t_m_lead_m_s2"],
        z_m_lead_m_s2=wanted["z_m_lead_m_s2"],
        dist_lab_m_s2=dist_lab_m_s2,
        acc_lab_m_s2=wanted["acc_lab_m_s2"],
        yaw_rad=wanted["yaw_rad"],
        yaw_rate_rad_s=wanted["yaw_rate_rad_s"],
    )


def _target(target: Rows[Target], t_ns: int) -> AttitudeTarget:
    """The targets as their message."""
    return AttitudeTarget(
        t_ns,
        q_lab_from_flu=target["q_lab_from_flu"],
        rate_flu_rad_s=target["rate_flu_rad_s"],
        thrust_norm=target["thrust_norm"],
        saturation=target["saturation"],
        held_off=np.zeros(len(target), np.bool_),
    )
