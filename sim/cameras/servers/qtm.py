"""Qualisys Track Manager in a box: its real-time protocol over TCP and UDP."""

import asyncio
import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from formation.exposure import is_loopback
from formation.maths.arrays import Float
from formation.messages import RawFrame
from formation.mocap_config import MocapConfig, QualisysConfig
from sim.cameras.servers.server import Server, ServerClock, TcpPort, matrices
from wire.clock import Clock

ERROR, COMMAND, XML, DATA, NO_MORE_DATA, EVENT, DISCOVER = 0, 1, 2, 3, 4, 6, 7
CONNECTED, SETTINGS_CHANGED, SHUTTING_DOWN = 1, 11, 12
COMPONENTS = {"6d": 5, "6deuler": 6, "6dres": 11, "6deulerres": 12}
"""The component's type by what StreamFrames calls it, in small letters."""
RESIDUAL_MM = 0.4
EULER_FROM, ATTRIBUTES_FROM = 16, 21
"""Minor versions from which on the 6D parameters name the angles, and from which on most of them are attributes."""


def packet(order: str, kind: int, data: bytes = b"") -> bytes:
    """Header and data; order: "<" or ">"."""
    return struct.pack(order + "II", 8 + len(data), kind) + data


def text(order: str, kind: int, words: str) -> bytes:
    """A command's answer, an error or XML."""
    return packet(order, kind, words.encode() + b"\0")


def data_packet(order: str, stamp_us: int, number: int, components: Sequence[bytes]) -> bytes:
    """One exposure."""
    head = struct.pack(order + "qII", stamp_us, number & 0xFFFFFFFF, len(components))
    return packet(order, DATA, head + b"".join(components))


def six_d(order: str, kind: int, frame: RawFrame) -> bytes:
    """A 6DOF component of `kind`: millimetres, matrices column by column or Euler angles; NaN for a lost body."""
    matrix = matrices(frame.q_mocap_from_marker)
    turn = euler_deg(matrix) if kind in (6, 12) else np.swapaxes(matrix, 1, 2).reshape(-1, 9)
    columns = [1000.0 * frame.pos_mocap_m, turn]
    if kind in (11, 12):
        columns.append(np.full((len(frame.bodies), 1), RESIDUAL_MM))
    rows: NDArray[np.float64] = np.concatenate(columns, axis=1)
    rows[~frame.seen] = np.nan
    body = rows.astype(order + "f4").tobytes()
    return struct.pack(order + "IIihh", 16 + len(body), kind, len(frame.bodies), 0, 0) + body


def euler_deg(matrix: Float) -> Float:
    """Roll, pitch and yaw of Rx Ry Rz, QTM's standard, degrees; (n, 3, 3) to (n, 3)."""
    pitch = np.arcsin(np.clip(matrix[:, 0, 2], -1.0, 1.0))
    roll = np.arctan2(-matrix[:, 1, 2], matrix[:, 2, 2])
    yaw = np.arctan2(-matrix[:, 0, 1], matrix[:, 0, 0])
    angles: Float = np.degrees(np.stack([roll, pitch, yaw], axis=1))
    return angles


def parameters_6d(minor: int, bodies: Sequence[str]) -> str:
    """The 6D parameters as the protocol's version 1.`minor` writes them."""
    body = _body_of_attributes if minor >= ATTRIBUTES_FROM else _body_of_elements
    head = "" if minor >= ATTRIBUTES_FROM else f"<Bodies>{len(bodies)}</Bodies>"
    euler = "<Euler><First>Roll</First><Second>Pitch</Second><Third>Yaw</Third></Euler>"
    inside = head + "".join(body(name) for name in bodies) + (euler if EULER_FROM <= minor < ATTRIBUTES_FROM else "")
    name = f"QTM_Parameters_Ver_1.{minor}"
    return f"<{name}><The_6D>{inside}</The_6D></{name}>"


def parameters_general(minor: int, rate_hz: float) -> str:
    """The general parameters, as far as clients of bodies look at them."""
    name = f"QTM_Parameters_Ver_1.{minor}"
    return f"<{name}><General><Frequency>{rate_hz:g}</Frequency></General></{name}>"


def _body_of_elements(name: str) -> str:
    points = "".join(f"<Point><X>{x}</X><Y>{y}</Y><Z>0</Z></Point>" for x, y in ((0, 0), (60, 0), (0, 90)))
    return f"<Body><Name>{escape(name)}</Name><RGBColor>16711680</RGBColor>{points}</Body>"


def _body_of_attributes(name: str) -> str:
    points = "".join(
        f'<Point X="{x}" Y="{y}" Z="0" Virtual="0" PhysicalId="0" Name={quoteattr(f"{name} - {k}")}/>'
        for k, (x, y) in enumerate(((0, 0), (60, 0), (0, 90)), 1)
    )
    cells = " ".join(f'R{i}{j}="{int(i == j)}"' for i in (1, 2, 3) for j in (1, 2, 3))
    return (
        f'<Body><Name>{escape(name)}</Name><Enabled>true</Enabled><Color R="0" G="0" B="255"/>'
        "<MaximumResidual>10</MaximumResidual><MinimumMarkersInBody>3</MinimumMarkersInBody>"
        '<BoneLengthTolerance>5</BoneLengthTolerance><Filter Preset="No filter"/>'
        f"<Points>{points}</Points>"
        '<Data_origin X="0" Y="0" Z="0" Relative_body="1">0</Data_origin>'
        f'<Data_orientation {cells} Relative_body="1">0</Data_orientation></Body>'
    )


LARGEST_COMMAND = 65_536
OLDEST, NEWEST = 1, 25
"""Minor versions of the protocol, on ports that fix the byte order."""
QTM_VERSION = "QTM Version is 2024.3 (build 20041)"
_VERSION = re.compile(r"1\.(\d{1,2})")
_UDP = re.compile(r"udp(?::([^:]+))?:(\d{1,5})")


class ServerState(Protocol):
    """The server's state that every conversation reads."""

    rate_hz: float

    @property
    def bodies(self) -> tuple[str, ...]:
        """Their names, in the order of the frames."""


@dataclass(frozen=True, slots=True)
class Subscription:
    """The stream that a client has asked for: components, every how manieth frame, over UDP to where."""

    components: tuple[int, ...]
    divisor: int = 1
    udp: tuple[str, int] | None = None


class QtmConversation:
    """One client's. order: of the bytes, as its port says; host: where it is."""

    def __init__(self, order: str, host: str, server: ServerState) -> None:
        self.order = order
        self.wanted: Subscription | None = None
        self.once: tuple[int, ...] = ()
        """Components of GetCurrentFrame, for the next frame."""
        self.minor = OLDEST
        self._host = host
        self._server = server
        self._data = bytearray()

    def received(self, data: bytes) -> bytes:
        """Take the next bytes; what to answer. ValueError for what is no packet."""
        self._data += data
        answers = []
        while len(self._data) >= 8:
            size, kind = struct.unpack_from(self.order + "II", self._data)
            if not 8 <= size <= LARGEST_COMMAND:
                raise ValueError("no packet has this size")
            if len(self._data) < size:
                break
            words = bytes(self._data[8:size]).rstrip(b"\0").decode("utf-8", "replace")
            del self._data[:size]
            known = kind == COMMAND
            answers.append(self._answer(words) if known else self._text_packet(ERROR, "Command not supported."))
        return b"".join(answers)

    def _answer(self, words: str) -> bytes:
        name, *arguments = words.lower().split() or [""]
        match name:
            case "version":
                return self._version(arguments)
            case "qtmversion":
                return self._text_packet(COMMAND, QTM_VERSION)
            case "byteorder":
                big = self.order == ">"
                return self._text_packet(COMMAND, f"Byte order is {'big' if big else 'little'} endian")
            case "getstate" | "getlastevent":
                return packet(self.order, EVENT, bytes([CONNECTED]))
            case "getparameters":
                return self._parameters(arguments)
            case "getcurrentframe":
                self.once = components_of(arguments)
                return b"" if self.once else self._text_packet(ERROR, "Parse error")
            case "streamframes":
                return self._stream(arguments)
        return self._text_packet(ERROR, "Command not supported.")

    def _version(self, arguments: list[str]) -> bytes:
        if not arguments:
            return self._text_packet(COMMAND, f"Version is 1.{self.minor}")
        asked = _VERSION.fullmatch(arguments[0])
        if asked is None or not OLDEST <= int(asked[1]) <= NEWEST:
            return self._text_packet(ERROR, "Version NOT supported")
        self.minor = int(asked[1])
        return self._text_packet(COMMAND, f"Version set to 1.{self.minor}")

    def _parameters(self, arguments: list[str]) -> bytes:
        if "6d" in arguments or "all" in arguments:
            return self._text_packet(XML, parameters_6d(self.minor, self._server.bodies))
        if "general" in arguments:
            return self._text_packet(XML, parameters_general(self.minor, self._server.rate_hz))
        return self._text_packet(ERROR, "Parameters not available")

    def _stream(self, arguments: list[str]) -> bytes:
        if arguments[:1] == ["stop"]:
            self.wanted = None
            return b""
        divisor = self._divisor(arguments[0] if arguments else "")
        udp = next((asked for asked in map(_UDP.fullmatch, arguments) if asked), None)
        components = components_of(arguments)
        if divisor is None or not components or (udp and not 1023 <= int(udp[2]) <= 65_535):
            return self._text_packet(ERROR, "Parse error")
        self.wanted = Subscription(components, divisor, (udp[1] or self._host, int(udp[2])) if udp else None)
        return b""

    def _divisor(self, rate: str) -> int | None:
        kind, _, number = rate.partition(":")
        if kind == "allframes":
            return 1
        if not number.isdecimal() or not 1 <= int(number) <= 10_000:
            return None
        if kind == "frequencydivisor":
            return int(number)
        return max(round(self._server.rate_hz / int(number)), 1) if kind == "frequency" else None

    def _text_packet(self, kind: int, words: str) -> bytes:
        return text(self.order, kind, words)


def components_of(arguments: list[str]) -> tuple[int, ...]:
    """The types of the components named among a command's arguments."""
    return tuple(COMPONENTS[word] for word in arguments if word in COMPONENTS)


DISCOVERY_PORT = 22226
WELCOME = "QTM RT Interface connected"
INFO = "emulator, QTM 2024.3 (build 20041), 8 cameras"


def qtm_server(config: MocapConfig, bodies: tuple[str, ...], clock: Clock) -> Server:
    """Where the lab file's client looks for it."""
    del clock  # exposures carry their time
    qualisys = config.qualisys or QualisysConfig()
    return QtmServer(qualisys.host, qualisys.port, bodies, config.rate_hz)


class QtmServer:
    """On `port` little endian, on the next one big endian, as QTM's base port + 1 and + 2; ports for discovery: one."""

    def __init__(
        self, host: str, port: int, bodies: tuple[str, ...], rate_hz: float, discovery_port: int = DISCOVERY_PORT
    ) -> None:
        self.bodies = bodies
        self.rate_hz = rate_hz
        self._host, self._base_port, self._discovery_port = host, port - 1, discovery_port
        self._time = ServerClock()
        self._number = 0
        self._ports = tuple(self._port(order, port + k) for k, order in enumerate("<>"))
        self._udp: asyncio.DatagramTransport | None = None
        self._discovery: asyncio.DatagramTransport | None = None

    async def start(self) -> None:
        """Listen, frames counted from 1 by a new clock; OSError where an address is taken."""
        self._time, self._number = ServerClock(), 0
        loop = asyncio.get_running_loop()
        try:
            for port in self._ports:
                await port.start()
            self._udp, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, (self._host, 0))
            everywhere = self._host if is_loopback(self._host) else "0.0.0.0"  # where broadcasts come
            self._discovery, _ = await loop.create_datagram_endpoint(
                lambda: Discovery(self._base_port), (everywhere, self._discovery_port), reuse_port=True
            )
        except OSError:
            await self.close()
            raise

    def publish(self, frame: RawFrame) -> None:
        """One exposure to every client that streams; other bodies than before are an event."""
        if frame.bodies != self.bodies:
            self.bodies = frame.bodies
            for port in self._ports:
                port.send(lambda to: packet(to.order, EVENT, bytes([SETTINGS_CHANGED])))
        self._number += 1
        made: dict[tuple[str, tuple[int, ...]], bytes] = {}
        for port in self._ports:
            port.send(lambda to: self._frame_for(to, frame, made))

    async def close(self) -> None:
        """Send the event "QTM shutting down", end every connection and stop listening."""
        for port in self._ports:
            port.send(lambda to: packet(to.order, EVENT, bytes([SHUTTING_DOWN])))
            await port.close()
        for transport in (self._udp, self._discovery):
            if transport is not None:
                transport.close()

    def _port(self, order: str, port: int) -> TcpPort[QtmConversation]:
        hello = text(order, COMMAND, WELCOME)
        return TcpPort(self._host, port, lambda host: (QtmConversation(order, host, self), hello))

    def _frame_for(self, to: QtmConversation, frame: RawFrame, made: dict[tuple[str, tuple[int, ...]], bytes]) -> bytes:
        wanted = to.wanted
        if to.once:
            wanted, to.once = Subscription(to.once), ()
        if wanted is None or self._number % wanted.divisor:
            return b""
        key = to.order, wanted.components
        if key not in made:
            made[key] = self._data(*key, frame)
        if wanted.udp is None:
            return made[key]
        if self._udp is not None:
            self._udp.sendto(made[key], wanted.udp)
        return b""

    def _data(self, order: str, components: tuple[int, ...], frame: RawFrame) -> bytes:
        stamp_us = self._time.at_ns(frame.t_capture_ns) // 1000
        return data_packet(order, stamp_us, self._number, [six_d(order, kind, frame) for kind in components])


class Discovery(asyncio.DatagramProtocol):
    """Answers who asks for QTMs with what this one is and its base port, which alone is big endian."""

    def __init__(self, base_port: int) -> None:
        info = INFO.encode() + b"\0"
        self._answer = struct.pack("<II", 10 + len(info), COMMAND) + info + struct.pack(">H", base_port)
        self._transport: Any = None

    def connection_made(self, transport: Any) -> None:
        """Where to answer from."""
        self._transport = transport

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """To the port that the question names."""
        if len(data) == 10 and struct.unpack_from("<II", data) == (10, DISCOVER):
            self._transport.sendto(self._answer, (addr[0], struct.unpack_from(">H", data, 8)[0]))
