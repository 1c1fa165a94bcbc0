"""One simulated flight: every core joined in memory, advanced from event to event. No clock, no process, no file.

It is the daemons' pump with simulated time: the same cores, the same bytes, the same records in the same order.
"""

import numpy as np

from drone_agent.config import AgentConfig
from drone_agent.core import AgentCore
from formation.messages import Datagram
from formation.topics import TRUTH
from gcs.core import GcsCore
from gcs.recording import Input, Record, record_input, record_tick
from sim.mocap import MocapEmulator
from sim.scenario import LinkModel, Scenario, agent_configs, leader_seconds, recorded_leader
from sim.script import Glance, Operator
from wire.memory_bus import MemoryLink, random_delay

T0_NS = 1_000_000_000
LOOK_NS = 100_000_000
"""How often the operator looks at the ground's state: as often as a daemon publishes it."""


class Seat:
    """One agent and both directions of its link; `due_ns` is when one of the three has something to do."""

    __slots__ = ("agent", "down", "due_ns", "sysid", "up")

    def __init__(self, config: AgentConfig, model: LinkModel, seed: int) -> None:
        self.sysid = config.sysid
        # Truth is asked for at every exposure; nobody waits for it to be published.
        self.agent = AgentCore(config.model_copy(update={"truth_rate_hz": 0.0}), T0_NS)
        self.down = _link(model, model.down_s, [seed, 3, config.sysid])
        self.up = _link(model, model.up_s, [seed, 4, config.sysid])
        self.due_ns = T0_NS

    def look_ahead(self) -> None:
        """Find `due_ns`; to be called when anything was done with the agent or its link."""
        self.due_ns = min(self.agent.next_deadline_ns(), self.down.next_due_ns, self.up.next_due_ns)


class World:
    """The cores, the links between them and the operator; `step` moves on to the next event."""

    def __init__(self, scenario: Scenario, seed: int, record: Record) -> None:
        leader = recorded_leader(scenario)
        self.now_ns = T0_NS
        self.operator = Operator(scenario.script, leader_seconds(scenario, leader))
        self._record = record
        self._emulator = MocapEmulator(scenario.mocap, scenario.lab, leader, seed, T0_NS)
        self._ground = GcsCore(scenario.lab, T0_NS)
        self._seats = {c.sysid: Seat(c, scenario.link, seed) for c in agent_configs(scenario, leader)}
        self._look_ns = T0_NS

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
        if self._ground.next_deadline_ns() <= now_ns:
            self._ground_ticks()

    def _next_event_ns(self) -> int:
        emulator = self._emulator
        due_ns = min(
            emulator.next_exposure_ns, emulator.next_frame_ns, self._look_ns, self._ground.next_deadline_ns(),
            *[seat.due_ns for seat in self._seats.values()],
        )  # fmt: skip
        return max(due_ns, self.now_ns)

    def _expose(self) -> None:
        truths = {sysid: seat.agent.truth(self.now_ns) for sysid, seat in self._seats.items()}
        for truth in truths.values():
            self._record(TRUTH, truth, self.now_ns)
        self._emulator.expose(truths)

    def _show_frames(self) -> None:
        """Frames arrive, at the ground and at every drone's own pose feed."""
        for frame in self._emulator.pop_due(self.now_ns):
            self._ground_receives(frame)
            for seat in self._seats.values():
                seat.agent.receive(frame, self.now_ns)
                seat.look_ahead()

    def _serve(self, seat: Seat) -> None:
        """What arrives at the drone, what it does of itself, what arrives from it."""
        now_ns = self.now_ns
        for _, datagram in seat.down.pop_due(now_ns):
            seat.agent.receive(datagram, now_ns)
        if seat.agent.next_deadline_ns() <= now_ns:
            outgoing = seat.agent.tick(now_ns)
            for datagram in outgoing.datagrams:
                seat.up.push(now_ns, datagram)
        for _, datagram in seat.up.pop_due(now_ns):
            self._ground_receives(datagram)
        seat.look_ahead()

    def _operator_looks(self) -> None:
        now_ns = self.now_ns
        self._look_ns = now_ns + LOOK_NS
        glance = Glance.at(self._ground.status(now_ns))
        if glance.formed:
            self._emulator.start(now_ns)
        self.operator.observe(glance, now_ns)
        request = self.operator.next_request(now_ns)
        if request is not None:
            self._ground_receives(request)

    def _ground_receives(self, message: Input) -> None:
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
