"""The control stack: frame in, attitude targets out. Pure functions in a row, and the one place that remembers."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from formation.config import LabConfig
from formation.control.attitude import TILT, Attitude, attitude
from formation.control.composite_law import Demand, demand
from formation.control.presets import Preset, preset_for
from formation.control.settings import attitude_settings, estimator_settings, law_settings
from formation.estimation.state import EstimatorState, estimate, initial, swarm_state
from formation.guidance.plan import Mode, Plan
from formation.guidance.reference_generator import Course, Guidance, crew, depart, evaluate, steer
from formation.maths.arrays import Float, Scalars
from formation.messages import AttitudeTarget, Command, LabFrame, Reference, SwarmState
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleProfile
from formation.vehicle.response import SECONDS, History, no_history, remember

STEP_MAX_S = 0.1
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
    `config.control_preset` names (ValueError if there is no such preset).
    """

    def __init__(self, config: LabConfig, profiles: tuple[VehicleProfile, ...], chosen: Preset | None = None) -> None:
        gains = tuple(
            preset_for(config.control_preset, p, config.mocap) if chosen is None else chosen for p in profiles
        )
        self._crew = crew(config)
        self._commanded = np.array(config.commanded, dtype=np.int64)
        self._estimator = estimator_settings(config, profiles, gains)
        self._law = law_settings(config, profiles, gains, self._estimator)
        self._attitude = attitude_settings(config, profiles)
        m = len(self._commanded)
        self._history: History = no_history(m)
        self._memory: Float = np.zeros((m, 3))
        self._saturation: Scalars = np.zeros(m)
        self._turn: Scalars = np.zeros(len(config.vehicles))
        self._estimate: EstimatorState | None = None
        self._course: Course | None = None
        self._last_ns = 0

    def step(self, t_now_ns: int, frame: LabFrame, plan: Plan, hover_thrust_norm: Scalars) -> Stages:
        """One tick at t_now_ns (>= the frame's capture) on the newest frame, bodies in the order of the config.

        A frame already seen is predicted on from. hover_thrust_norm (m): what hovers each vehicle, as known so far.
        """
        before = self._begin(frame, plan) if self._estimate is None else self._estimate
        airborne = np.zeros(len(frame.bodies), dtype=np.bool_)
        if self._course is not None:
            airborne[self._commanded] = self._course.airborne
        state = estimate(before, self._estimator, frame, self._history, airborne, self._turn)
        swarm = swarm_state(state, self._estimator, self._turn)
        motion = _motion(swarm)
        mine = motion[self._commanded]
        old = depart(plan, mine, state.t_ns) if self._course is None else self._course
        course = steer(old, plan, self._crew, mine, motion[0], state.t_ns)
        dt_s = 0.0 if self._course is None else min((t_now_ns - self._last_ns) * SECONDS, STEP_MAX_S)
        wanted = demand(
            self._law, state, course, self._history, self._memory, self._saturation >= TILT, self._turn, t_now_ns, dt_s
        )
        idle = np.array([leg.mode is Mode.IDLE for leg in plan.legs])
        target = attitude(self._attitude, wanted, state, course, idle, hover_thrust_norm, t_now_ns)
        self._history = remember(self._history, t_now_ns, target.force)
        self._memory, self._saturation, self._last_ns = wanted.memory, target.saturation, t_now_ns
        self._estimate, self._course = state, course
        guidance = evaluate(course, state.t_ns, motion[0])
        self._turn = np.zeros(len(frame.bodies))
        self._turn[self._commanded] = guidance.lab[:, 2, 3]
        return Stages(
            swarm,
            _reference(course, guidance, state.t_ns),
            _command(wanted, state, self._commanded),
            _target(target, state.t_ns),
        )

    def _begin(self, frame: LabFrame, plan: Plan) -> EstimatorState:
        """The first estimate; vehicles not idle are taken to hover, as after a restart in flight."""
        flying = np.zeros(len(frame.bodies), dtype=np.bool_)
        flying[self._commanded] = [leg.mode is not Mode.IDLE for leg in plan.legs]
        force = np.zeros((len(plan.legs), 4))
        force[:, 2] = force[:, 3] = np.where(flying[self._commanded], GRAVITY_M_S2, 0.0)
        self._history = remember(self._history, frame.t_capture_ns - HISTORY_NS, force)
        return initial(frame, flying)


def _motion(swarm: SwarmState) -> Float:
    """Estimated motions (n, 3, 4), as formation.control.relative_frame lays them out."""
    motion = np.empty((len(swarm.yaw_rad), 3, 4))
    motion[:, 0, :3], motion[:, 0, 3] = swarm.pos_lab_m, swarm.yaw_rad
    motion[:, 1, :3], motion[:, 1, 3] = swarm.vel_lab_m_s, swarm.yaw_rate_rad_s
    motion[:, 2, :3], motion[:, 2, 3] = swarm.acc_lab_m_s2, swarm.yaw_acc_rad_s2
    return motion


def _reference(course: Course, at: Guidance, t_ns: int) -> Reference:
    """The guidance as its message."""
    return Reference(
        t_ns,
        at.frame[:, 0, :3], at.frame[:, 1, :3], at.frame[:, 2, :3],
        at.frame[:, 0, 3], at.frame[:, 1, 3], at.frame[:, 2, 3],
        at.slot[:, 0, :3], at.slot[:, 1, :3], at.slot[:, 2, :3],
        at.slot[:, 0, 3], at.slot[:, 1, 3],
        course.in_formation,
    )  # fmt: skip


def _command(wanted: Demand, state: EstimatorState, commanded: NDArray[np.int64]) -> Command:
    """The demand as its message."""
    return Command(
        state.t_ns, wanted.e, wanted.e_rate, wanted.s, wanted.t_m, wanted.memory, state.dist_lab_m_s2[commanded],
        wanted.acc, wanted.yaw[:, 0], wanted.yaw[:, 1],
    )  # fmt: skip


def _target(target: Attitude, t_ns: int) -> AttitudeTarget:
    """The attitude as its message."""
    return AttitudeTarget(t_ns, target.q_lab_from_flu, target.rate_flu_rad_s, target.thrust_norm, target.saturation)
