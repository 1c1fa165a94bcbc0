"""What is fuzzed, in flight: each target takes one drawn message a call, by the functions that its daemon calls."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from drone_agent.guard.config import GuardConfig
from drone_agent.guard.core import GuardCore
from formation import topics
from formation.messages import Datagram, Event, LabFrame, Phase, Severity, Tick
from gcs.alarms import EventMemory
from gcs.live.daemon import Live
from gcs.page.model import Model
from mocap.core import MocapCore
from tests.drone_agent.agent_harness import Harness, hover_at
from tests.gcs.fakes import FakeLab, triangle
from tools.fuzz.messages import FRAME, RAW, REQUEST, SYSID, TARGET, Draws
from wire.ground_state import decode, encode
from wire.link_messages import GROUND, Address
from wire.logs.mcap_write import LogWriter
from wire.mavlink.codec import Codec
from wire.schema import SchemaError
from wire.text import parse_object
from wire.transport.frame_check import lab_fault

STEP_NS = 1_000_000
STEP_EVERY = 10  # messages for a step of the flight by 10 ms
REFLY_EVERY = 2_000


class Viewer:
    """Looks at nothing."""

    def begin(self, channels: object) -> None:
        """Channels are known."""

    def show(self, channel: int, unix_ns: int, data: bytes) -> None:
        """A message is."""

    def close(self) -> None:
        """The end."""


class Targets:
    """What is fuzzed, in flight."""

    def __init__(self, draws: Draws) -> None:
        self._draws = draws
        self.lab, self.agent = self._flying_lab(), self._flying_agent()
        self._to_ground, self._to_drone = Codec(TARGET), Codec(GROUND)
        self.mocap = MocapCore(self.lab.config)
        self.bridge = GuardCore(GuardConfig(sysid=SYSID, body="left"), self.agent.now_ns)
        self.page, self.state = Model(self.lab.config), published(self.lab)
        self.live, (self._head, self._chunks) = Live([Viewer()], lambda _text: None), log_pieces()
        self._count = 0
        self.by_name: dict[str, Callable[[], None]] = {
            "ground": self._ground, "mocap": self._mocap, "agent": self._agent, "bridge": self._bridge,
            "page": self._page, "live": self._live,
        }  # fmt: skip

    def _flying_lab(self) -> FakeLab:
        lab = FakeLab(triangle())
        lab.fly()
        return lab

    def _flying_agent(self) -> Harness:
        agent = Harness(sysid=SYSID, pose="mocap", body="left")
        agent.run(3.0)
        agent.run(1.2, hover_at(0.5))
        agent.command(176, 1.0, 6.0)
        agent.command(400, 1.0)
        agent.run(3.0, hover_at(0.5))
        return agent

    def _ground(self) -> None:
        draws, lab = self._draws, self.lab
        self._count += 1
        if self._count % REFLY_EVERY == 0 and lab.phase in (Phase.GROUND, Phase.STOPPED):
            lab = self.lab = self._flying_lab()
        kind = draws.rng.random()
        if kind < 0.6:
            sysid = draws.rng.choice((1, 2, 2, 3, 77))
            codec = Codec(Address(draws.rng.choice((sysid, 2)), draws.rng.choice((1, 1, 191))))
            lab.core.receive(Datagram(sysid, draws.packet(codec, draws.to_ground())), lab.now_ns)
        elif kind < 0.8:
            frame = decoded(FRAME, draws.lab_frame(lab.frame(), lab.now_ns))
            if frame is not None and lab_fault(frame, lab.now_ns) is None:
                lab.core.receive(frame, lab.now_ns)
        else:
            request = decoded(REQUEST, draws.request())
            if request is not None:
                lab.core.receive(request, lab.now_ns)
        if self._count % STEP_EVERY == 0:
            lab.step()
            lab.core.state(lab.now_ns)
            del lab.ticks[:], lab.records[:], lab.replies[:]
            for drone in lab.drones.values():
                drone.heard.clear()
                drone.setpoints.clear()

    def _mocap(self) -> None:
        draws = self._draws
        now_ns = self.lab.now_ns = self.lab.now_ns + 1000
        if draws.rng.random() < 0.3:
            with suppress(ValueError):
                self.mocap.note_motors(decode(draws.state(self.state)).motors_on)
            return
        bodies = [v.body for v in self.lab.config.vehicles]
        frame = decoded(RAW, draws.raw_frame(draws.rng.choice((bodies, bodies, [*bodies, "wand"])), now_ns))
        if frame is not None:
            self.mocap.receive(frame, now_ns)
        self.mocap.events(now_ns)
        self.mocap.reject_log.due(now_ns)

    def _agent(self) -> None:
        draws, agent = self._draws, self.agent
        if draws.rng.random() < 0.1:
            truth = agent.truth
            both = np.array([np.zeros(3), truth.pos_lab_m]), np.array([[1.0, 0, 0, 0], truth.q_lab_from_flu])
            sound = LabFrame(1, agent.now_ns, ("stranger", "left"), *both, np.ones(2, bool), agent.now_ns)
            frame = decoded(FRAME, draws.lab_frame(sound, agent.now_ns))
            if frame is not None and lab_fault(frame, agent.now_ns) is None:
                agent.core.receive(frame, agent.now_ns)
        else:
            agent.core.receive(Datagram(SYSID, draws.packet(self._to_drone, draws.to_drone())), agent.now_ns)
        agent.run_to(agent.now_ns + STEP_NS)
        del agent.heard[:], agent.events[:]

    def _bridge(self) -> None:
        draws, bridge = self._draws, self.bridge
        now_ns = self.agent.now_ns = self.agent.now_ns + 1000
        kind = draws.rng.random()
        if kind < 0.45:
            data = draws.packet(self._to_drone, draws.to_drone())
            bridge.receive_ground(Datagram(SYSID, data), now_ns)
        elif kind < 0.9:
            bridge.receive_autopilot(draws.packet(self._to_ground, draws.to_ground()), now_ns)
        else:
            frame = decoded(FRAME, draws.lab_frame(self.lab.frame(), now_ns))
            if frame is not None and lab_fault(frame, now_ns) is None:
                bridge.receive_frame(frame, now_ns)
        bridge.tick(now_ns)

    def _page(self) -> None:
        now_ns = self.lab.now_ns
        text = self._draws.state(self.state)
        try:
            if self._draws.rng.random() < 0.2:
                self.page.receive_mocap_state(parse_object(text), now_ns)
            else:
                self.page.receive_state(text, now_ns)
        except ValueError:  # what the page refuses, in words
            pass
        self.page.show(now_ns, 0.0)

    def _live(self) -> None:
        if self._draws.rng.random() < 0.2:
            self.live.receive_head(self._draws.mutated(self._head))
        else:
            self.live.receive_chunk(self._draws.mutated(self._draws.rng.choice(self._chunks)))


def published(lab: FakeLab) -> str:
    """The state that the ground's process publishes."""
    events = EventMemory()
    for text in ("left: battery under 20 %", "over: left: battery under 20 %"):
        events.note(Event(Severity.WARNING, "safety", text), 1_000_000)
    state = lab.core.state(lab.now_ns)
    return encode(replace(state, events=events.newest, alarms=events.alarms.open))


def decoded(schema: Any, data: bytes) -> Any:
    """What the bus would hand over; None of what it refuses."""
    try:
        return schema.decode(data)
    except SchemaError:
        return None


def log_pieces() -> tuple[bytes, list[bytes]]:
    """A log as it is shared: its head and some chunks."""
    heads: list[bytes] = []
    chunks: list[bytes] = []

    def share(head: bytes, chunk: bytes) -> None:
        heads.append(head)
        chunks.append(chunk)

    with TemporaryDirectory() as folder, LogWriter(Path(folder) / "a.mcap", {}, threaded=False, share=share) as log:
        for k in range(500):
            log.write(topics.TICK, Tick(k), k)
            log.write(topics.EVENT, Event(Severity.INFO, "gcs", f"event {k}"), k)
    return heads[-1], chunks[-8:]
