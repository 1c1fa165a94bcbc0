"""CRTP, the packets of a Crazyflie: bytes in, bytes out, and the dialogue that connects to one. No socket, no clock.

A packet is a header, port << 4 | 0xC | channel, and up to 30 bytes. From the firmware's sources (crtp_commander_rpyt.c,
crtp_commander_generic.c, crtp_localization_service.c, log.c, param_logic.c, supervisor.c, platformservice.c).
"""

import re
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from math import isfinite
from struct import Struct, pack
from typing import NamedTuple

from formation.maths.arrays import Quat, Vec3


class Port(IntEnum):
    """Of a packet."""

    CONSOLE = 0
    PARAM = 2
    COMMANDER = 3
    LOG = 5
    LOCALIZATION = 6
    GENERIC = 7
    SUPERVISOR = 9
    PLATFORM = 13


class Supervisor(IntFlag):
    """Bits of the log variable `supervisor.info`."""

    CAN_BE_ARMED = 1
    IS_ARMED = 2
    AUTO_ARMED = 4
    CAN_FLY = 8
    IS_FLYING = 16
    IS_TUMBLED = 32
    IS_LOCKED = 64
    IS_CRASHED = 128


THRUST_MOST = 60_000
"""Of a setpoint's 16 bits; the firmware takes no more."""
_SUPERVISOR_PORT_SINCE = 12
"""The protocol's version from which the supervisor has a port of its own."""


_ADDRESS = re.compile(r"radio://\w+/\d{1,3}/(250K|1M|2M)/[0-9A-Fa-f]{10}|udp://[\w.-]+:\d{1,5}")


def is_address(text: str) -> bool:
    """Whether cflib's radio or UDP driver can take it."""
    return _ADDRESS.fullmatch(text) is not None


def packet(port: Port, channel: int, payload: bytes = b"") -> bytes:
    """Header and payload."""
    return bytes((port << 4 | 0x0C | channel,)) + payload


def port_and_channel(data: bytes) -> tuple[int, int]:
    """Of a packet of at least one byte."""
    return data[0] >> 4, data[0] & 3


def encode_setpoint(roll_deg: float, pitch_deg: float, yaw: float, thrust: int) -> bytes:
    """Roll, pitch (nose down, as about `flu`'s y), yaw or its rate (deg or deg/s to the right), thrust 0..65535.

    The wire's pitch is nose up; its yaw is an angle (to the left) or a rate (to the right), by flightmode.stabModeYaw.
    """
    return packet(Port.COMMANDER, 0, pack("<fffH", roll_deg, -pitch_deg, yaw, thrust))


def encode_motors_off() -> bytes:
    """The setpoint that asks for nothing."""
    return packet(Port.GENERIC, 0, b"\x00")


def encode_pose(pos_lab_m: Vec3, q_lab_from_flu: Quat) -> bytes:
    """A pose from outside, for its estimator."""
    w, x, y, z = q_lab_from_flu.tolist()
    return packet(Port.LOCALIZATION, 1, pack("<B7f", 8, *pos_lab_m.tolist(), x, y, z, w))


def encode_emergency_stop(version: int) -> bytes:
    """Motors off until it is restarted; version: of the protocol."""
    if version < _SUPERVISOR_PORT_SINCE:
        return packet(Port.LOCALIZATION, 1, b"\x03")
    return packet(Port.SUPERVISOR, 1, b"\x03")


def encode_arming(version: int, armed: bool) -> bytes:
    """Ask its supervisor to arm, or to disarm."""
    port, channel = (Port.PLATFORM, 0) if version < _SUPERVISOR_PORT_SINCE else (Port.SUPERVISOR, 1)
    return packet(port, channel, bytes((1, armed)))


_UINT8, _UINT16, _INT8, _INT16, _FP16 = 1, 2, 4, 5, 8
_LOG_FORMATS = {_UINT8: "B", _UINT16: "H", _INT8: "b", _INT16: "h", _FP16: "e"}
BLOCKS: tuple[tuple[int, dict[str, int]], ...] = (
    (
        1,
        dict.fromkeys(
            (
                *(f"stateEstimateZ.{axis}" for axis in ("x", "y", "z", "vx", "vy", "vz")),
                *(f"stateEstimateZ.{rate}" for rate in ("rateRoll", "ratePitch", "rateYaw")),
            ),
            _INT16,
        ),
    ),
    (
        1,
        dict.fromkeys((*(f"stateEstimate.q{axis}" for axis in "wxyz"), *(f"acc.{axis}" for axis in "xyz")), _FP16)
        | {"supervisor.info": _UINT16, "pm.vbat": _FP16},
    ),
    (10, {"pm.state": _INT8, "radio.rssi": _UINT8}),
)
"""What is logged: every how many times 10 ms, names and types. Nine fit the packet that creates a block."""
_PARAM_FORMATS = {0x0: "b", 0x1: "h", 0x2: "i", 0x8: "B", 0x9: "H", 0xA: "I", 0x6: "f"}


class Item(NamedTuple):
    """A log variable or a parameter, as its table of contents has it."""

    number: int
    type: int


class Request(NamedTuple):
    """A packet that is answered, and how many bytes of its payload the answer begins with."""

    packet: bytes
    echoed: int

    def is_answered_by(self, data: bytes) -> bool:
        """Whether that packet is the answer."""
        end = 1 + self.echoed
        same = len(data) >= end and not (data[0] ^ self.packet[0]) & 0xF3
        return same and data[1:end] == self.packet[1:end]


@dataclass(frozen=True, slots=True)
class LogBlock:
    """How one block's packets are read."""

    names: tuple[str, ...]
    layout: Struct

    def read(self, data: bytes) -> tuple[int, dict[str, float]] | None:
        """The Crazyflie's time, ms of 24 bits, and each variable; None for what is no packet of the block."""
        if len(data) != 5 + self.layout.size:
            return None
        values = self.layout.unpack(data[5:])
        if not all(map(isfinite, values)):
            return None
        return int.from_bytes(data[2:5], "little"), dict(zip(self.names, values, strict=True))


@dataclass(frozen=True, slots=True)
class Connection:
    """What the dialogue found out: the protocol's version, blocks by number, parameters by name, what it has not."""

    version: int
    blocks: Mapping[int, LogBlock]
    parameters: Mapping[str, Item]
    missing: tuple[str, ...]


Dialogue = Generator[Request, bytes, Connection]


def connect() -> Dialogue:
    """Ask for version and tables of contents, then let it log; any bytes are a reply."""
    answer = yield Request(packet(Port.PLATFORM, 1, b"\x00"), 1)
    version = answer[2] if len(answer) > 2 else 0
    yield Request(packet(Port.LOG, 1, b"\x05"), 1)  # what another program had it log
    variables = yield from _contents(Port.LOG)
    parameters = yield from _contents(Port.PARAM)
    blocks: dict[int, LogBlock] = {}
    missing: list[str] = []
    for number, (period, wanted) in enumerate(BLOCKS):
        present = [(name, kind) for name, kind in wanted.items() if name in variables]
        missing += [name for name in wanted if name not in variables]
        if present:
            yield create_block(number, [(kind, variables[name].number) for name, kind in present])
            yield Request(packet(Port.LOG, 1, bytes((3, number, period))), 2)
            layout = Struct("<" + "".join(_LOG_FORMATS[kind] for _, kind in present))
            blocks[number] = LogBlock(tuple(name for name, _ in present), layout)
    return Connection(version, blocks, parameters, tuple(missing))


def create_block(number: int, variables: Sequence[tuple[int, int]]) -> Request:
    """A log block of variables, each a type and a number."""
    operations = b"".join(pack("<BH", kind << 4 | kind, variable) for kind, variable in variables)
    return Request(packet(Port.LOG, 1, bytes((6, number)) + operations), 2)


def _contents(port: Port) -> Generator[Request, bytes, dict[str, Item]]:
    answer = yield Request(packet(port, 0, b"\x03"), 1)
    found: dict[str, Item] = {}
    for number in range(int.from_bytes(answer[2:4], "little")):
        answer = yield Request(packet(port, 0, pack("<BH", 2, number)), 3)
        if len(answer) > 4:
            group, _, rest = answer[5:].partition(b"\x00")
            name = rest.partition(b"\x00")[0]
            found[f"{group.decode('latin-1')}.{name.decode('latin-1')}"] = Item(number, answer[4] & 0x0F)
    return found


def read_parameter(item: Item) -> Request:
    """Ask for a parameter's value."""
    return Request(packet(Port.PARAM, 1, pack("<H", item.number)), 2)


def write_parameter(item: Item, value: float) -> Request | None:
    """Set a parameter; None for a value that its type has not."""
    code = _PARAM_FORMATS.get(item.type, "")
    if not code or not isfinite(value):
        return None
    layout = Struct("<" + code)
    low, high = (0, 256**layout.size - 1) if code.isupper() else (-(256**layout.size) // 2, 256**layout.size // 2 - 1)
    if code != "f" and not low <= value <= high:
        return None
    written = layout.pack(value if code == "f" else round(value))
    return Request(packet(Port.PARAM, 2, pack("<H", item.number) + written), 2)


def parameter_value(item: Item, answer: bytes) -> float | None:
    """The value in the answer to `read_parameter`; None where there is none."""
    layout = Struct("<" + _PARAM_FORMATS.get(item.type, ""))
    if not layout.size or len(answer) != 4 + layout.size or answer[3]:
        return None
    (value,) = layout.unpack(answer[4:])
    return float(value) if isfinite(value) else None
