"""Draws what a bus or a port can bring: MAVLink messages, frames, requests and states with anything in them."""

import json
import random
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from formation.messages import LabFrame, OperatorRequest, RawFrame, Severity, Verb
from wire.link_messages import (
    DRONE_COMPONENT,
    GROUND,
    Address,
    AttitudeQuaternion,
    AttitudeSetpoint,
    Battery,
    CommandAck,
    CommandInt,
    CommandLong,
    ExtendedSysState,
    Heartbeat,
    Ignore,
    LandedState,
    LinkMessage,
    LocalFrame,
    LocalPosition,
    MavAutopilot,
    MavCommand,
    NamedValue,
    ParamRequestRead,
    ParamSet,
    ParamType,
    ParamValue,
    Ping,
    PositionIgnore,
    PositionSetpoint,
    Result,
    SetMode,
    SetOrigin,
    StatusText,
    SysStatus,
    TimeSync,
    VisionPose,
)
from wire.mavlink.codec import Codec
from wire.mavlink.framing import MavlinkError
from wire.schema import schema_of

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
    "ground_session",
    "pos_lab_m",
    "battery",
    "allowed",
    "shape",
    "trajectory_s",
    "rejected",
)
RAW, FRAME, REQUEST = schema_of(RawFrame), schema_of(LabFrame), schema_of(OperatorRequest)


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
        a, b, c, d, e, f, g = (self.number() if rng.random() < 0.5 else float(self.whole() % 600) for _ in range(7))
        kind, raw = rng.choice(list(ParamType)), rng.choice((rng.randbytes(4), np.float32(self.number()).tobytes()))
        match rng.randrange(11):
            case 0 | 1 | 2:
                return CommandLong(TARGET, int(rng.choice(COMMANDS)), (a, b, c, d, e, f, g))
            case 3:
                frame, place = rng.randrange(24), (self.whole() % 2**31, -(self.whole() % 2**31))
                return CommandInt(TARGET, frame, int(rng.choice(COMMANDS)), (a, b, c, d), *place, self.number())
            case 4:
                return ParamSet(TARGET, rng.choice(PARAMETERS), raw, kind)
            case 5:
                return SetMode(SYSID, self.whole() & 0xFF, self.whole() & 0xFFFFFFFF)
            case 6:
                return TimeSync(self.whole(), self.whole(), TARGET)
            case 7:
                pos, vel, acc = (self.vector() for _ in range(3))
                ignore, where = PositionIgnore(rng.choice((0, 7, 0x38))), rng.choice(list(LocalFrame))
                return PositionSetpoint(
                    TARGET, rng.randrange(2**32), where, ignore, pos, vel, acc, self.number(), self.number()
                )
            case 8:
                mask, stamp = rng.choice((Ignore.NONE, Ignore.BODY_RATES)), rng.randrange(2**32)
                return AttitudeSetpoint(TARGET, stamp, self.quaternion(), self.vector(), self.number(), mask)
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
        verbs = (
            Verb.HOLD,
            Verb.START,
            Verb.SHAPE,
            Verb.TRAJECTORY,
            Verb.STATUS,
            Verb.ARM,
            Verb.TAKEOFF,
            Verb.TAKE_CONTROL,
        )
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
