"""One simulated flight: every core joined in memory, advanced from event to event. No clock, no process, no file.

It is the daemons' pump with simulated time: the same cores, the same bytes, the same records in the same order.
"""

from collections.abc import Iterable

import numpy as np

from drone_agent.core import AgentCore
from formation.messages import Datagram
from formation.topics import TRUTH
from gcs.core import GcsCore
from gcs.recording import Input, Record, record_input, record_tick
from sim.mocap import NEVER_NS, MocapEmulator
from sim.scenario import LinkModel, Scenario, agent_configs, leader_seconds, recorded_leader
from sim.script import Glance, Operator
from wire.memory_bus import MemoryLink, random_delay

T0_NS = 1_000_000_000
LOOK_NS = 100_000_000
"""How often the operator looks at the ground's state: as often as a daemon publishes it."""


class World:
    """The cores, the links between them and the operator; `step` moves on to the next event."""

    def __init__(self, scenario: Scenario, seed: int, record: Record) -> None:
        leader = recorded_leader(scenario)
        self.now_ns = T0_NS
        self.operator = Operator(scenario.script, leader_seconds(scenario, leader))
        self._record = record
        self._emulator = MocapEmulator(scenario.mocap, scenario.lab, leader, seed, T0_NS)
        self._ground = GcsCore(scenario.lab, T0_NS)
        self._agents = {config.sysid: AgentCore(config, T0_NS) for config in agent_configs(scenario, leader)}
        self._down = _links(scenario.link, scenario.link.down_s, self._agents, [seed, 3])
        self._up = _links(scenario.link, scenario.link.up_s, self._agents, [seed, 4])
        self._look_ns = T0_NS

    def step(self) -> None:
        """Move on to the next event and do all that is due then, in a fixed order."""
        now_ns = self.now_ns = self._next_event_ns()
        if self._emulator.next_exposure_ns <= now_ns:
            self._emulator.expose({sysid: agent.truth(now_ns) for sysid, agent in self._agents.items()})
        if self._emulator.next_frame_ns <= now_ns:
            for frame in self._emulator.pop_due(now_ns):
                self._ground_receives(frame)
                for agent in self._agents.values():
                    agent.receive(frame, now_ns)
        for sysid, agent in self._agents.items():
            for _, datagram in self._down[sysid].pop_due(now_ns):
                agent.receive(datagram, now_ns)
            if agent.next_deadline_ns() <= now_ns:
                self._agent_ticks(sysid, agent)
            for _, datagram in self._up[sysid].pop_due(now_ns):
                self._ground_receives(datagram)
        if self._look_ns <= now_ns:
            self._operator_looks()
        if self._ground.next_deadline_ns() <= now_ns:
            self._ground_ticks()

    def _next_event_ns(self) -> int:
        emulator = self._emulator
        due_ns = min(emulator.next_exposure_ns, emulator.next_frame_ns, self._look_ns, self._ground.next_deadline_ns())
        for sysid, agent in self._agents.items():
            due_ns = min(
                due_ns,
                agent.next_deadline_ns(),
                self._down[sysid].next_due_ns() or NEVER_NS,
                self._up[sysid].next_due_ns() or NEVER_NS,
            )
        return max(due_ns, self.now_ns)

    def _ground_receives(self, message: Input) -> None:
        record_input(self._record, message, self.now_ns)
        self._ground.receive(message, self.now_ns)

    def _agent_ticks(self, sysid: int, agent: AgentCore) -> None:
        outgoing = agent.tick(self.now_ns)
        for datagram in outgoing.datagrams:
            self._up[sysid].push(self.now_ns, datagram)
        if outgoing.truth is not None:
            self._record(TRUTH, outgoing.truth, self.now_ns)

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

    def _ground_ticks(self) -> None:
        now_ns = self.now_ns
        outgoing = self._ground.tick(now_ns)
        record_tick(self._record, outgoing, now_ns)
        for datagram in outgoing.datagrams:
            self._down[datagram.sysid].push(now_ns, datagram)
        for reply in outgoing.replies:
            self.operator.receive(reply, now_ns)


def _links(model: LinkModel, delay_s: float, sysids: Iterable[int], seed: list[int]) -> dict[int, MemoryLink[Datagram]]:
    """One one-way link a drone, each with its own luck."""
    return {
        sysid: MemoryLink(
            random_delay(delay_s, model.jitter_s, model.lost_share, np.random.default_rng([*seed, sysid]))
        )
        for sysid in sysids
    }
