"""What one client of QTM says, and what QTM answers. Sans-IO. Source: QTM RT protocol documentation, "Commands"."""

import re
import struct
from dataclasses import dataclass
from typing import Protocol

from sim.cameras.servers.qtm import packets

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
class Wanted:
    """What a client has streamed to it: components, every how manieth frame, over UDP to where."""

    components: tuple[int, ...]
    divisor: int = 1
    udp: tuple[str, int] | None = None


class QtmConversation:
    """One client's. order: of the bytes, as its port says; host: where it is."""

    def __init__(self, order: str, host: str, server: ServerState) -> None:
        self.order = order
        self.wanted: Wanted | None = None
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
            known = kind == packets.COMMAND
            answers.append(self._answer(words) if known else self._text_packet(packets.ERROR, "Command not supported."))
        return b"".join(answers)

    def _answer(self, words: str) -> bytes:
        name, *arguments = words.lower().split() or [""]
        match name:
            case "version":
                return self._version(arguments)
            case "qtmversion":
                return self._text_packet(packets.COMMAND, QTM_VERSION)
            case "byteorder":
                big = self.order == ">"
                return self._text_packet(packets.COMMAND, f"Byte order is {'big' if big else 'little'} endian")
            case "getstate" | "getlastevent":
                return packets.packet(self.order, packets.EVENT, bytes([packets.CONNECTED]))
            case "getparameters":
                return self._parameters(arguments)
            case "getcurrentframe":
                self.once = components_of(arguments)
                return b"" if self.once else self._text_packet(packets.ERROR, "Parse error")
            case "streamframes":
                return self._stream(arguments)
        return self._text_packet(packets.ERROR, "Command not supported.")

    def _version(self, arguments: list[str]) -> bytes:
        if not arguments:
            return self._text_packet(packets.COMMAND, f"Version is 1.{self.minor}")
        asked = _VERSION.fullmatch(arguments[0])
        if asked is None or not OLDEST <= int(asked[1]) <= NEWEST:
            return self._text_packet(packets.ERROR, "Version NOT supported")
        self.minor = int(asked[1])
        return self._text_packet(packets.COMMAND, f"Version set to 1.{self.minor}")

    def _parameters(self, arguments: list[str]) -> bytes:
        if "6d" in arguments or "all" in arguments:
            return self._text_packet(packets.XML, packets.parameters_6d(self.minor, self._server.bodies))
        if "general" in arguments:
            return self._text_packet(packets.XML, packets.parameters_general(self.minor, self._server.rate_hz))
        return self._text_packet(packets.ERROR, "Parameters not available")

    def _stream(self, arguments: list[str]) -> bytes:
        if arguments[:1] == ["stop"]:
            self.wanted = None
            return b""
        divisor = self._divisor(arguments[0] if arguments else "")
        udp = next((asked for asked in map(_UDP.fullmatch, arguments) if asked), None)
        components = components_of(arguments)
        if divisor is None or not components or (udp and not 1023 <= int(udp[2]) <= 65_535):
            return self._text_packet(packets.ERROR, "Parse error")
        self.wanted = Wanted(components, divisor, (udp[1] or self._host, int(udp[2])) if udp else None)
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
        return packets.text(self.order, kind, words)


def components_of(arguments: list[str]) -> tuple[int, ...]:
    """The types of the components named among a command's arguments."""
    return tuple(packets.COMPONENTS[word] for word in arguments if word in packets.COMPONENTS)
