"""Anything that a bus or a port can bring, to cores in flight: ground, mocap, agent, bridge, page and live viewer.

    PYTHONPATH=tests/gcs:tests/drone_agent python tests/fuzz/fuzz_flight.py --count 1000000

Each message goes to one target, by the functions that its daemon calls: MAVLink messages with every number extreme,
frames, requests, states and pieces of a log, some of them with bytes changed. Swarm and agent fly meanwhile. Whatever
is raised would have ended a process. Datagrams and frames of any bytes have fuzzers of their own beside this one.
"""

import json
import random
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from agent_harness import Harness, hover_at
from fuzz_command import main
from gcs_fakes import FakeLab, triangle

from drone_agent.bridge.core import BridgeCore
from drone_agent.config import AgentConfig
from formation import topics
from formation.messages import Datagram, Event, LabFrame, OperatorRequest, Phase, RawFrame, Severity, Tick, Verb
from gcs.live.daemon import Live
from gcs.mocap.core import MocapCore
from gcs.mocap.gate.armed import motors_on
from gcs.page.model import Model
from gcs.state.host import Disk, EventMemory, host_state
from wire.json_text import parse_object
from wire.link_messages.address import DRONE_COMPONENT, GROUND, Address
from wire.link_messages.clocks import Ping, TimeSync
from wire.link_messages.commands import CommandAck, CommandInt, CommandLong, MavCommand, Result, SetMode
from wire.link_messages.motion import AttitudeQuaternion, LocalPosition, SetOrigin, VisionPose
from wire.link_messages.packet import LinkMessage
from wire.link_messages.parameters import ParamRequestRead, ParamSet, ParamType, ParamValue
from wire.link_messages.setpoints import AttitudeSetpoint, Ignore, LocalFrame, PositionIgnore, PositionSetpoint
from wire.link_messages.status import (
    Battery,
    ExtendedSysState,
    Heartbeat,
    LandedState,
    MavAutopilot,
    NamedValue,
    StatusText,
    SysStatus,
)
from wire.logs.mcap_log import LogWriter
from wire.mavlink.codec import Codec, MavlinkError
from wire.schema import SchemaError, schema_of
from wire.transport.frame_check import lab_fault

SYSID = 2
TARGET = Address(SYSID, DRONE_COMPONENT)
FLOATS = (0.0, 1.0, -1.0, 0.3, 1e-45, 1e4, -1e10, 1e30, 3e38, -3e38, float("nan"), float("inf"), -float("inf"))
WHOLES = (0, 1, 2, -1, 4, 6, 255, 2**16 - 1, 2**31 - 1, -(2**31), 2**32 - 1, 2**62, -(2**62))
COMMANDS = (*MavCommand, 0, 16, 65535)
PARAMETERS = ("MPC_THR_HOVER", "COM_OF_LOSS_T", "MIS_TAKEOFF_ALT", "COM_DISARM_PRFLT", "MPC_XY_VEL_MAX", "NONE")
KEYS = (
    "phase",
    "drones",
    "events",
    "id",
    "epoch",
    "pos_lab_m",
    "battery",
    "allowed",
    "shape",
    "trajectory_s",
    "rejected",
)
STEP_NS = 1_000_000
STEP_EVERY = 10  # messages for a step of the flight by 10 ms
REFLY_EVERY = 2_000
RAW, FRAME, REQUEST = schema_of(RawFrame), schema_of(LabFrame), schema_of(OperatorRequest)


@dataclass(slots=True)
class Outcome:
    """How many messages each target was sent, and what was raised, in words."""

    sent: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)

    def text(self) -> str:
        """For people."""
        return ", ".join(f"{name} {count}" for name, count in self.sent.items()) + f": {len(self.faults)} exits"


class Draws:
    """Draws messages by a generator of its own."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)

    def number(self) -> float:
        return self.rng.choice(FLOATS) if self.rng.random() < 0.8 else self.rng.gauss(0.0, 1.0)

    def vector(self) -> np.ndarray:
        return np.array([self.number() for _ in range(3)])

    def whole(self) -> int:
        return self.rng.choice(WHOLES) if self.rng.random() < 0.7 else self.rng.randrange(256)

    def quaternion(self) -> np.ndarray:
        if self.rng.random() < 0.5:
            return np.array([1.0, 0.0, 0.0, 0.0])
        return np.array([self.number() for _ in range(4)])

    def to_drone(self) -> LinkMessage:
        """What a ground, or somebody in its name, may send."""
        rng = self.rng
        params = tuple(self.number() if rng.random() < 0.5 else float(self.whole() % 600) for _ in range(7))
        kind, raw = rng.choice(list(ParamType)), rng.choice((rng.randbytes(4), np.float32(self.number()).tobytes()))
        match rng.randrange(11):
            case 0 | 1 | 2:
                return CommandLong(TARGET, int(rng.choice(COMMANDS)), params)
            case 3:
                frame, place = rng.randrange(24), (self.whole() % 2**31, -(self.whole() % 2**31))
                return CommandInt(TARGET, frame, int(rng.choice(COMMANDS)), params[:4], *place, self.number())
            case 4:
                return ParamSet(TARGET, rng.choice(PARAMETERS), raw, kind)
            case 5:
                return SetMode(SYSID, self.whole() & 0xFF, self.whole() & 0xFFFFFFFF)
            case 6:
                return TimeSync(self.whole(), self.whole(), TARGET)
            case 7:
                vectors, ignore = [self.vector() for _ in range(3)], PositionIgnore(rng.choice((0, 7, 0x38)))
                where = rng.choice(list(LocalFrame))
                return PositionSetpoint(
                    TARGET, rng.randrange(2**32), where, ignore, *vectors, self.number(), self.number()
                )
            case 8:
                ignore, stamp = rng.choice((Ignore.NONE, Ignore.BODY_RATES)), rng.randrange(2**32)
                return AttitudeSetpoint(TARGET, stamp, self.quaternion(), self.vector(), self.number(), ignore)
            case 9:
                return rng.choice(
                    (SetOrigin(SYSID, *(self.number() for _ in range(3))), Ping(1, self.whole() & 0xFFFF, TARGET))
                )
            case _:
                return rng.choice((VisionPose(rng.randrange(2**40), self.vector(), self.quaternion()),
                                   ParamRequestRead(TARGET, rng.choice(PARAMETERS))))  # fmt: skip

    def to_ground(self) -> LinkMessage:
        """What a drone, or somebody in its name, may send."""
        rng = self.rng
        raw = np.float32(self.number()).tobytes()
        match rng.randrange(11):
            case 0:
                beat = rng.choice((0, 128, 209)), self.whole() & 0xFFFFFFFF, rng.randrange(9)
                return Heartbeat(rng.choice(list(MavAutopilot)), rng.randrange(30), *beat)
            case 1:
                return CommandAck(GROUND, int(rng.choice(COMMANDS)), rng.choice(list(Result)))
            case 2:
                return TimeSync(self.whole(), self.whole(), GROUND)
            case 3:
                return ParamValue(rng.choice(PARAMETERS), raw, rng.choice(list(ParamType)), 9, 0)
            case 4:
                return AttitudeQuaternion(rng.randrange(2**32), self.quaternion(), self.vector())
            case 5:
                return LocalPosition(rng.randrange(2**32), self.vector(), self.vector())
            case 6:
                return NamedValue(rng.randrange(2**32), rng.choice(("age_ms", "x")), self.number())
            case 7:
                return StatusText(rng.choice(list(Severity)), rng.choice(("\x1b[2J", "[/]", "x" * 200, "")))
            case 8:
                return ExtendedSysState(rng.choice(list(LandedState)))
            case 9:
                return SysStatus(0, 0, 0, 0.0, rng.random(), 1.0, rng.choice((-1.0, 0.0, 0.05, 0.5)))
            case _:
                return Battery((rng.random(),), 1.0, 1.0, rng.choice((-0.01, 0.01, 0.5)))

    def mutated(self, data: bytes) -> bytes:
        """The bytes, one time in three with some of them changed or cut."""
        if self.rng.random() < 0.67 or not data:
            return data
        changed = bytearray(data)
        for _ in range(self.rng.choice((1, 2, 8))):
            changed[self.rng.randrange(len(changed))] = self.rng.randrange(256)
        return bytes(changed[: self.rng.randrange(1, len(changed) + 1)] if self.rng.random() < 0.2 else changed)

    def packet(self, codec: Codec, message: LinkMessage) -> bytes:
        """On the wire; nothing where the codec itself refuses it."""
        try:
            return self.mutated(codec.encode(message))
        except MavlinkError:
            return b""

    def lab_frame(self, frame: LabFrame, now_ns: int) -> bytes:
        """A frame like the true one, with anything in it."""
        rng, n = self.rng, len(frame.bodies)
        changes: dict[str, Any] = {"seq": self.whole(), "t_receive_ns": now_ns}
        if rng.random() < 0.6:
            changes["t_capture_ns"] = now_ns - rng.choice((0, 1, 5, 900, 2000, -1, -3)) * 1_000_000
        if rng.random() < 0.5:
            changes["pos_lab_m"] = np.array([self.vector() for _ in range(n)])
        if rng.random() < 0.3:
            changes["q_lab_from_flu"] = np.array([self.quaternion() for _ in range(n)])
        changes["rejected"] = np.array([rng.choice((0, 0, 0, 5, 9, 10, 200)) for _ in range(n)], np.uint8)
        changes["seen"] = np.array([rng.random() < 0.7 for _ in range(n)])
        return self.mutated(FRAME.encode(replace(frame, **changes)))

    def raw_frame(self, bodies: Sequence[str], now_ns: int) -> bytes:
        """A camera system's."""
        n, stamp = len(bodies), self.rng.choice((0, now_ns, now_ns - 5_000_000, now_ns + 15_000_000, self.whole()))
        pos, q = np.array([self.vector() for _ in range(n)]), np.array([self.quaternion() for _ in range(n)])
        seen = np.array([self.rng.random() < 0.8 for _ in range(n)])
        return self.mutated(RAW.encode(RawFrame(self.whole(), stamp, tuple(bodies), pos, q, seen)))

    def request(self) -> bytes:
        """An operator's, seldom one that ends the flight."""
        verbs = (Verb.HOLD, Verb.START, Verb.SHAPE, Verb.TRAJECTORY, Verb.STATUS, Verb.ARM, Verb.TAKEOFF, Verb.ADOPT)
        verb = self.rng.choice((Verb.LAND, Verb.STOP)) if self.rng.random() < 0.001 else self.rng.choice(verbs)
        arguments = ("", "line", "circle:0.5", "grid:1e308", "line:nan", "x" * 900, "\x1b[2J", "configured")
        return self.mutated(REQUEST.encode(OperatorRequest(self.whole(), verb, self.rng.choice(arguments))))

    def state(self, text: str) -> str:
        """A ground's or a mocap's state, with anything in the place of some values."""
        rng = self.rng
        if rng.random() < 0.1:
            return rng.choice(
                ("[" * 5000, '{"a":' * 5000, "NaN", "", "{}", "[]", '{"drones": 1}', "9" * 5000, '"\\ud800"')
            )
        value = json.loads(text)
        for _ in range(rng.choice((1, 1, 3))):
            self._spoil(value)
        return self.mutated(json.dumps(value).encode()).decode(errors="replace")

    def _spoil(self, value: Any) -> None:
        """Put something else in one place of it."""
        while True:
            places = list(value) if isinstance(value, dict) else list(range(len(value)))
            if not places:
                return
            at = self.rng.choice(places)
            if isinstance(value[at], dict | list) and value[at] and self.rng.random() < 0.7:
                value = value[at]
                continue
            value[at] = self.rng.choice((None, [], {}, "", "x", -1, 2**62, 1e308, True, [None], {"a": 1}, "GROUND"))
            return


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
        self.bridge = BridgeCore(AgentConfig(sysid=SYSID, bridge="x", body="left"), self.agent.now_ns)
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
            lab.core.status(lab.now_ns)
            del lab.ticks[:], lab.records[:], lab.replies[:]
            for drone in lab.drones.values():
                drone.heard.clear()
                drone.setpoints.clear()

    def _mocap(self) -> None:
        draws = self._draws
        now_ns = self.lab.now_ns = self.lab.now_ns + 1000
        if draws.rng.random() < 0.3:
            self.mocap.note_motors(motors_on(draws.state(self.state)))
            return
        bodies = [v.body for v in self.lab.config.vehicles]
        frame = decoded(RAW, draws.raw_frame(draws.rng.choice((bodies, bodies, [*bodies, "wand"])), now_ns))
        if frame is not None:
            self.mocap.receive(frame, now_ns)
        self.mocap.events(now_ns)
        self.mocap.refusals.due(now_ns)

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
                self.page.hear_mocap(parse_object(text), now_ns)
            else:
                self.page.hear(text, now_ns)
        except ValueError:  # what the page refuses, in words
            pass
        self.page.show(now_ns, 0.0)

    def _live(self) -> None:
        if self._draws.rng.random() < 0.2:
            self.live.take_head(self._draws.mutated(self._head))
        else:
            self.live.take_chunk(self._draws.mutated(self._draws.rng.choice(self._chunks)))


def published(lab: FakeLab) -> str:
    """The state that the ground's process publishes."""
    events = EventMemory()
    for text in ("left: battery under 20 %", "over: left: battery under 20 %"):
        events.note(Event(Severity.WARNING, "safety", text), 1_000_000)
    host = host_state(100, 1, 0.001, Path("flight.mcap"), Disk(1, 2), events)
    return json.dumps(lab.core.state(lab.now_ns) | host)


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


def fuzz(count: int, seed: int, names: Sequence[str] = ()) -> Outcome:
    """That many messages to each target, or to those named; `faults` is empty where all was well."""
    outcome, draws = Outcome(), Draws(seed)
    for name in names or ("ground", "mocap", "agent", "bridge", "page", "live"):
        targets = Targets(draws)
        for k in range(count):
            outcome.sent[name] += 1
            try:
                targets.by_name[name]()
            except Exception as error:  # noqa: BLE001 - whatever it is, is what is looked for
                outcome.faults.append(f"{name}, message {k} of seed {seed}: {type(error).__name__}: {error}")
                targets = Targets(draws)
    return outcome


if __name__ == "__main__":
    main(fuzz, __doc__)
