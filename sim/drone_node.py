"""One drone in a lockstep flight: its guard, the simulated autopilot behind it, and both directions of its link."""

from typing import NamedTuple

import numpy as np

from drone_agent.autopilots.model import Task
from drone_agent.bridge.core import BridgeCore
from drone_agent.bridge.setpoints import SETPOINTS
from drone_agent.config import AgentConfig
from drone_agent.core import AgentCore
from drone_agent.guard.navigator import Fault as PoseFault
from drone_agent.simulation.physics import Physics
from formation.maths.arrays import Float, Quat, Vec3
from formation.messages import Datagram, Event, Innovation, LabFrame
from sim.faults.channel import Channel, Sent
from sim.faults.fault import Family, Fault
from sim.monitors import Without
from sim.process_input import ProcessInput
from sim.scenario import LinkModel, Scenario
from wire.link_messages.address import BRIDGE_COMPONENT
from wire.mavlink.framing import FrameCutter
from wire.transport.memory_bus import random_delay


class Sample(NamedTuple):
    """The true state of one drone at one instant; lab and flu.

    thrust_n: of all motors together. q_commanded, thrust_commanded: the setpoint of its attitude loop. motor_gain: each
    motor's share of its commanded thrust; lift_most: maximum thrust over weight that does not tilt it. command_sent_ns:
    when a ground first sent the active command; None while the drone flies by itself, or does not fly.
    """

    sysid: int
    pos_lab_m: Vec3
    vel_lab_m_s: Vec3
    q_lab_from_flu: Quat
    armed: bool
    thrust_n: float
    q_commanded: Quat
    thrust_commanded: float
    motor_gain: Float
    lift_most: float
    command_sent_ns: int | None


class DroneNode:
    """One drone; `due_ns`: when it has work to do.

    Only the guard receives the data of the ground and the mocap. Faults of the agent are of the guard's computer; the
    autopilot, which has its own, flies on.
    """

    __slots__ = (
        "_config", "_input", "_received", "_without", "autopilot", "down", "due_ns", "events", "faults", "followed_ns",
        "guards", "innovations", "own_due_ns", "row", "sysid", "up",
    )  # fmt: skip

    def __init__(
        self, config: AgentConfig, scenario: Scenario, seed: int, now_ns: int, without: Without, physics: Physics
    ) -> None:
        """without: monitors that are switched off; physics: what integrates the vehicle."""
        self._config = config
        self._without = without.agent
        self.sysid = config.sysid
        # Truth is asked for at every exposure; nobody waits for it to be published.
        self.autopilot = AgentCore(config.model_copy(update={"truth_rate_hz": 0.0}), now_ns, physics)
        self.guards = [BridgeCore(config, now_ns, without=without.agent)]
        model = scenario.link
        self.down = _channel(model, model.down_s, [seed, 3, config.sysid])
        self.up = _channel(model, model.up_s, [seed, 4, config.sysid])
        self.due_ns = self.own_due_ns = now_ns
        """own_due_ns: when guard or autopilot has something to do of itself, as the last tick left them."""
        self.row = 0
        """Among the flight's drones, in the order in which they are served."""
        self.events: list[Event] = []
        self.innovations: list[Innovation] = []
        self.faults: list[PoseFault] = []
        self.followed_ns: int | None = None
        self._input = ProcessInput[LabFrame | Sent | bytes]()
        self._received = (now_ns, now_ns)
        """When the guards last received a ground's datagram, and when it was sent."""

    def update_due(self) -> None:
        """Update `due_ns`; call it after any change of the drone or its link."""
        self.own_due_ns = self._next_deadline_ns()
        self.update_due_after_tick()

    def update_due_after_tick(self) -> None:
        """The same, where nothing but its link has changed since `tick`."""
        self.due_ns = min(self.own_due_ns, self.down.next_due_ns, self.up.next_due_ns)

    def receive_frame(self, frame: LabFrame, now_ns: int) -> None:
        """Receive a mocap frame."""
        if self._input.admits(frame):
            self._pass_to_guards(frame, now_ns)

    def receive_datagram(self, sent: Sent, now_ns: int) -> list[Datagram]:
        """Receive a ground's datagram; returns the datagrams sent at once."""
        if not self._input.admits(sent):
            return []
        self._pass_to_guards(sent, now_ns)
        return self.tick(now_ns)

    def tick(self, now_ns: int) -> list[Datagram]:
        """The datagrams for the ground; guard and autopilot exchange theirs, without delay, until neither has more."""
        to_ground: list[Datagram] = []
        guards, busy = self.guards if self._input.runs else [], True
        while busy:
            due_ns = self.autopilot.next_deadline_ns()
            busy = due_ns <= now_ns
            if busy:
                self._tick_autopilot(now_ns)
            for guard in guards:
                guard_due_ns = guard.next_deadline_ns()
                due_ns = min(due_ns, guard_due_ns)
                if guard_due_ns <= now_ns:
                    to_ground += self._tick_guard(guard, now_ns)
                    busy = True
        self.own_due_ns = due_ns
        return to_ground

    def sample(self) -> Sample:
        """The true state of the drone, at the last millisecond of its physics."""
        autopilot = self.autopilot.autopilot
        frame = self.autopilot.airframe
        state = frame.state
        led = autopilot.task is Task.EXTERNAL
        return Sample(
            self.sysid, state.pos_lab_m, state.vel_lab_m_s, state.q_lab_from_flu, frame.armed,
            sum(state.motor_thrust_n.tolist()), frame.setpoint.q_lab_from_flu, frame.setpoint.thrust_norm,
            frame.motor_gain, level_share(frame.motor_gain) * frame.profile.thrust_max_n / frame.profile.weight_n,
            self.followed_ns if led else None,
        )  # fmt: skip

    def begin(self, fault: Fault, now_ns: int) -> None:
        """A fault of the guard begins."""
        match fault.family:
            case Family.KILL | Family.RESTART:
                self._input.kill()
            case Family.STALL:
                self._input.stall()
            case Family.TWIN:
                self.guards.append(BridgeCore(self._config, now_ns, without=self._without))

    def end(self, fault: Fault, now_ns: int) -> None:
        """It is over: a stalled guard takes in what has come meanwhile, a restarted one is new."""
        if fault.family is Family.TWIN:
            del self.guards[1:]
            return
        if fault.family is Family.RESTART:
            self.guards[0] = BridgeCore(self._config, now_ns, without=self._without)
        for item in self._input.resume():
            self._pass_to_guards(item, now_ns)

    def _next_deadline_ns(self) -> int:
        """When guard or autopilot has something to do of itself."""
        due_ns = self.autopilot.next_deadline_ns()
        if self._input.runs:
            for guard in self.guards:
                due_ns = min(due_ns, guard.next_deadline_ns())
        return due_ns

    def _pass_to_guards(self, item: LabFrame | Sent | bytes, now_ns: int) -> None:
        for guard in self.guards:
            if isinstance(item, LabFrame):
                guard.receive_frame(item, now_ns)
            elif isinstance(item, Sent):
                guard.receive_ground(item.datagram, now_ns)
            else:
                guard.receive_autopilot(item, now_ns)
        if isinstance(item, Sent):
            self._received = (now_ns, item.t_ns)

    def _tick_autopilot(self, now_ns: int) -> None:
        outgoing = self.autopilot.tick(now_ns)
        self.events += outgoing.events
        for datagram in outgoing.datagrams:
            if self._input.admits(datagram.data):
                self._pass_to_guards(datagram.data, now_ns)

    def _tick_guard(self, guard: BridgeCore, now_ns: int) -> tuple[Datagram, ...]:
        outgoing = guard.tick(now_ns)
        self.events += outgoing.events
        self.innovations += outgoing.innovations
        self.faults += outgoing.faults
        received_ns, sent_ns = self._received
        for datagram in outgoing.to_autopilot:
            passed = received_ns == now_ns and not _flown_by_guard(datagram)
            self._pass_to_autopilot(datagram, sent_ns if passed else now_ns, now_ns)
        return outgoing.to_ground

    def _pass_to_autopilot(self, datagram: Datagram, sent_ns: int, now_ns: int) -> None:
        """Hand it over; note when the followed setpoint was sent, if it has accepted one just now."""
        self.autopilot.receive(datagram, now_ns)
        if self.autopilot.autopilot.stream.last_ns == now_ns:
            self.followed_ns = sent_ns


def level_share(motor_gain: Float) -> float:
    """Of the full thrust, what motors of these gains (4) give without tilting it: as much as the opposite one."""
    front_right, rear_left, front_left, rear_right = motor_gain.tolist()
    return float(0.5 * (min(front_right, rear_left) + min(front_left, rear_right)))


def _flown_by_guard(datagram: Datagram) -> bool:
    """Whether the last setpoint among these packets is the guard's own."""
    if BRIDGE_COMPONENT not in datagram.data:
        return False
    setpoints = [frame for frame in FrameCutter().cut(datagram.data) if frame.number in SETPOINTS]
    return bool(setpoints) and setpoints[-1].source.component == BRIDGE_COMPONENT


def _channel(model: LinkModel, delay_s: float, seed: list[int]) -> Channel:
    """One direction of one drone's link, with its own luck."""
    delay = random_delay(delay_s, model.jitter_s, model.lost_share, np.random.default_rng(seed))
    return Channel(delay, np.random.default_rng([*seed, 8]))
