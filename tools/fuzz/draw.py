"""Draws inputs by a seed: ordinary and extreme values, messages with any of them, and bytes that are broken."""

import json
import struct
from collections.abc import Sequence
from enum import Enum
from random import Random
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np

from formation.maths.arrays import Float
from formation.messages import LabFrame, OperatorRequest, RawFrame, Verb
from wire.link_messages import Address, LinkMessage, MavCommand
from wire.mavlink.codec import Codec
from wire.mavlink.framing import CRC_EXTRA, MavlinkError, sealed
from wire.schema import schema_of

NAN, INFINITE = float("nan"), float("inf")
FLOATS = (0.0, 1.0, -1.0, 0.3, 1e-45, 1e4, -1e10, 1e30, 3e38, -3e38, 1e300, NAN, INFINITE, -INFINITE)
WHOLES = (0, 1, 2, -1, 4, 6, 255, 2**16 - 1, 2**31 - 1, -(2**31), 2**32 - 1, 2**62, -(2**62), 2**63 - 1, -(2**63))
TEXTS = ("", "lead", "left", "wand", "x" * 70, "x" * 300, "\x1b[2J", "../../x", "[/]", "ü", "&amp;", "&#0;", "<a/>",
         "MPC_THR_HOVER", "COM_OF_LOSS_T", "MIS_TAKEOFF_ALT", "age_ms")  # fmt: skip
COMMANDS = (*MavCommand, 0, 16, 65535)
LATE_MS = (0, 1, 5, 8, 900, 2000, -1, -3, -15, -(10**9))
CALM = (
    Verb.HOLD, Verb.START, Verb.SHAPE, Verb.TRAJECTORY, Verb.STATUS, Verb.ARM, Verb.TAKEOFF, Verb.TAKE_CONTROL,
    Verb.HOME, Verb.RESUME, Verb.EXCLUDE, Verb.INCLUDE, Verb.REPLACE, Verb.MOVE,
)  # fmt: skip
REQUESTED = ("", "left", "line", "circle:0.5", "grid:1e308", "line:nan", "x" * 900, "\x1b[2J", "configured", "7 left",
             "lead 1e308 nan 0 0", "lead 0.3 0.2 0 1")  # fmt: skip
NO_STATES = ("[" * 5000, '{"a":' * 5000, "NaN", "", "{}", "[]", '{"drones": 1}', "9" * 5000, '"\\ud800"')
MTU = 1500
CRAFTED = (
    b"\xfe", b"\xfd", b"\xfe\xfd", b"\xfe\x00", b"\xfe\xff", b"\xfd\x00", b"\xfd\x00\x01", b"\xfd\xff\x02", b"\0",
    b"\xfd\x10\x00\xfe\x05\x00", b"\xfe\x00\x00\x03\x01\x00\xaa\xaa", b"\xfd\x01\x00\x00\x00\x03\x01\x00\x00\x00\x00",
    sealed(b"\xfe\x00\x00\x03\x01\x00", CRC_EXTRA[0]), sealed(b"\xfe\x02\x00\x03\x01\xfd\x04a", CRC_EXTRA[253]),
    b"\xfe\x00\x00\x07\x01\xf0\x00\x00",
)  # fmt: skip
"""What made parsers slow."""
READ = (0, 4, 11, 20, 21, 22, 23, 30, 31, 32, 33, 43, 51, 64, 65, 66, 75, 76, 77, 82, 84, 102, 108, 110, 111, 115, 117,
        120, 132, 138, 147, 193, 230, 241, 245, 251, 252, 253, 331)  # fmt: skip
RAW, LAB, REQUEST = schema_of(RawFrame), schema_of(LabFrame), schema_of(OperatorRequest)


def framed(number: int, payload: bytes, sender: Address, is_old: bool = False) -> bytes:
    """A packet of MAVLink 2, or of 1."""
    head = (0, sender.system, sender.component)
    if is_old and number < 256:
        body = struct.pack("<BBBBBB", 0xFE, len(payload), *head, number)
    else:
        body = struct.pack("<BBBBBBBHB", 0xFD, len(payload), 0, 0, *head, number & 0xFFFF, number >> 16)
    return sealed(body + payload, CRC_EXTRA[number])


def crafted() -> set[bytes]:
    """The full datagrams of each padding and of each message that is read, as many of it as fit."""
    payloads = (b"\0", b"\x01" * 40, struct.pack("<f", 1.0) * 63)
    frames = (framed(number, payload, Address(3, 1)) for number in READ for payload in payloads)
    return {(piece * MTU)[:MTU] for piece in CRAFTED} | {frame * (MTU // len(frame)) for frame in frames}


class Draw(Random):
    """A generator with a seed."""

    def number(self) -> float:
        return self.choice(FLOATS) if self.random() < 0.7 else self.gauss(0.0, 1.0)

    def whole(self) -> int:
        return self.choice(WHOLES) if self.random() < 0.5 else self.randrange(256)

    def rows(self, n: int, columns: int) -> Float:
        """(n, columns): about a metre each, or anything at all; now and then all alike."""
        is_near = self.random() < 0.6
        cells = [self.gauss(0.0, 1.0) if is_near else self.number() for _ in range(n * columns)]
        rows = np.array(cells, dtype=np.float64).reshape(n, columns)
        return rows if self.random() < 0.9 else np.repeat(rows[:1], n, axis=0)

    def quaternions(self, n: int) -> Float:
        return np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)) if self.random() < 0.6 else self.rows(n, 4)

    def spoiled(self, data: bytes, share: float = 0.3) -> bytes:
        """The bytes; that share of them with some changed, cut off, put in or put behind."""
        if self.random() >= share or not data:
            return data
        changed = bytearray(data)
        for _ in range(self.choice((1, 1, 2, 8))):
            at = self.randrange(len(changed))
            number = struct.pack(self.choice("<>") + "Q", self.choice(WHOLES) % 2**64)
            word = self.choice((number[:4], number[4:], number, struct.pack("<f", self.choice(FLOATS[:10]))))
            match self.randrange(6):
                case 0:
                    changed[at : at + len(word)] = word[: len(changed) - at]
                case 1:
                    changed[at:at] = word
                case _:
                    changed[at] = self.choice((0, 0xFD, 0xFE, 0xFF, self.randrange(256)))
        if self.random() < 0.15:
            del changed[self.randrange(len(changed) + 1) :]
        elif self.random() < 0.05:
            changed += self.randbytes(self.choice((1, 4, 100)))
        return bytes(changed)

    def noise(self) -> bytes:
        return self.randbytes(self.choice((0, 1, 8, 60, 300, 1500, 9000)))

    def packet(self, codec: Codec, target: Address) -> bytes:
        """A MAVLink message of any kind that can be sent, with anything in it, as it is or spoiled."""
        while True:
            kind = self.choice(get_args(LinkMessage))
            fields = {name: self._field(name, hint, target) for name, hint in get_type_hints(kind).items()}
            try:
                return self.spoiled(codec.encode(kind(**fields)))
            except MavlinkError:
                continue

    def _field(self, name: str, kind: Any, target: Address) -> Any:
        if kind is Address:
            return target
        if isinstance(kind, type) and issubclass(kind, Enum):
            return self.choice(list(kind))
        if kind is float:
            return self.number() if self.random() < 0.5 else float(self.randrange(600))
        if kind is int:
            known = {"command": self.choice(COMMANDS), "target_system": target.system}
            return known.get(name, self.whole())
        if kind is str:
            return self.choice(TEXTS)
        if kind is bytes:
            return self.choice((self.randbytes(4), struct.pack("<f", self.choice(FLOATS[:10]))))
        if get_origin(kind) is tuple:
            return tuple(self._field(name, float, target) for _ in get_args(kind))
        if kind is bool or type(None) in get_args(kind):
            return self.choice((True, False)) if kind is bool else self.number()
        return self.quaternions(1)[0] if name.startswith("q_") else self.rows(1, 3)[0]

    def datagram(self, codec: Codec, target: Address) -> bytes:
        """What may come at a port of that address: mostly messages, else frames with any payload, or any bytes."""
        if self.random() < 0.6:
            return self.packet(codec, target)
        frames = b"".join(self._frame(codec.own) for _ in range(self.choice((1, 1, 2, 12))))
        crafted = (self.choice(CRAFTED) * MTU)[: self.choice((3, 280, MTU))]
        return self.choice((frames, self.spoiled(frames, 1.0), frames + crafted, crafted + frames, self.noise()))

    def _frame(self, sender: Address) -> bytes:
        """A MAVLink packet with its checksum, of any id and payload."""
        number = self.choice(READ if self.random() < 0.8 else tuple(CRC_EXTRA))
        size = self.choice((0, 1, 4, 20, 40, 60, 120, 255))
        words = (struct.pack("<f", self.choice(FLOATS[:10])), struct.pack("<Q", self.choice(WHOLES) % 2**64)[:4])
        extreme = b"".join(self.choice(words) for _ in range(size // 4 + 1))[:size]
        return framed(number, self.choice((extreme, self.randbytes(size))), sender, self.random() < 0.3)

    def raw_frame(self, bodies: Sequence[str], now_ns: int) -> RawFrame:
        """A camera system's, of bodies that have any number of rows."""
        n = len(bodies) if self.random() < 0.95 else self.choice((0, 1, 2, 40))
        seen = np.array([self.random() < 0.9 for _ in range(n)], dtype=np.bool_)
        return RawFrame(
            self.whole(), self._stamp(now_ns), tuple(bodies), self.rows(n, 3), self.quaternions(n), seen
        )  # fmt: skip

    def lab_frame(self, bodies: Sequence[str], now_ns: int, sound: LabFrame | None = None) -> LabFrame:
        """The mocap process's, like a sound one in some of its fields."""
        raw = self.raw_frame(bodies, now_ns)
        rejected = np.array([self.choice((0, 0, 0, 5, 9, 10, 200)) for _ in raw.seen], np.uint8)
        pos, q, stamp_ns = raw.pos_mocap_m, raw.q_mocap_from_marker, raw.t_capture_ns
        if sound is not None:
            pos = self.choice((pos, sound.pos_lab_m))
            q = self.choice((q, sound.q_lab_from_flu))
            stamp_ns = self.choice((stamp_ns, sound.t_capture_ns))
        return LabFrame(raw.seq, stamp_ns, raw.bodies, pos, q, raw.seen, self.choice((now_ns, *WHOLES)), rejected)

    def _stamp(self, now_ns: int) -> int:
        return self.choice(WHOLES) if self.random() < 0.1 else now_ns - 1_000_000 * self.choice(LATE_MS)

    def request(self) -> bytes:
        """An operator's, seldom one that ends the flight."""
        verb = self.choice((Verb.LAND, Verb.STOP)) if self.random() < 0.001 else self.choice(CALM)
        names_nobody = verb in (Verb.ARM, Verb.LAND) and self.random() < 0.9
        argument = "" if names_nobody else self.choice(REQUESTED)
        return self.spoiled(REQUEST.encode(OperatorRequest(self.whole(), verb, argument)))

    def state(self, text: str) -> str:
        """A ground's or a mocap's state, with anything in the place of some values."""
        if self.random() < 0.1:
            return self.choice(NO_STATES)
        value = json.loads(text)
        for _ in range(self.choice((1, 1, 3))):
            self._replace(value)
        return self.spoiled(json.dumps(value).encode()).decode(errors="replace")

    def _replace(self, value: Any) -> None:
        """Put something else in one place of nested JSON."""
        while value:
            at = self.choice(list(value) if isinstance(value, dict) else list(range(len(value))))
            if isinstance(value[at], dict | list) and value[at] and self.random() < 0.7:
                value = value[at]
                continue
            value[at] = self.choice((None, [], {}, "", "x", -1, 2**62, 1e308, True, [None], {"a": 1}, "GROUND"))
            return
