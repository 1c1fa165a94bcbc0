"""The host of studies: cameras, the ground's control and vehicles, without MAVLink, guards, autopilots and processes.

A study asks what a law or a gain is worth; codecs and monitors do not answer that, and take nine tenths of the time of
a lockstep flight. What is left is the same code: the emulated cameras, the control stack, the safety rules, the phases,
the attitude loop and the body. Its drones are armed and off-board at once (`_drone`), and a setpoint arrives after its
link's delay. An autopilot errs about level by what its accelerometer's bias makes of it. How near the two hosts are is
asserted in tests/sim/research/test_host.py.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from analysis.load import Flight, from_records
from drone_agent.config import SimulatedDroneConfig
from drone_agent.simulation.attitude_loop import OWN, advance_into, turn_target
from drone_agent.simulation.battery import BatteryPack
from drone_agent.simulation.disturbance import Air, push_into
from drone_agent.simulation.inertial import WINDOW_NS, InertialSensor
from formation import topics
from formation.codes import FlightResult
from formation.config import LabConfig
from formation.control.presets import Preset
from formation.control.stack import ControlStack, Stages
from formation.guidance.plan import Plan
from formation.maths import frames
from formation.maths.arrays import Bool, Float, Layout, Quat, Quats, Scalars, Vec3, Vec3s
from formation.maths.kernel import kernel
from formation.maths.quaternion import multiply_into
from formation.maths.records import Rows, blank, copied
from formation.messages import (
    AttitudeTarget,
    Cause,
    LabFrame,
    OperatorReply,
    Phase,
    RawFrame,
    Truth,
    Verb,
)
from formation.own_law.flight import OwnLaws
from formation.reasons import Reject
from formation.safety import rules
from formation.safety.phases import Trigger
from formation.topics import Topic
from formation.vehicle.body import GRAVITY_M_S2, MASS, NUMBERS
from formation.vehicle.profile import VehicleState, at_rest, on_ground
from formation.vehicle.rigid_body import downwash_into
from gcs import formation_change
from gcs.core import own_laws
from gcs.drones.drone import Drone
from gcs.drones.link_state import DroneLink
from gcs.drones.telemetry import SpecificForce
from gcs.flight import Flight as Phases
from gcs.safety import FactGatherer
from mocap.alignment import Alignment
from sim import lockstep
from sim.cameras.emulator import MocapEmulator
from sim.cameras.playback import Playback
from sim.faults.fault import Family, Fault
from sim.faults.onsets import Onsets
from sim.scenario import LinkModel, Scenario, agent_configs, leader_seconds, recorded_leader
from sim.script import Operator, OperatorView
from sim.world import OPERATOR_PERIOD_NS, T0_NS
from wire.logs.mcap_read import Entry
from wire.transport.memory_bus import NOTHING_DUE_NS, DelayModel, MemoryLink, random_delay

ARMED_AFTER_NS = 1_300_000_000
"""As long as drones in lockstep take to be armed: what comes at a time of the flight, a gust, comes at the same."""
LEVEL_SHARE = 0.75
"""Of the tilt that an accelerometer's bias feigns, what an autopilot's filter leaves in its level: as measured in
lockstep, where it keeps to 0.1 mrad from the take-off on."""
ATTITUDE_NS = 20_000_000
"""Period of ATTITUDE_QUATERNION, as the ground asks for it."""
IN_TRANSIT = 32
"""So many setpoints of one vehicle may be."""
STEP_NS, GUST_NS = OWN.step_ns, WINDOW_NS
STATE = 18
"""Seconds since a state was so, and the state (formation.vehicle.rigid_body)."""
STILL: Float = np.zeros((0, 0, 3))
"""No wind beside the scenario's air."""


@dataclass(slots=True)
class FlownVehicle:
    """One true vehicle; a record.

    x: its state; due_ns, target: the last setpoints, and when each reaches its loop; q_flu_from_own: of its axes as its
    autopilot has them.
    """

    x: Annotated[Float, Layout(np.float64, (STATE - 1,))]
    numbers: Annotated[Float, Layout(np.float64, (NUMBERS,))]
    motor_gain: Annotated[Float, Layout(np.float64, (4,))]
    q_flu_from_own: Quat
    push_lab_m_s2: Vec3
    reach_m: float
    thrust_scale: float
    due_ns: Annotated[NDArray[np.int64], Layout(np.int64, (IN_TRANSIT,))]
    target: Annotated[Float, Layout(np.float64, (IN_TRANSIT, 8))]


@kernel
def order(vehicles: Rows[FlownVehicle], q: Quats, rate: Vec3s, thrust: Scalars, due_ns: NDArray[np.int64]) -> None:
    """Each vehicle's newest setpoint, due at its loop at due_ns (m), not before the one sent before it; -1: lost."""
    for i in range(len(vehicles)):
        v = vehicles[i]
        if due_ns[i] < 0:
            continue
        for k in range(IN_TRANSIT - 1):
            v.due_ns[k] = v.due_ns[k + 1]
            for n in range(8):
                v.target[k, n] = v.target[k + 1, n]
        v.due_ns[-1] = max(due_ns[i], v.due_ns[-1])
        for n in range(4):
            v.target[-1, n] = q[i, n]
        for n in range(3):
            v.target[-1, 4 + n] = rate[i, n]
        v.target[-1, 7] = thrust[i]


@kernel
def advance_vehicles(
    vehicles: Rows[FlownVehicle], air: Rows[Air], wind: Float, down_m_s2: Float, t0_ns: int, from_ns: int, to_ns: int
) -> None:
    """Every vehicle from one point of the grid to another, as drone_agent.simulation.airframe does one.

    down_m_s2 (m): what each other's jets do; wind (K, m, 3): what pushes each vehicle beside the air, m/s^2 in
    `lab`, from each GUST_NS after t0_ns to the next.
    """
    for i in range(len(vehicles)):
        v, t_ns = vehicles[i], from_ns
        while t_ns < to_ns:
            since_ns = (t_ns - t0_ns) % GUST_NS
            if since_ns == 0:
                push_into(air, (t_ns - t0_ns) * 1e-9, v.x[:3], v.reach_m, v.push_lab_m_s2)
                window = (t_ns - t0_ns) // GUST_NS
                if window < len(wind):
                    for axis in range(3):
                        v.push_lab_m_s2[axis] += wind[window, i, axis]
                v.push_lab_m_s2[2] -= down_m_s2[i]
            k = _ruling(v, t_ns)
            steps = (min(to_ns, t_ns + GUST_NS - since_ns) - t_ns) // STEP_NS
            if k + 1 < IN_TRANSIT:
                steps = min(steps, (v.due_ns[k + 1] - t_ns + STEP_NS - 1) // STEP_NS)
            _integrate(v, v.x, k, STEP_NS * 1e-9, steps)
            t_ns += steps * STEP_NS


@kernel
def states_into(vehicles: Rows[FlownVehicle], bodies: NDArray[np.int64], grid_ns: int, to_ns: int, out: Float) -> None:
    """Where the vehicles are at to_ns, less than a step after grid_ns, into the rows `bodies` (m) of out (n, STATE)."""
    for i in range(len(vehicles)):
        v = vehicles[i]
        x = v.x.copy()
        if to_ns > grid_ns:
            _integrate(v, x, _ruling(v, grid_ns), (to_ns - grid_ns) * 1e-9, 1)
        out[bodies[i], 1:] = x


@kernel
def _ruling(v: FlownVehicle, t_ns: int) -> int:
    """Which setpoint the loop tracks then."""
    k = IN_TRANSIT - 1
    while k > 0 and v.due_ns[k] > t_ns:
        k -= 1
    return k


@kernel
def own_attitudes(vehicles: Rows[FlownVehicle]) -> Quats:
    """The attitudes (m, 4) as the autopilots have them."""
    q_lab_from_own = np.empty((len(vehicles), 4))
    for i in range(len(vehicles)):
        multiply_into(vehicles[i].x[6:10], vehicles[i].q_flu_from_own, q_lab_from_own[i])
    return q_lab_from_own


@kernel
def _integrate(v: FlownVehicle, x: Float, k: int, dt_s: float, steps: int) -> None:
    own, target = np.empty(4), np.empty(8)
    multiply_into(x[6:10], v.q_flu_from_own, own)
    turn_target(x[6:10], own, v.target[k], target)
    advance_into(x, v.numbers, target, True, v.thrust_scale, v.motor_gain, v.push_lab_m_s2, dt_s, steps)


class OwnForces:
    """What the drones' accelerometers show the ground: sampled, sent by HIGHRES_IMU, averaged between frames."""

    def __init__(self, drones: Sequence[SimulatedDroneConfig], up: DelayModel, rate_hz: float, states: Float) -> None:
        """rate_hz: of HIGHRES_IMU; states (m, 17): at T0_NS."""
        self._sensors = [InertialSensor(drone.inertial_error, drone.sysid) for drone in drones]
        self._received = [SpecificForce() for _ in drones]
        self._link = MemoryLink[tuple[int, list[Vec3]]](up)
        self._period_ns = round(1e9 / rate_hz)
        self._states, self._sent_ns = states.copy(), T0_NS

    def sample(self, states: Float, t_ns: int) -> None:
        """The vehicles are in these states, WINDOW_NS after the last ones."""
        before, self._states = self._states, states.copy()
        samples = [
            sensor.sample(VehicleState(start), VehicleState(end), t_ns, WINDOW_NS * 1e-9)
            for sensor, start, end in zip(self._sensors, before, self._states, strict=True)
        ]
        if t_ns - self._sent_ns >= self._period_ns:
            self._sent_ns = t_ns
            self._link.push(t_ns, (t_ns, [sample.specific_force_flu_m_s2 for sample in samples]))

    def pop_means(self, to_ns: int, now_ns: int) -> list[Vec3 | float]:
        """As the ground has them at now_ns; NaN where it has none."""
        for _, (t_ns, forces) in self._link.pop_due(now_ns):
            for received, force in zip(self._received, forces, strict=True):
                received.receive(t_ns, force, now_ns)
        means = [received.pop_mean(to_ns) for received in self._received]
        return [np.nan if mean is None else mean for mean in means]


class Vehicles:
    """All true vehicles of a flight, in the order in which the lab commands them, each behind its link."""

    def __init__(
        self, scenario: Scenario, leader: Playback | None, seed: int, wind: Float = STILL, *, has_jets: bool = True
    ) -> None:
        """wind: see `advance_vehicles`; has_jets: whether they push each other, besides."""
        lab, link, drones = scenario.lab, scenario.link, agent_configs(scenario, leader)
        profiles = [drone.true_vehicle() for drone in drones]
        self.sysids = tuple(drone.sysid for drone in drones)
        self._names = tuple(lab.vehicles[i].body for i in lab.commanded)
        self.bodies = np.array(lab.commanded)
        """Which of the lab's vehicles they are (m)."""
        self.carried: Bool = np.isin(np.arange(len(lab.vehicles)), self.bodies)
        self._flown = blank(FlownVehicle, len(drones))
        self._flown["motor_gain"] = 1.0
        for i, (drone, profile) in enumerate(zip(drones, profiles, strict=True)):
            state = at_rest(np.array(drone.start_lab_m), frames.from_yaw(np.array(drone.start_yaw_rad)))
            self._flown["x"][i], self._flown["target"][i, :, :4] = state.x, state.q_lab_from_flu
            self._flown["numbers"][i], self._flown["reach_m"][i] = profile.numbers, profile.reach_m
            x, y, _ = drone.inertial_error.bias_flu_m_s2
            self._flown["q_flu_from_own"][i] = frames.from_rotation_vector(
                LEVEL_SHARE / GRAVITY_M_S2 * np.array([y, -x, 0.0])
            )
        self._weight_n = np.array([profile.weight_n for profile in profiles])
        self._packs = [BatteryPack(profile.battery) for profile in profiles]
        self._command_ns = [round(profile.command_delay_s * 1e9) for profile in profiles]
        self._down = [_delay(link, link.down_s, [seed, 3, sysid]) for sysid in self.sysids]
        up = _delay(link, link.up_s, [seed, 4])
        self.attitudes = MemoryLink[tuple[int, Quats]](up)
        """Own attitudes (m, 4) on their way to the ground, with their time."""
        imu_hz = lab.link.imu_rate_hz
        self.forces = OwnForces(drones, up, imu_hz, self._flown["x"]) if imu_hz else None
        self._attitude_ns, self._force_ns = T0_NS + ATTITUDE_NS, T0_NS + WINDOW_NS if imu_hz else NOTHING_DUE_NS
        self._air, self._wind, self._t_ns = scenario.air.air, wind, T0_NS
        self._has_jets, self._down_m_s2 = has_jets, np.zeros(len(drones))
        self.drain(0.0)

    def order(self, target: AttitudeTarget, now_ns: int) -> None:
        """The ground sends its targets."""
        delays_ns = [down() for down in self._down]
        due_ns = [-1 if d is None else now_ns + d + own for d, own in zip(delays_ns, self._command_ns, strict=True)]
        order(self._flown, target.q_lab_from_flu, target.rate_flu_rad_s, target.thrust_norm, np.array(due_ns))

    def states_at(self, now_ns: int) -> Float:
        """The state (n, STATE) of every body at now_ns."""
        grid_ns = now_ns - (now_ns - T0_NS) % STEP_NS
        self._advance_to(grid_ns)
        out = np.zeros((len(self.carried), STATE))
        states_into(self._flown, self.bodies, grid_ns, now_ns, out)
        return out

    def truths(self, states: Float, now_ns: int) -> Iterator[Truth]:
        """The drones among these states as messages."""
        pushes = self._flown["push_lab_m_s2"].copy()
        for sysid, body, push in zip(self.sysids, self.bodies, pushes, strict=True):
            x = states[body, 1:]
            stands = on_ground(VehicleState(x))
            yield Truth(now_ns, sysid, x[0:3], x[3:6], x[6:10], x[10:13], push, stands, armed=True)

    def change_mass(self, fault: Fault, begins: bool, now_ns: int) -> None:
        """A payload's coming, or going: the mass of those bodies is so many times what it was."""
        self._advance_to(now_ns - (now_ns - T0_NS) % STEP_NS)
        for i, body in enumerate(self._names):
            if fault.hits(body):
                times = fault.severity if begins else 1.0 / fault.severity
                self._flown["numbers"][i, MASS] *= times
                self._weight_n[i] *= times

    def blow(self, wind: Float) -> None:
        """From the next GUST_NS on this wind (K, m, 3) pushes beside the air."""
        before = (self._t_ns - T0_NS) // GUST_NS + 1
        self._wind = np.concatenate([np.zeros((before, *wind.shape[1:])), wind])

    def drain(self, dt_s: float) -> None:
        """Take dt_s at the present thrusts out of the packs."""
        shares = self._flown["x"][:, 13:17].sum(axis=1) / self._weight_n
        for i, (pack, share) in enumerate(zip(self._packs, shares.tolist(), strict=True)):
            pack.drain(share, dt_s)
            self._flown["thrust_scale"][i] = pack.thrust_scale

    @property
    def flown(self) -> Rows[FlownVehicle]:
        """The vehicles (m) as they are."""
        return self._flown

    def begin(self, flown: Rows[FlownVehicle], t_ns: int) -> None:
        """Fly on from these at t_ns, a point of the grid of GUST_NS; what is under way to the ground stays so."""
        self._flown, self._t_ns = copied(flown), t_ns
        self._attitude_ns = t_ns + ATTITUDE_NS
        if self.forces is not None:
            self._force_ns = t_ns + GUST_NS

    def _advance_to(self, grid_ns: int) -> None:
        """To a point of the grid; sensors sample on the way."""
        while (due_ns := min(self._attitude_ns, self._force_ns)) <= grid_ns:
            self._advance_grid(due_ns)
            if due_ns == self._attitude_ns:
                self.attitudes.push(due_ns, (due_ns, own_attitudes(self._flown)))
                self._attitude_ns += ATTITUDE_NS
            if self.forces is not None and due_ns == self._force_ns:
                self.forces.sample(self._flown["x"], due_ns)
                self._force_ns += WINDOW_NS
        self._advance_grid(grid_ns)

    def _advance_grid(self, to_ns: int) -> None:
        if self._has_jets:
            x, numbers = (np.ascontiguousarray(self._flown[name]) for name in ("x", "numbers"))
            downwash_into(x, numbers, self._down_m_s2)
        advance_vehicles(self._flown, self._air, self._wind, self._down_m_s2, T0_NS, self._t_ns, to_ns)
        self._t_ns = to_ns


class Ground:
    """The ground as a study flies it: control, safety's rules, the vehicles behind their links, and the record."""

    def __init__(
        self, lab: LabConfig, vehicles: Vehicles, gains: Preset | None = None, own: OwnLaws | None = None
    ) -> None:
        """gains: in the place of the lab's preset; own: in the place of the lab's own laws."""
        self.lab, self.vehicles = lab, vehicles
        profiles = tuple(lab.profile_of(vehicle) for vehicle in lab.vehicles)
        self.now_ns = T0_NS
        self.records: list[Entry] = []
        self._stack = ControlStack(lab, profiles, gains, own=own or own_laws(lab))
        self._hover_norm = np.array([profiles[i].hover_thrust_norm for i in lab.commanded])
        self._gatherer = FactGatherer(lab, ())
        self._rule_state = rules.start(len(lab.vehicles))
        self._stages: Stages | None = None

    def receive_attitudes(self, t_ns: int, q_lab_from_own: Quats) -> None:
        """The drones' own attitudes (m, 4) at t_ns arrive."""
        stamps_ns = np.full(len(self.vehicles.bodies), t_ns)
        self._gatherer.attitudes.receive_attitudes(self.vehicles.bodies, stamps_ns, q_lab_from_own)

    def control(self, frame: LabFrame, plan: Plan, now_ns: int) -> Stages:
        """A frame arrives: one turn of control; nothing is sent yet."""
        self.now_ns, vehicles, gatherer = now_ns, self.vehicles, self._gatherer
        gatherer.attitudes.receive_frame(frame)
        for _, (t_ns, q_lab_from_own) in vehicles.attitudes.pop_due(now_ns):
            self.receive_attitudes(t_ns, q_lab_from_own)
        force_meas = None
        if vehicles.forces is not None:
            force_meas = np.full((len(frame.bodies), 3), np.nan)
            force_meas[vehicles.bodies] = vehicles.forces.pop_means(frame.t_capture_ns, now_ns)
        stages = self._stages = self._stack.step(
            now_ns, frame, plan, self._hover_norm, force_meas, gatherer.level_bias_rad()
        )
        self.record(topics.MOCAP, frame)
        self.record(topics.STATE, stages.state)
        self.record(topics.REFERENCE, stages.reference)
        self.record(topics.COMMAND, stages.command)
        self.record(topics.TARGET, stages.target)
        for failure in self._stack.law_failures():
            self.record(topics.LAW_FAILURE, failure)
        return stages

    def must_land(self, phase: Phase, now_ns: int) -> bool:
        """Whether a rule of safety ends the flight now."""
        facts = self._gatherer.gather(self._stages, 0.0, now_ns)
        self._rule_state, verdict = rules.assess(self._rule_state, facts, phase, self.lab.limits, now_ns)
        return verdict.trigger is not None

    def change_shape(self, asked: str, phases: Phases, now_ns: int) -> tuple[Reject, ...]:
        """Have the followers take another shape, or why not."""
        facts = self._gatherer.gather(self._stages, 0.0, now_ns)
        judged = formation_change.change(asked, phases, facts, self._stages, now_ns)
        if not judged.reasons:
            judged.apply()
        return judged.reasons

    def record(self, topic: Topic, message: object) -> None:
        """Record a message now."""
        self.records.append(Entry(topic, self.now_ns, message))


class StudyFlight:
    """One flight of the host: `step` moves on to the next exposure or frame, until there is a `result`."""

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        gains: Preset | None = None,
        own: OwnLaws | None = None,
        wind: Float = STILL,
    ) -> None:
        """gains, own: see `Ground`; wind: see `fly`. The script's landing is not flown: a study ends in HOLD."""
        if unknown := {fault.family for fault in scenario.faults} - {Family.MASS}:
            raise ValueError(f"{scenario.name}: the host of studies has no fault `{min(unknown)}`; fly it in lockstep")
        lab = scenario.lab
        leader = recorded_leader(scenario)
        self.now_ns = T0_NS
        self.result: FlightResult | None = None
        self._cameras = MocapEmulator(scenario.mocap, lab, leader, seed, T0_NS)
        self._alignment = Alignment(lab)
        self._vehicles = Vehicles(scenario, leader, seed)
        self._ground = Ground(lab, self._vehicles, gains, own)
        self.records = self._ground.records
        steps = [step for step in scenario.script if step.verb is not Verb.LAND]
        self._operator = Operator(tuple(steps), leader_seconds(scenario, leader))
        self._operator_ns = T0_NS + OPERATOR_PERIOD_NS
        self._faults, self._wind = Onsets(scenario.faults), wind
        drones = zip(lab.commanded, self._vehicles.sysids, strict=True)
        self._phases = Phases(lab, tuple(_drone(lab, i, sysid) for i, sysid in drones), T0_NS)
        self._note_phases()

    def step(self) -> None:
        """Do all that is due next."""
        cameras = self._cameras
        now_ns = self.now_ns = min(
            cameras.next_exposure_ns, cameras.next_frame_ns, self._operator_ns, self._faults.next_due_ns
        )
        for fault, begins in self._faults.pop_due(now_ns):
            self._vehicles.change_mass(fault, begins, now_ns)
        if cameras.next_exposure_ns <= now_ns:
            states = self._vehicles.states_at(now_ns)
            self._ground.now_ns = now_ns
            for truth in self._vehicles.truths(states, now_ns):
                self._ground.record(topics.TRUTH, truth)
            cameras.expose_states(states, self._vehicles.carried)
        for raw in cameras.pop_due(now_ns):
            self._control(raw)
        if self._operator_ns <= now_ns:
            self._operator_ns += OPERATOR_PERIOD_NS
            self._watch_over()
            self._ask()
            self._vehicles.drain(OPERATOR_PERIOD_NS * 1e-9)

    def _control(self, raw: RawFrame) -> None:
        """A frame arrives at the ground: one turn of its control."""
        frame = self._alignment.align(raw, raw.seq, raw.t_capture_ns, self.now_ns)
        phases, was_formed = self._phases, self._phases.trajectory_start_ns is not None
        stages = self._ground.control(frame, phases.plan(), self.now_ns)
        self._vehicles.order(stages.target, self.now_ns)
        phases.update(stages, self.now_ns)
        if phases.trajectory_start_ns is not None and not was_formed and len(self._wind):
            self._vehicles.blow(self._wind)
        self._note_phases()

    def _watch_over(self) -> None:
        """Safety's rules, as often as the operator looks: no rule of tracking acts sooner."""
        if self._ground.must_land(self._phases.phase, self.now_ns):
            self._pull(Trigger.LAND)
            self.result = FlightResult.ABORTED

    def _ask(self) -> None:
        """The operator looks, and asks for the next thing."""
        now_ns, phases = self.now_ns, self._phases
        is_formed = phases.trajectory_start_ns is not None
        if is_formed:
            self._cameras.start(now_ns)
        self._operator.observe(OperatorView(phases.phase, is_formed, phases.trajectory_done(now_ns)), now_ns)
        request = self._operator.next_request(now_ns) if now_ns >= T0_NS + ARMED_AFTER_NS else None
        if request is not None and request.verb is Verb.SHAPE:
            reasons = self._ground.change_shape(request.argument, phases, now_ns)
            self._operator.receive(OperatorReply(request.id, not reasons, str(reasons)), now_ns)
        elif request is not None:
            before = phases.phase
            self._pull(Trigger(request.verb.value))
            self._operator.receive(OperatorReply(request.id, phases.phase is not before, ""), now_ns)
        if self._operator.outcome is not None:
            self.result = self._operator.outcome.result

    def _pull(self, trigger: Trigger) -> None:
        self._phases.pull(trigger, Cause.OPERATOR, "", self.now_ns)
        self._note_phases()

    def _note_phases(self) -> None:
        """Record the phases entered since the last call; faults may wait for one."""
        self._ground.now_ns = self.now_ns
        for change in self._phases.changes:
            self._faults.enter(change.phase, self.now_ns)
            self._ground.record(topics.PHASE, change)
        self._phases.changes.clear()
        self._phases.events.clear()


def _drone(lab: LabConfig, index: int, sysid: int) -> Drone:
    """A drone that always reports what is asked of it: armed and off-board, from now on."""
    body = lab.vehicles[index]
    link = DroneLink(body, sysid, lab.profile_of(body))
    link.armed, link.offboard, link.telemetry.heartbeat_ns = True, True, NOTHING_DUE_NS
    return Drone(index, link)


class Host(StrEnum):
    """By what a study is flown."""

    STUDY = "study"
    LOCKSTEP = "lockstep"

    @property
    def text(self) -> str:
        """In words, of flights."""
        return "in lockstep" if self is Host.LOCKSTEP else "by the host of studies"


def fly(
    scenario: Scenario,
    seed: int,
    gains: Preset | None = None,
    host: Host = Host.STUDY,
    own: OwnLaws | None = None,
    wind: Float = STILL,
) -> tuple[FlightResult, Flight]:
    """Fly a scenario, up to its landing by this host; gains: in the place of the lab's preset; own: by the host of
    studies, in the place of the lab's own laws; wind (K, m, 3): by it, too, beside the air, m/s^2 in `lab`, every
    GUST_NS from when the leader's trajectory begins.

    The flight comes back as it would be loaded from its log.
    """
    if host is Host.LOCKSTEP:
        flown, logged = lockstep.run_and_load(scenario, seed, gains=gains)
        return flown.outcome.result, logged
    flight = StudyFlight(scenario, seed, gains, own, wind)
    end_ns = T0_NS + round(scenario.longest_s * 1e9)
    with lockstep.uncollected():
        while flight.result is None and flight.now_ns < end_ns:
            flight.step()
        metadata = {"lab": scenario.lab.model_dump_json(), "scenario": scenario.name, "seed": str(seed), "host": host}
        return flight.result or FlightResult.ABORTED, from_records(metadata, flight.records)


def _delay(link: LinkModel, delay_s: float, seed: list[int]) -> DelayModel:
    return random_delay(delay_s, link.jitter_s, link.lost_share, np.random.default_rng(seed))
