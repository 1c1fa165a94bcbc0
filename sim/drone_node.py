"""One drone in a lockstep flight: its agent, its bridge if it has one, and both directions of its link."""

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
from sim.faults.fault import Core, Family, Fault
from sim.monitors import Without
from sim.process_input import ProcessInput
from sim.scenario import LinkModel, Scenario
from wire.link_messages.address import BRIDGE_COMPONENT
from wire.mavlink.framing import FrameCutter
from wire.transport.memory_bus import NOTHING_DUE_NS, random_delay


class Sample(NamedTuple):
    """The true state of one drone at one instant; lab and flu.

    thrust_n: of all motors together. q_commanded, thrust_commanded: the setpoint of its attitude loop. motor_gain: each
    motor's share of its commanded thrust; lift_most: maximum thrust over weight. command_sent_ns: when a ground first
    sent the active command; None while the drone flies by itself, or does not fly.
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

    Behind a bridge the agent is the autopilot: only the bridge receives the data of the ground and the mocap. Faults of
    an agent are of its radio and its pose feed; the simulated vehicle and the autopilot's inner loops go on.
    """

    __slots__ = (
        "_bridge_input", "_bridge_received", "_config", "_ghost", "_input", "_without", "agent", "bridges", "down",
        "due_ns", "events", "faults", "followed_ns", "innovations", "sysid", "up",
    )  # fmt: skip

    def __init__(
        self, config: AgentConfig, scenario: Scenario, seed: int, now_ns: int, without: Without, physics: Physics
    ) -> None:
        """without: monitors that are switched off; physics: what integrates the vehicle."""
        self._config = config
        self._without = without.agent
        self.sysid = config.sysid
        # Truth is asked for at every exposure; nobody waits for it to be published.
        self.agent = AgentCore(config.model_copy(update={"truth_rate_hz": 0.0}), now_ns, without.agent, physics)
        bridged = scenario.true_vehicle(config.sysid).bridged
        self.bridges = [BridgeCore(config, now_ns, without=without.agent)] if bridged else []
        model = scenario.link
        self.down = _channel(model, model.down_s, [seed, 3, config.sysid])
        self.up = _channel(model, model.up_s, [seed, 4, config.sysid])
        self.due_ns = now_ns
        self.events: list[Event] = []
        self.innovations: list[Innovation] = []
        self.faults: list[PoseFault] = []
        self.followed_ns: int | None = None
        self._ghost: AgentCore | None = None
        self._input = ProcessInput[LabFrame | Sent]()
        self._bridge_input = ProcessInput[LabFrame | Sent | bytes]()
        self._bridge_received = (now_ns, now_ns)
        """When the bridges last received a ground's datagram, and when it was sent."""

    def update_due(self) -> None:
        """Update `due_ns`; call it after any change of the agent or its link."""
        self.due_ns = min(self._next_deadline_ns(), self.down.next_due_ns, self.up.next_due_ns)

    def receive_frame(self, frame: LabFrame, now_ns: int) -> None:
        """Receive a mocap frame."""
        if not self.bridges:
            self._receive(frame, now_ns)
        elif self._bridge_input.admits(frame):
            self._pass_to_bridges(frame, now_ns)

    def receive_datagram(self, sent: Sent, now_ns: int) -> list[Datagram]:
        """Receive a ground's datagram; returns the datagrams sent at once."""
        outgoing_datagrams: list[Datagram] = []
        if self._ghost is not None:
            self._ghost.receive(sent.datagram, now_ns)
        if not self.bridges:
            self._receive(sent, now_ns)
        elif self._bridge_input.admits(sent):
            self._pass_to_bridges(sent, now_ns)
            outgoing_datagrams = self.tick(now_ns)
        return outgoing_datagrams

    def tick(self, now_ns: int) -> list[Datagram]:
        """The datagrams for the ground; agent and bridge exchange theirs, without delay, until neither has more."""
        outgoing_datagrams: list[Datagram] = []
        while self._next_deadline_ns() <= now_ns:
            if self._ghost is not None and self._ghost.next_deadline_ns() <= now_ns:
                outgoing_datagrams += self._ghost.tick(now_ns).datagrams
            if self._input.runs and self.agent.next_deadline_ns() <= now_ns:
                outgoing_datagrams += self._tick_agent(now_ns)
            for bridge in self.bridges if self._bridge_input.runs else ():
                if bridge.next_deadline_ns() <= now_ns:
                    outgoing_datagrams += self._tick_bridge(bridge, now_ns)
        return outgoing_datagrams

    def sample(self) -> Sample:
        """The true state of the drone, at the last millisecond of its physics."""
        autopilot = self.agent.autopilot
        frame = autopilot.airframe
        state = frame.state
        led = autopilot.task is Task.EXTERNAL
        return Sample(
            self.sysid, state.pos_lab_m, state.vel_lab_m_s, state.q_lab_from_flu, frame.armed,
            sum(state.motor_thrust_n.tolist()), frame.setpoint.q_lab_from_flu, frame.setpoint.thrust_norm,
            frame.motor_gain, max(frame.motor_gain.tolist()) * frame.profile.thrust_max_n / frame.profile.weight_n,
            self.followed_ns if led else None,
        )  # fmt: skip

    def begin(self, fault: Fault, now_ns: int) -> None:
        """A fault of a core of this drone begins."""
        host: ProcessInput[LabFrame | Sent] | ProcessInput[LabFrame | Sent | bytes] = self._host(fault.core)
        match fault.family:
            case Family.KILL | Family.RESTART:
                host.kill()
            case Family.STALL:
                host.stall()
            case Family.TWIN if fault.core == "agent":
                self._ghost = AgentCore(self._config.model_copy(update={"truth_rate_hz": 0.0}), now_ns)
            case Family.TWIN if self.bridges:
                self.bridges.append(BridgeCore(self._config, now_ns, without=self._without))

    def end(self, fault: Fault, now_ns: int) -> None:
        """It is over: a stalled core takes in what has come meanwhile, a restarted one is new."""
        if fault.family is Family.TWIN:
            self._ghost = None if fault.core == "agent" else self._ghost
            del self.bridges[1 if fault.core == "bridge" else len(self.bridges) :]
        elif fault.core == "bridge":
            if fault.family is Family.RESTART and self.bridges:
                self.bridges[0] = BridgeCore(self._config, now_ns, without=self._without)
            for item in self._bridge_input.resume():
                self._pass_to_bridges(item, now_ns)
        else:
            for item in self._input.resume():
                self._pass_to_agent(item, now_ns)

    def _host(self, core: Core | None) -> "ProcessInput[LabFrame | Sent] | ProcessInput[LabFrame | Sent | bytes]":
        return self._bridge_input if core == "bridge" else self._input

    def _next_deadline_ns(self) -> int:
        """When agent or bridge has something to do of itself."""
        due_ns = self.agent.next_deadline_ns() if self._input.runs else NOTHING_DUE_NS
        if self.bridges and self._bridge_input.runs:
            due_ns = min(due_ns, *[bridge.next_deadline_ns() for bridge in self.bridges])
        return due_ns if self._ghost is None else min(due_ns, self._ghost.next_deadline_ns())

    def _receive(self, item: LabFrame | Sent, now_ns: int) -> None:
        if self._input.admits(item):
            self._pass_to_agent(item, now_ns)

    def _pass_to_agent(self, item: LabFrame | Sent, now_ns: int) -> None:
        if isinstance(item, Sent):
            self.agent.receive(item.datagram, now_ns)
            self._follow(item.t_ns, now_ns)
        else:
            self.agent.receive(item, now_ns)

    def _follow(self, sent_ns: int, now_ns: int) -> None:
        """Note when the followed setpoint was sent, if the agent has accepted one just now."""
        if self.agent.autopilot.stream.monitor.last_ns == now_ns:
            self.followed_ns = sent_ns

    def _pass_to_bridges(self, item: LabFrame | Sent | bytes, now_ns: int) -> None:
        for bridge in self.bridges:
            if isinstance(item, LabFrame):
                bridge.receive_frame(item, now_ns)
            elif isinstance(item, Sent):
                bridge.receive_ground(item.datagram, now_ns)
            else:
                bridge.receive_autopilot(item, now_ns)
        if isinstance(item, Sent):
            self._bridge_received = (now_ns, item.t_ns)

    def _tick_agent(self, now_ns: int) -> tuple[Datagram, ...]:
        outgoing = self.agent.tick(now_ns)
        self.events += outgoing.events
        if not self.bridges:
            return outgoing.datagrams
        for datagram in outgoing.datagrams:
            if self._bridge_input.admits(datagram.data):
                self._pass_to_bridges(datagram.data, now_ns)
        return ()

    def _tick_bridge(self, bridge: BridgeCore, now_ns: int) -> tuple[Datagram, ...]:
        outgoing = bridge.tick(now_ns)
        self.events += outgoing.events
        self.innovations += outgoing.innovations
        self.faults += outgoing.faults
        received_ns, sent_ns = self._bridge_received
        for datagram in outgoing.to_autopilot:
            passed = received_ns == now_ns and not _flown_by_bridge(datagram)
            self._receive(Sent(sent_ns if passed else now_ns, datagram), now_ns)
        return outgoing.to_ground


def _flown_by_bridge(datagram: Datagram) -> bool:
    """Whether the last setpoint among these packets is the bridge's own."""
    setpoints = [frame for frame in FrameCutter().cut(datagram.data) if frame.number in SETPOINTS]
    return bool(setpoints) and setpoints[-1].source.component == BRIDGE_COMPONENT


def _channel(model: LinkModel, delay_s: float, seed: list[int]) -> Channel:
    """One direction of one drone's link, with its own luck."""
    delay = random_delay(delay_s, model.jitter_s, model.lost_share, np.random.default_rng(seed))
    return Channel(delay, np.random.default_rng([*seed, 8]))
