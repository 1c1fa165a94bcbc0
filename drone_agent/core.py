"""An autopilot of ours and its vehicle without their sockets: packets and time in; packets, truth and events out.

Sans-IO: time is an argument, and everything inside happens at its own time and in order, whenever anybody asks.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from drone_agent.autopilots import MODELS
from drone_agent.autopilots.model import AutopilotModel
from drone_agent.autopilots.parameters import Parameters
from drone_agent.config import AutopilotConfig, SimulatedDroneConfig
from drone_agent.flight.autopilot import CONTROL_NS, Autopilot
from drone_agent.flight.estimator import Estimator
from drone_agent.flight.failsafes import Failsafes
from drone_agent.flight.vehicle import Estimate, ExternalPose, Vehicle
from drone_agent.link.commands import Commander
from drone_agent.link.inbox import READS, Inbox
from drone_agent.link.schedule import RASTER_NS, Schedule
from drone_agent.link.telemetry import BUILDERS, ON_REQUEST, Telemetry
from drone_agent.simulation.airframe import Airframe
from drone_agent.simulation.attitude_loop import OWN, Physics
from drone_agent.simulation.inertial import InertialSensor
from formation.maths.geodesy import to_globe
from formation.messages import Datagram, Event, Truth
from formation.vehicle.profile import on_ground, profile
from wire.autopilots.table import AutopilotTable
from wire.link_messages import DRONE_COMPONENT, Address, LinkMessage, MessageId, Packet, SimTruth, StatusText
from wire.mavlink.codec import Codec
from wire.mavlink.framing import Frame, MavlinkError, packed

_MONITOR_PERIOD_NS = 50_000_000
_MONITOR_PERIOD_S = _MONITOR_PERIOD_NS * 1e-9
_BURST_NS = 1_000_000_000  # of telemetry: what a socket's buffer of the default size holds


class AgentOutgoing(NamedTuple):
    """The output of one tick: datagrams for the ground, the true state if it is due, events."""

    datagrams: tuple[Datagram, ...]
    truth: Truth | None
    events: list[Event]


class AgentTurn(NamedTuple):
    """The same with frames, for a guard in the same process."""

    frames: list[Frame]
    truth: Truth | None
    events: list[Event]


class AutopilotCore:
    """An autopilot and a vehicle. Call a `receive` with what arrives and `tick` or `turn` no later than `due_ns`."""

    def __init__(
        self, config: AutopilotConfig, model: AutopilotModel, parameters: Parameters, t0_ns: int, estimate: Estimate,
        vehicle: Vehicle,
    ) -> None:  # fmt: skip
        self.config = config
        self._vehicle = vehicle
        self.codec = Codec(Address(config.sysid, DRONE_COMPONENT), reads=READS)
        self.parameters = parameters
        self._t0_ns = self._now_ns = t0_ns
        configured = profile(config.profile, config.profiles)
        self.autopilot = Autopilot(config, model, self.parameters, vehicle, estimate, configured)
        self._failsafes = Failsafes(self.autopilot)
        self._direct = config.link.kind == "udp"
        direct_hz = model.direct_rates_hz if self._direct else {}
        rates_hz = {**model.rates_hz, **direct_hz, **config.rates_hz}
        self._schedule = Schedule(rates_hz, ON_REQUEST, t0_ns)
        self._commander = Commander(config, self.autopilot, self._schedule)
        self._telemetry = Telemetry(config, self.autopilot, t0_ns)
        self._inbox = Inbox(config, self.autopilot, self._failsafes, self._commander, t0_ns, self._send, self._use_pose)
        self._outbox: list[Frame] = []
        self._events: list[Event] = []
        self._monitor_ns = self._inside_ns = t0_ns
        self._control_ns = t0_ns
        for severity, text in model.texts.boot:
            self.autopilot.report(severity, text)
        self.due_ns = t0_ns

    def receive(self, message: Datagram, now_ns: int) -> None:
        """Take in a datagram. Never raises on what it holds."""
        self._receive(self.codec.receive(message.data) if message.sysid == self.config.sysid else [], now_ns)

    def receive_frames(self, frames: Iterable[Frame], now_ns: int) -> None:
        """Take in the frames of its guard."""
        self._receive(self.codec.read(frames), now_ns)

    def _receive(self, packets: Sequence[Packet], now_ns: int) -> None:
        if self._direct:
            self._catch_up(now_ns)
        self._run_to(now_ns)
        for packet in packets:
            self._inbox.read(packet, now_ns)
        if self._commander.wanted or self._commander.answers:
            self._answer(now_ns)
        self._inside_ns = self._next_inside_ns()
        self._update_due()

    def tick(self, now_ns: int) -> AgentOutgoing:
        """Everything to send now."""
        turn, sysid = self.turn(now_ns), self.config.sysid
        frames = [frame.data for frame in turn.frames]
        # Over UDP a packet a datagram, as autopilots send them.
        datagrams = [Datagram(sysid, data) for data in (frames if self._direct else packed(b"".join(frames)))]
        return AgentOutgoing(tuple(datagrams), turn.truth, turn.events)

    def turn(self, now_ns: int) -> AgentTurn:
        """The same as frames."""
        if self._direct:
            self._catch_up(now_ns)
        self._run_to(now_ns)
        self._report(self._schedule.pop_due(now_ns), now_ns)
        if self._inbox.listing is not None:
            self._list_parameters(self._inbox.listing)
        for event in self._inbox.due_events(now_ns):
            self.autopilot.report(event.severity, f"{event.text} (from {event.source})")
        if self.autopilot.notes:
            self._flush_notes()
        turn = AgentTurn(self._outbox, self._due_truth(now_ns), self._events)
        self._outbox, self._events = [], []
        self._update_due()
        return turn

    def _update_due(self) -> None:
        """After every input and turn: when the next is due if nothing arrives."""
        if self._outbox or self.autopilot.notes:
            self.due_ns = self._now_ns
            return
        due_ns = min(self._inside_ns, self._schedule.next_ns)
        if self._inbox.listing is not None:
            due_ns = min(due_ns, self._now_ns + RASTER_NS)
        self.due_ns = due_ns

    # Inside

    def _due_truth(self, _now_ns: int) -> Truth | None:
        """The true state, where it is known and due."""
        return None

    def _message(self, number: int, now_ns: int) -> LinkMessage | None:
        """The message of that number as it is now."""
        return BUILDERS[number](self._telemetry, now_ns)

    def _next_inside_ns(self) -> int:
        due_ns = self._monitor_ns
        if self.autopilot.piloted:
            if self._control_ns < self._now_ns:
                self._control_ns = self._now_ns + (self._t0_ns - self._now_ns) % CONTROL_NS
            due_ns = min(due_ns, self._control_ns)
        stream_ns = self._failsafes.stream_deadline_ns()
        return due_ns if stream_ns is None else min(due_ns, stream_ns)

    def _run_to(self, now_ns: int) -> None:
        """Let everything inside happen up to `now_ns`: each at its own time."""
        while (due_ns := self._inside_ns) <= now_ns:
            self._now_ns = max(due_ns, self._now_ns)
            self._vehicle.advance_to(due_ns)
            self._failsafes.check_stream(due_ns)
            if self.autopilot.piloted and due_ns >= self._control_ns:
                self.autopilot.control(due_ns)
                self._control_ns = due_ns + CONTROL_NS
            if due_ns >= self._monitor_ns:
                self._vehicle.drain(_MONITOR_PERIOD_S)
                self._failsafes.check(due_ns)
                self._monitor_ns = due_ns + _MONITOR_PERIOD_NS
            self._inside_ns = self._next_inside_ns()
        self._now_ns = max(now_ns, self._now_ns)

    def _catch_up(self, now_ns: int) -> None:
        """Say what was due before now, each at its own time.

        A real autopilot has a computer of its own. It goes on while the process that stands in for it has no turn, and
        what it sent meanwhile has arrived in a burst.
        """
        while (t_ns := max(self._schedule.next_ns, self._now_ns, now_ns - _BURST_NS)) < now_ns:
            self._run_to(t_ns)
            self._report(self._schedule.pop_due(t_ns), t_ns)

    def _use_pose(self, pose: ExternalPose, now_ns: int) -> None:
        if self.config.pose == "mocap":
            self._vehicle.advance_to(now_ns)
            self.autopilot.estimator.receive_pose(pose, now_ns, self.autopilot.fusion)

    def _report(self, numbers: Sequence[int], now_ns: int) -> None:
        if numbers:
            self._vehicle.advance_to(now_ns)
        for number in numbers:
            if (message := self._message(number, now_ns)) is not None:
                self._send(message)

    def _answer(self, now_ns: int) -> None:
        """Send what REQUEST_MESSAGE asked for, after its acknowledgement."""
        self._report(self._commander.wanted, now_ns)
        for answer in self._commander.answers:
            self._send(answer)
        self._commander.wanted.clear()
        self._commander.answers.clear()

    def _list_parameters(self, start: int) -> None:
        stop = min(start + 6, len(self.parameters))
        for index in range(start, stop):
            value = self.parameters.message(index)
            if value is not None:
                self._send(value)
        self._inbox.listing = stop if stop < len(self.parameters) else None

    def _flush_notes(self) -> None:
        for note in self.autopilot.notes:
            self._send(StatusText(note.severity, note.text))
            self._events.append(Event(note.severity, f"uav{self.config.sysid}", note.text))
        self.autopilot.notes.clear()

    def _send(self, message: LinkMessage) -> None:
        """Send a message; one that MAVLink cannot encode is left out, counted and reported, and the drone flies on."""
        try:
            self._outbox += self.codec.frames(message)
        except MavlinkError as error:
            self._inbox.rejections.note("own telemetry", str(error), self._now_ns)


class AgentCore(AutopilotCore):
    """One simulated drone."""

    config: SimulatedDroneConfig

    def __init__(self, config: SimulatedDroneConfig, t0_ns: int, physics: Physics = OWN) -> None:
        """physics: what integrates the vehicle."""
        own = config.pose == "own"
        estimator = Estimator(t0_ns, 2_000_000_000, "waiting for estimator to initialize") if own else Estimator(t0_ns)
        self.airframe = Airframe(
            config.true_vehicle(), config.disturbance, np.array(config.start_lab_m), config.start_yaw_rad, t0_ns,
            InertialSensor(config.inertial_error, config.sysid), estimator, physics, has_receiver=own,
        )  # fmt: skip
        """The simulated vehicle, which the autopilot knows as its `vehicle`: by sensors and orders."""
        self._truth_ns = t0_ns
        self._truth_period_ns = round(1e9 / config.truth_rate_hz) if config.truth_rate_hz > 0.0 else 0
        model = MODELS[config.autopilot]
        super().__init__(config, model, first_parameters(config, model.table), t0_ns, estimator, self.airframe)

    def truth(self, now_ns: int) -> Truth:
        """The true state at `now_ns`, exactly, wherever the physics' grid lies."""
        self._run_to(now_ns)
        self._update_due()
        state = self.airframe.state_at(now_ns)
        return Truth(
            t_ns=now_ns,
            sysid=self.config.sysid,
            pos_lab_m=state.pos_lab_m,
            vel_lab_m_s=state.vel_lab_m_s,
            q_lab_from_flu=state.q_lab_from_flu,
            rate_flu_rad_s=state.rate_flu_rad_s,
            dist_lab_m_s2=self.airframe.push_lab_m_s2,
            on_ground=on_ground(state),
            armed=self.airframe.armed,
        )

    def _update_due(self) -> None:
        super()._update_due()
        if self._truth_period_ns:
            self.due_ns = min(self.due_ns, self._truth_ns)

    def _due_truth(self, now_ns: int) -> Truth | None:
        if not self._truth_period_ns or now_ns < self._truth_ns:
            return None
        self._truth_ns = max(self._truth_ns + self._truth_period_ns, now_ns)
        return self.truth(now_ns)

    def _message(self, number: int, now_ns: int) -> LinkMessage | None:
        if number == MessageId.HIL_STATE_QUATERNION:  # the simulator's word, not the autopilot's
            return self._true_state(now_ns)
        return super()._message(number, now_ns)

    def _true_state(self, now_ns: int) -> SimTruth:
        state = self.airframe.state
        x, y, z = state.pos_lab_m.tolist()
        lat, lon, alt = to_globe(self.config.origin, (x, y, z))
        return SimTruth((now_ns - self._t0_ns) // 1000, state.q_lab_from_flu, state.vel_lab_m_s, lat, lon, alt)


def first_parameters(config: AutopilotConfig, table: AutopilotTable) -> Parameters:
    """This drone's first parameters: its own number, its kind's hover thrust, its pose, its own values."""
    hover = round(profile(config.profile, config.profiles).hover_thrust_norm, 3)
    values = {table.system_parameter: float(config.sysid), table.hover_parameter: hover}
    return Parameters(table, {**values, **(table.indoor if config.pose == "mocap" else {}), **config.parameters})
