"""Two real cores joined by a function: GcsCore and GuardedDrone, no clock, no socket."""

import numpy as np

from drone_agent.config import AgentConfig
from drone_agent.guarded import GuardedDrone
from formation.config import LabConfig
from formation.messages import Datagram, LabFrame, OperatorRequest, Phase, Verb
from gcs.core import GcsCore

MS = 1_000_000
T0_NS = 1_000_000_000


class Lab:
    """One ground and its agents; frames at 100 Hz, links without delay."""

    def __init__(self, autopilots: dict[int, str]) -> None:
        followers = [{"body": f"f{s}", "sysid": s, "offset_m": (-0.4, 0.8 * (s - 2.5), 0.0)} for s in (2, 3)]
        config = LabConfig.model_validate({"leader": {"body": "f1", "sysid": 1}, "followers": followers})
        starts = {1: (0.0, 0.0, 0.0), 2: (-0.4, -0.4, 0.0), 3: (-0.4, 0.4, 0.0)}
        self.core = GcsCore(config, T0_NS)
        self.agents = {
            sysid: GuardedDrone(
                AgentConfig(
                    sysid=sysid, body=f"f{sysid}", pose="mocap", autopilot=autopilot, start_lab_m=starts[sysid],
                    parameters={"GUID_OPTIONS": 8, "GUID_TIMEOUT": 1.0} if autopilot == "ardupilot" else {},
                ),
                T0_NS,
            )
            for sysid, autopilot in autopilots.items()
        }  # fmt: skip
        self.now_ns, self.seq = T0_NS, 0
        self.events: list[str] = []
        self.ground_lives = True
        self.noise = np.random.default_rng(3)

    def pos(self, sysid: int):
        return self.agents[sysid].truth(self.now_ns).pos_lab_m

    def run_until(self, phase: Phase, longest_s: float = 40.0) -> None:
        for _ in range(round(longest_s * 100)):
            self.step()
            if self.core.phase is phase:
                return
        raise AssertionError(f"still {self.core.phase.name}: {self.events[-8:]}")

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            self.step()

    def ask(self, verb: Verb) -> None:
        self.core.receive(OperatorRequest(1, verb), self.now_ns)

    def step(self) -> None:
        self.now_ns += 10 * MS
        self.seq += 1
        truths = [agent.truth(self.now_ns) for agent in self.agents.values()]
        frame = LabFrame(
            self.seq,
            self.now_ns,
            tuple(f"f{truth.sysid}" for truth in truths),
            np.array([truth.pos_lab_m for truth in truths]) + self.noise.normal(0.0, 1e-4, (len(truths), 3)),
            np.array([truth.q_lab_from_flu for truth in truths]),
            np.ones(len(truths), bool),
        )
        for agent in self.agents.values():
            agent.receive(frame, self.now_ns)
            for datagram in agent.tick(self.now_ns).datagrams:
                self.core.receive(datagram, self.now_ns)
        if not self.ground_lives:
            return
        self.core.receive(frame, self.now_ns)
        while self.core.next_deadline_ns() <= self.now_ns:
            outgoing = self.core.tick(self.now_ns)
            self.events += [message.text for topic, message in outgoing.records if topic.name == "event"]
            for datagram in outgoing.datagrams:
                self.agents[datagram.sysid].receive(Datagram(datagram.sysid, datagram.data), self.now_ns)

    def take_off(self) -> None:
        self.run(8.0)
        self.ask(Verb.ARM)
        self.run_until(Phase.ARMED)
        self.run(4.0)
        self.ask(Verb.TAKEOFF)
        self.run_until(Phase.HOLD)


def test_a_mixed_fleet_takes_off_forms_and_lands():
    lab = Lab({1: "px4", 2: "ardupilot", 3: "px4"})
    lab.take_off()
    lab.ask(Verb.START)
    lab.run_until(Phase.FORMATION)
    lab.run(5.0)
    for sysid in (2, 3):
        assert np.allclose(lab.pos(sysid) - lab.pos(1), [-0.4, 0.8 * (sysid - 2.5), 0.0], atol=0.03)
    lab.ask(Verb.LAND)
    lab.run_until(Phase.GROUND)
    assert all(agent.truth(lab.now_ns).on_ground for agent in lab.agents.values())


def test_with_the_ground_gone_every_agent_comes_down_by_itself():
    lab = Lab({1: "px4", 2: "px4", 3: "px4"})
    lab.take_off()
    lab.ground_lives = False
    lab.run(12.0)
    assert all(agent.truth(lab.now_ns).on_ground for agent in lab.agents.values())
    assert np.allclose(lab.pos(2)[:2], [-0.4, -0.4], atol=0.3)
