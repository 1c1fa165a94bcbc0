"""Anything that a bus or a port can bring, to cores in flight, by the functions that their daemons call."""

from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import numpy as np

from drone_agent.crazyflie.core import CrazyflieConfig, CrazyflieCore
from drone_agent.guard.config import GuardConfig
from drone_agent.guard.core import GuardCore
from drone_agent.guarded import GuardedDrone
from formation import topics
from formation.config import LabConfig
from formation.messages import Datagram, Event, LabFrame, Phase, RawFrame, Severity, Tick
from gcs.alarms import EventMemory
from gcs.live import Live
from gcs.page.model import Model
from mocap.core import MocapCore
from mocap.pose_checks import RELEARN_FRAMES
from mocap.retiming import GOES_ON, LONGEST_GAP
from tests.drone_agent.agent_harness import Harness, hover_at
from tests.drone_agent.crazyflie_peer import Peer
from tests.gcs.fakes import FakeLab, triangle
from tools.fuzz.draw import LAB, RAW, REQUEST, TEXTS, Draw
from wire.ground_state import decode, encode
from wire.link_messages import DRONE_COMPONENT, GROUND, Address, CommandAck, CommandLong, Heartbeat, MavAutopilot
from wire.logs.mcap_write import LogWriter
from wire.mavlink.codec import Codec
from wire.mavlink.framing import FrameCutter
from wire.schema import SchemaError
from wire.text import parse_object
from wire.transport.frame_check import lab_fault

STEP_NS = 1_000_000
SYSID = 2
TARGET = Address(SYSID, DRONE_COMPONENT)
BEAT = Heartbeat(MavAutopilot.PX4, 2, 0, 0, 4)
ASK_VERSION = CommandLong(TARGET, 512, (148.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
STEP_EVERY, REFLY_EVERY = 10, 2000


class Frames:
    """Frames of cameras to the mocap process, frames of that to the bus, and states of the ground to it."""

    def __init__(self, draw: Draw, counts: Counter[str]) -> None:
        self._draw, self._counts, self._now_ns, self._number = draw, counts, 10**12, 0
        followers = [{"body": "left", "sysid": SYSID, "offset_m": (0.0, 1.0, 0.0)}]
        lab = LabConfig.model_validate({"leader": {"body": "lead"}, "followers": followers})
        self._bodies = tuple(v.body for v in lab.vehicles)
        self._mocap = MocapCore(lab)
        self._state = published(flying_lab())

    def feed(self) -> None:
        draw = self._draw
        self._now_ns += STEP_NS
        if draw.random() < 0.1:
            with suppress(ValueError):
                self._mocap.note_motors(decode(draw.state(self._state)).motors_on)
            return
        n = draw.choice((0, 1, 2, 2, 2, 3, 12))
        bodies = self._bodies if n == 2 and draw.random() < 0.7 else draw.choices(TEXTS, k=n)
        is_raw = draw.random() < 0.6
        frame = (draw.raw_frame if is_raw else draw.lab_frame)(bodies, self._now_ns)
        self._number += 1
        frame = replace(frame, seq=self._number) if draw.random() < 0.9 else frame
        data = draw.noise() if draw.random() < 0.1 else draw.spoiled((RAW if is_raw else LAB).encode(frame))
        self._counts["taken"] += self._read(data) is not None
        self._mocap.events(self._now_ns)
        self._mocap.reject_log.due(self._now_ns)

    def probe(self) -> str:
        """Empty where sound frames are taken as the GOES_ON-th of their count, and soon believed; motors are off.

        With its motors on, a body that has jumped in sight stays rejected: it lands.
        """
        self._mocap.note_motors(dict.fromkeys(self._bodies, False))
        self._now_ns += 25 * STEP_NS  # a stamp may be ahead by 20 ms: so long may it keep others out
        self._number += LONGEST_GAP
        for k in range(GOES_ON + RELEARN_FRAMES):
            self._now_ns, self._number = self._now_ns + STEP_NS, self._number + 1
            pos, q = np.full((2, 3), 1e-5 * (k % 7)), np.tile([1.0, 0.0, 0.0, 0.0], (2, 1))
            sound = RawFrame(self._number, self._now_ns, self._bodies, pos, q, np.ones(2, np.bool_))
            frame = self._read(RAW.encode(sound))
            if frame is None and k >= GOES_ON - 1:
                return "a sound frame was not taken"
            if frame is not None and frame.seen.all():
                return ""
        return "sound frames were not believed"

    def _read(self, data: bytes) -> LabFrame | None:
        """As the mocap process and the bus would: the frame that everyone gets, None for one that is rejected."""
        raw = decoded(RAW, data)
        frame = decoded(LAB, data) if raw is None else self._mocap.receive(raw, self._now_ns)
        if frame is None:
            return None
        fault = lab_fault(frame, self._now_ns)
        assert raw is None or fault is None, fault
        return frame if fault is None else None


class Ground:
    """Packets of drones, frames and requests to a ground whose formation flies."""

    def __init__(self, draw: Draw, counts: Counter[str]) -> None:
        self._draw, self._counts, self._lab = draw, counts, flying_lab()

    def feed(self) -> None:
        draw, lab = self._draw, self._lab
        self._counts["messages"] += 1
        kind = draw.random()
        if kind < 0.6:
            sysid = draw.choice((1, 2, 2, 3, 77))
            sender = Address(draw.choice((sysid, 2)), draw.choice((1, 1, 191)))
            lab.core.receive(Datagram(sysid, draw.datagram(Codec(sender), GROUND)), lab.now_ns)
        elif kind < 0.8:
            for frame in near(draw, lab.frame(), lab.now_ns):
                lab.core.receive(frame, lab.now_ns)
        elif (request := decoded(REQUEST, draw.request())) is not None:
            lab.core.receive(request, lab.now_ns)
        if self._counts["messages"] % STEP_EVERY == 0:
            lab.step()
            lab.core.state(lab.now_ns)
            del lab.ticks[:], lab.records[:], lab.replies[:]
            for drone in lab.drones.values():
                drone.heard.clear()
                drone.setpoints.clear()
        if self._counts["messages"] % REFLY_EVERY == 0 and lab.phase in (Phase.GROUND, Phase.STOPPED):
            self._lab = flying_lab()

    def probe(self) -> str:
        """Empty where a heartbeat of the drone is taken."""
        lab = self._lab
        lab.core.receive(Datagram(SYSID, Codec(TARGET).encode(BEAT)), lab.now_ns)
        (drone,) = (drone for drone in lab.core.state(lab.now_ns).drones if drone.sysid == SYSID)
        return "" if drone.heartbeat_age_s == 0.0 else "the ground does not hear the drone"


class Agent:
    """Packets of a ground, and frames, to a simulated drone in the air."""

    def __init__(self, draw: Draw, counts: Counter[str]) -> None:
        self._draw, self._counts, self._codec = draw, counts, Codec(GROUND)
        agent = self._agent = Harness(sysid=SYSID, pose="mocap", body="left")
        assert isinstance(agent.core, GuardedDrone)
        self._guarded = agent.core
        agent.run(3.0)
        agent.run(1.2, hover_at(0.5))
        agent.command(176, 1.0, 6.0)
        agent.command(400, 1.0)
        agent.run(3.0, hover_at(0.5))

    def feed(self) -> None:
        draw, agent = self._draw, self._agent
        if draw.random() < 0.1:
            truth = agent.truth
            both = np.array([np.zeros(3), truth.pos_lab_m]), np.array([[1.0, 0, 0, 0], truth.q_lab_from_flu])
            sound = LabFrame(1, agent.now_ns, ("stranger", "left"), *both, np.ones(2, bool), agent.now_ns)
            for frame in near(draw, sound, agent.now_ns):
                self._guarded.receive_frame(frame, agent.now_ns)
        else:
            agent.core.receive(Datagram(SYSID, draw.datagram(self._codec, TARGET)), agent.now_ns)
        agent.run_to(agent.now_ns + STEP_NS)
        self._counts["answers"] += len(agent.heard)
        del agent.heard[:], agent.events[:]

    def probe(self) -> str:
        """Empty where a command of the ground is answered."""
        self._agent.send(ASK_VERSION)
        answers = [m for _, m in self._agent.heard if isinstance(m, CommandAck) and m.command == ASK_VERSION.command]
        return "" if answers else "the drone does not hear the ground"


class Bridge:
    """Packets of ground and autopilot, and frames, to a bridge, whose autopilot is behind UDP or a serial line."""

    def __init__(self, draw: Draw, counts: Counter[str], *, serial: bool) -> None:
        self._draw, self._counts, self._now_ns = draw, counts, 10**12
        self._core = GuardCore(GuardConfig(sysid=SYSID, body="left"), self._now_ns)
        self._line = FrameCutter(stream=serial)
        self._tries = 24 if serial else 1  # a line may owe the end of a frame
        self._ground, self._drone = Codec(GROUND), Codec(TARGET)

    def feed(self) -> None:
        draw, core = self._draw, self._core
        self._now_ns += 1000
        kind = draw.random()
        if kind < 0.45:
            core.receive_ground(Datagram(SYSID, draw.datagram(self._ground, TARGET)), self._now_ns)
        elif kind < 0.9:
            core.receive_autopilot(self._line.cut(draw.datagram(self._drone, GROUND)), self._now_ns)
        else:
            q = np.tile([1.0, 0.0, 0.0, 0.0], (2, 1))
            sound = LabFrame(1, self._now_ns, ("lead", "left"), np.zeros((2, 3)), q, np.ones(2, bool), self._now_ns)
            for frame in near(draw, sound, self._now_ns):
                core.receive_frame(frame, self._now_ns)
        out = core.tick(self._now_ns)
        self._counts["passed"] += len(out.to_autopilot) + len(out.to_ground)

    def probe(self) -> str:
        """Empty where what is valid passes, both ways."""
        order, beat, passed = self._ground.encode(ASK_VERSION), self._drone.encode(BEAT), set[tuple[int, bytes]]()
        for _ in range(self._tries):
            self._core.receive_ground(Datagram(SYSID, order), self._now_ns)
            self._core.receive_autopilot(self._line.cut(beat), self._now_ns)
            out = self._core.tick(self._now_ns)
            passed |= contents(
                *(frame.data for frame in out.to_autopilot), *(datagram.data for datagram in out.to_ground)
            )
        return "" if contents(order, beat) <= passed else "the bridge does not pass what is valid"


class Crazyflie:
    """Packets like those of a Crazyflie, to its upper half."""

    def __init__(self, draw: Draw, counts: Counter[str]) -> None:
        self._draw, self._counts, self._now_ms = draw, counts, 0
        self._peer, self._core = Peer(), CrazyflieCore(CrazyflieConfig(bridge="udp://127.0.0.1:1"), 0)
        self._answers: list[bytes] = []
        self.probe()

    def feed(self) -> None:
        draw, vehicle = self._draw, self._core.crazyflie
        sound = draw.choice([*self._answers, *self._peer.logged(10 * self._now_ms), b"\x00text"])
        self._step([draw.noise() if draw.random() < 0.1 else draw.spoiled(sound, 0.9)])
        state = np.concatenate([vehicle.pos_lab_m, vehicle.vel_lab_m_s, vehicle.rate_flu_rad_s])
        assert np.isfinite(state).all(), state
        assert abs(np.linalg.norm(vehicle.q_lab_from_flu) - 1.0) < 1e-9, vehicle.q_lab_from_flu
        self._counts["no state"] = vehicle.lost

    def probe(self) -> str:
        """Empty where a sound vehicle is connected to, however long a spoiled answer said that its tables are."""
        for _ in range(3 * 2**16):
            self._step([*self._answers, *self._peer.logged(self._now_ms)])
            if self._core.crazyflie.connection is not None and self._core.crazyflie.info == self._peer.info:
                return ""
        return "the bridge does not hear the Crazyflie"

    def _step(self, packets: list[bytes]) -> None:
        self._now_ms += 1
        for packet in packets:
            self._core.receive_packet(packet, self._now_ms * STEP_NS)
        self._core.turn(self._now_ms * STEP_NS)
        self._answers = [reply for sent in self._core.pop_packets() for reply in self._peer.receive(sent)]


class Page:
    """States of ground and mocap to the operator's page."""

    def __init__(self, draw: Draw, counts: Counter[str]) -> None:
        self._draw, self._counts, self._lab = draw, counts, flying_lab()
        self._model, self._state = Model(self._lab.config), published(self._lab)

    def feed(self) -> None:
        text = self._draw.state(self._state)
        try:
            if self._draw.random() < 0.2:
                self._model.receive_mocap_state(parse_object(text), self._lab.now_ns)
            else:
                self._model.receive_state(text, self._lab.now_ns)
        except ValueError:  # what the page rejects, in words
            self._counts["rejected"] += 1
        self._model.show(self._lab.now_ns, 0.0)


class LiveLog:
    """Pieces of a log, as the ground shares it, to the live viewers' process."""

    def __init__(self, draw: Draw, counts: Counter[str]) -> None:
        self._draw, self._counts = draw, counts
        viewer: Any = SimpleNamespace(begin=ignore, show=ignore, close=ignore)
        self._live, self._pieces = Live(viewer, ignore), list[tuple[bytes, bytes]]()

        def share(head: bytes, chunk: bytes) -> None:
            self._pieces.append((head, chunk))

        with TemporaryDirectory() as folder, LogWriter(Path(folder) / "a.mcap", {}, threaded=False, share=share) as log:
            for k in range(500):
                log.write(topics.TICK, Tick(k), k)
                log.write(topics.EVENT, Event(Severity.INFO, "gcs", f"event {k}"), k)

    def feed(self) -> None:
        head, chunk = self._draw.choice(self._pieces[-8:])
        if self._draw.random() < 0.2:
            self._live.receive_head(self._draw.spoiled(head))
        else:
            self._live.receive_chunk(self._draw.spoiled(chunk))
        self._counts["pieces"] += 1


def ignore(*_: object) -> None:
    """What a viewer would show."""


def contents(*datagrams: bytes) -> set[tuple[int, bytes]]:
    """Ids and payloads of the frames in them."""
    return {(frame.number, frame.payload) for data in datagrams for frame in FrameCutter().cut(data)}


def flying_lab() -> FakeLab:
    """A ground in formation, its drones fake."""
    lab = FakeLab(triangle())
    lab.fly()
    return lab


def near(draw: Draw, sound: LabFrame, now_ns: int) -> Iterator[LabFrame]:
    """A frame like a sound one, where the bus hands it over."""
    frame = decoded(LAB, draw.spoiled(LAB.encode(draw.lab_frame(sound.bodies, now_ns, sound))))
    if frame is not None and lab_fault(frame, now_ns) is None:
        yield frame


def published(lab: FakeLab) -> str:
    """The state that the ground's process publishes."""
    events = EventMemory()
    for text in ("left: battery low", "over: left: battery low"):
        events.note(Event(Severity.WARNING, "safety", text), 1_000_000)
    state = lab.core.state(lab.now_ns)
    return encode(replace(state, events=events.newest, alarms=events.alarms.open))


def decoded(schema: Any, data: bytes) -> Any:
    """What the bus would hand over; None of what it rejects."""
    try:
        return schema.decode(data)
    except SchemaError:
        return None
