"""One simulated flight: every core joined in memory, advanced from event to event. No clock, no process, no file.

It is the daemons' pump with simulated time: the same cores, the same bytes, the same records in the same order.
"""

import numpy as np

from drone_agent.bridge.core import BridgeCore
from drone_agent.config import AgentConfig
from drone_agent.core import AgentCore
from formation.messages import Datagram, LabFrame, Truth
from formation.topics import MOCAP_EVENT, TRUTH
from gcs.core import GcsCore
from gcs.mocap.core import MocapCore
from gcs.mocap.gate.armed import armed_bodies
from gcs.recording import Input, Record, record_input, record_tick
from sim.cameras.emulator import MocapEmulator
from sim.scenario import LinkModel, Scenario, agent_configs, leader_seconds, recorded_leader
from sim.script import Glance, Operator
from wire.transport.memory_bus import NOTHING_DUE_NS, MemoryLink, random_delay

T0_NS = 1_000_000_000
LOOK_NS = 100_000_000
"""How often the operator looks at the ground's state: as often as a daemon publishes it."""


class Seat:
    """One agent, its bridge if it has one, and both directions of its link; `due_ns`: when one of them has work to do.

    Behind a bridge the agent is the autopilot: the bridge alone hears the ground and the mocap.
    """

    __slots__ = ("agent", "bridge", "down", "due_ns", "sysid", "up")

    def __init__(self, config: AgentConfig, bridged: bool, model: LinkModel, seed: int) -> None:
        self.sysid = config.sysid
        # Truth is asked for at every exposure; nobody waits for it to be published.
        self.agent = AgentCore(config.model_copy(update={"truth_rate_hz": 0.0}), T0_NS)
        self.bridge = BridgeCore(config, T0_NS) if bridged else None
        self.down = _link(model, model.down_s, [seed, 3, config.sysid])
        self.up = _link(model, model.up_s, [seed, 4, config.sysid])
        self.due_ns = T0_NS

    def look_ahead(self) -> None:
        """Find `due_ns`; to be called when anything was done with the agent or its link."""
        self.due_ns = min(self.next_deadline_ns(), self.down.next_due_ns, self.up.next_due_ns)

    def next_deadline_ns(self) -> int:
        """When agent or bridge has something to do of itself."""
        agent_ns = self.agent.next_deadline_ns()
        return agent_ns if self.bridge is None else min(agent_ns, self.bridge.next_deadline_ns())

    def see(self, frame: LabFrame, now_ns: int) -> None:
        """A mocap frame arrives."""
        if self.bridge is None:
            self.agent.receive(frame, now_ns)
        else:
            self.bridge.receive_frame(frame, now_ns)

    def hear(self, datagram: Datagram, now_ns: int) -> None:
        """A datagram of the ground's arrives."""
        if self.bridge is None:
            self.agent.receive(datagram, now_ns)
        else:
            self.bridge.receive_ground(datagram, now_ns)

    def say(self, now_ns: int) -> list[Datagram]:
        """What is to go to the ground; agent and bridge talk, without delay, until neither has anything to say."""
        said: list[Datagram] = []
        while self.next_deadline_ns() <= now_ns:
            if self.agent.next_deadline_ns() <= now_ns:
                datagrams = self.agent.tick(now_ns).datagrams
                if self.bridge is None:
                    return [*datagrams]
                for datagram in datagrams:
                    self.bridge.receive_autopilot(datagram.data, now_ns)
            if self.bridge is not None and self.bridge.next_deadline_ns() <= now_ns:
                outgoing = self.bridge.tick(now_ns)
                for datagram in outgoing.to_autopilot:
                    self.agent.receive(datagram, now_ns)
                said += outgoing.to_ground
        return said


class World:
    """The cores, the links between them and the operator; `step` moves on to the next event."""

    def __init__(self, scenario: Scenario, seed: int, record: Record) -> None:
        leader = recorded_leader(scenario)
        self.now_ns = T0_NS
        self.operator = Operator(scenario.script, leader_seconds(scenario, leader))
        self._record = record
        self._emulator = MocapEmulator(scenario.mocap, scenario.lab, leader, seed, T0_NS)
        self._mocap = MocapCore(scenario.lab)
        self._ground = GcsCore(scenario.lab, T0_NS)
        self._seats = {
            c.sysid: Seat(c, scenario.true_vehicle(c.sysid).bridged, scenario.link, seed)
            for c in agent_configs(scenario, leader)
        }
        self._look_ns = T0_NS
        self._ground_lives = True

    def kill_ground(self) -> None:
        """From now on the ground hears nothing and says nothing; mocap and agents go on."""
        self._ground_lives = False
        self._look_ns = NOTHING_DUE_NS

    def truths(self) -> dict[int, Truth]:
        """The true state of every drone now, by sysid."""
        return {sysid: seat.agent.truth(self.now_ns) for sysid, seat in self._seats.items()}

    def step(self) -> None:
        """Move on to the next event and do all that is due then, in a fixed order."""
        now_ns = self.now_ns = self._next_event_ns()
        emulator = self._emulator
        if emulator.next_exposure_ns <= now_ns:
            self._expose()
        if emulator.next_frame_ns <= now_ns:
            self._show_frames()
        for seat in self._seats.values():
            if seat.due_ns <= now_ns:
                self._serve(seat)
        if self._look_ns <= now_ns:
            self._operator_looks()
        if self._ground_lives and self._ground.next_deadline_ns() <= now_ns:
            self._ground_ticks()

    def _next_event_ns(self) -> int:
        emulator = self._emulator
        ground_ns = self._ground.next_deadline_ns() if self._ground_lives else NOTHING_DUE_NS
        due_ns = min(
            emulator.next_exposure_ns, emulator.next_frame_ns, self._look_ns, ground_ns,
            *[seat.due_ns for seat in self._seats.values()],
        )  # fmt: skip
        return max(due_ns, self.now_ns)

    def _expose(self) -> None:
        truths = self.truths()
        for truth in truths.values():
            self._record(TRUTH, truth, self.now_ns)
        self._emulator.expose(truths)

    def _show_frames(self) -> None:
        """Raw frames arrive at the mocap; its frames go to the ground and to every drone's own pose feed."""
        for raw in self._emulator.pop_due(self.now_ns):
            frame = self._mocap.receive(raw, self.now_ns)
            for event in self._mocap.events(self.now_ns):
                self._record(MOCAP_EVENT, event, self.now_ns)
            if frame is None:
                continue
            self._ground_receives(frame)
            for seat in self._seats.values():
                seat.see(frame, self.now_ns)
                seat.look_ahead()

    def _serve(self, seat: Seat) -> None:
        """What arrives at the drone, what it does of itself, what arrives from it."""
        now_ns = self.now_ns
        for _, datagram in seat.down.pop_due(now_ns):
            seat.hear(datagram, now_ns)
        for datagram in seat.say(now_ns):
            seat.up.push(now_ns, datagram)
        for _, datagram in seat.up.pop_due(now_ns):
            self._ground_receives(datagram)
        seat.look_ahead()

    def _operator_looks(self) -> None:
        now_ns = self.now_ns
        self._look_ns = now_ns + LOOK_NS
        state = self._ground.status(now_ns)
        self._mocap.note_armed(armed_bodies(state))
        glance = Glance.at(state)
        if glance.formed:
            self._emulator.start(now_ns)
        self.operator.observe(glance, now_ns)
        request = self.operator.next_request(now_ns)
        if request is not None:
            self._ground_receives(request)

    def _ground_receives(self, message: Input) -> None:
        if not self._ground_lives:
            return
        record_input(self._record, message, self.now_ns)
        self._ground.receive(message, self.now_ns)

    def _ground_ticks(self) -> None:
        now_ns = self.now_ns
        outgoing = self._ground.tick(now_ns)
        record_tick(self._record, outgoing, now_ns)
        for datagram in outgoing.datagrams:
            seat = self._seats[datagram.sysid]
            seat.down.push(now_ns, datagram)
            seat.due_ns = min(seat.due_ns, seat.down.next_due_ns)
        for reply in outgoing.replies:
            self.operator.receive(reply, now_ns)


def _link(model: LinkModel, delay_s: float, seed: list[int]) -> MemoryLink[Datagram]:
    """One direction of one drone's link, with its own luck."""
    return MemoryLink(random_delay(delay_s, model.jitter_s, model.lost_share, np.random.default_rng(seed)))
