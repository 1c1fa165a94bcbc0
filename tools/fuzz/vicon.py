"""Any packets to the client of Vicon: nothing raises, stalls or locks out the next sound frame.

    python -m tools.fuzz.vicon --count 1000000

Packets of every object that the client reads and of some it does not, in any order and number; most of them broken in
words, bytes, counts, sizes or length.
"""

import random
import struct

from formation.mocap_config import MocapConfig, ViconConfig
from mocap.sources.vicon.session import Vicon
from tools.fuzz.command import main
from tools.fuzz.mocap import NUMBERS, Client, Result, broken, fuzz

NAMES = (b"lead", b"right", b"", b"x" * 300, b"\x1b[2J", b"\xff\xfe", b"\xc3\xbc")
DOUBLES = (0.0, 1.0, -1.0, 1e3, 1e300, 5e-324, float("nan"), float("inf"), -float("inf"))
IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
KINDS = (1, 2, 5, 9, 26, 42, 100001, 100004)


class Packets:
    """Draws what a server may send, and what it may not."""

    def __init__(self, seed: int) -> None:
        self._rng = random.Random(seed)
        self._number = 0

    def draw(self) -> bytes:
        """The next packet, broken more often than not."""
        rng = self._rng
        if rng.random() < 0.05:
            return rng.randbytes(rng.choice((1, 8, 60, 400)))
        before = b"".join(self._usual() for _ in range(rng.choice((0, 0, 3))))
        packet = self._usual() if before else packet_of(*(self._block() for _ in range(rng.choice((0, 1, 2, 4, 8)))))
        return before + (packet if rng.random() < 0.3 else broken(rng, packet))

    def _usual(self) -> bytes:
        """Laid out the same each time, as servers send them."""
        self._number += 1
        place = struct.pack("<III12d", 1, 1, 1, *(self._rng.choice(DOUBLES) for _ in range(3)), *IDENTITY)
        latency = struct.pack("<I", 1) + text(b"lead") + struct.pack("<d", self._latency())
        return packet_of((5, struct.pack("<I", self._number % 2**32)), (26, latency), (9, place))

    def _block(self) -> tuple[int, bytes]:
        rng = self._rng
        match rng.choice((1, 2, 2, 5, 5, 5, 9, 9, 9, 26, 42, 100001, 100004, 0)):
            case 1:
                return 1, struct.pack("<q", rng.choice((562_500, 562_500, 1_350_000, 0, -1, 2**63 - 1)))
            case 2:
                return 2, subject(rng.choice((1, 1, 2, 2, *NUMBERS)), rng.choice(NAMES), rng.choice((1, 1, 5)))
            case 5:
                self._number += rng.choice((0, 1, 1, 1, 2, 50, -7, 2**31))
                return 5, struct.pack("<I", self._number % 2**32)
            case 9:
                return 9, self._segments()
            case 26:
                n = rng.choice((0, 1, 2, 2, 9))
                samples = b"".join(text(rng.choice(NAMES)) + struct.pack("<d", self._latency()) for _ in range(n))
                return 26, struct.pack("<I", n) + samples
            case 100001:
                return 100001, numbers(*(rng.choice((*KINDS, *NUMBERS)) for _ in range(rng.choice((0, 2, 8)))), *KINDS)
            case 100004:
                table = b"".join(struct.pack("<II", rng.choice(KINDS), 1) for _ in range(3))
                return 100004, struct.pack("<I", 3) + table + numbers(*rng.sample(KINDS, rng.randrange(5)))
            case kind:
                return rng.choice((kind, rng.randrange(50))), rng.randbytes(rng.choice((0, 4, 8, 40)))

    def _segments(self) -> bytes:
        rng = self._rng
        n = rng.choice((0, 1, 1, 1, 2, 9))
        segments = b""
        for k in range(n):
            cells = IDENTITY if rng.random() < 0.6 else [rng.choice(DOUBLES) for _ in range(9)]
            segments += struct.pack("<I12d", rng.choice((1, 1 + k)), *(rng.choice(DOUBLES) for _ in range(3)), *cells)
        return struct.pack("<II", rng.choice((1, 2, 3)), n) + segments

    def _latency(self) -> float:
        return 0.002 if self._rng.random() < 0.7 else self._rng.choice(DOUBLES)


def text(words: bytes) -> bytes:
    """A string."""
    return struct.pack("<I", len(words)) + words


def numbers(*members: int) -> bytes:
    """A set."""
    return struct.pack(f"<{1 + len(members)}I", len(members), *members)


def subject(identifier: int, name: bytes, root: int) -> bytes:
    """SubjectInfo of one segment."""
    segment = struct.pack("<II6f", 0, root, *[0.0] * 6) + text(name)
    return struct.pack("<I", identifier) + text(name) + struct.pack("<I", 1) + segment + bytes(8)


def packet_of(*blocks: tuple[int, bytes]) -> bytes:
    """With its header and theirs."""
    body = b"".join(struct.pack("<II", kind, len(data)) + data for kind, data in blocks)
    return struct.pack("<II", 0x1A2B0001, len(body)) + body


def sound(number: int) -> tuple[bytes, ...]:
    """A connection of one subject, and two frames of it."""
    segment = struct.pack("<III12d", 1, 1, 1, 1000.0, 2.0, 3.0, *IDENTITY)
    first, second = ((5, struct.pack("<I", (7 + number + k) % 2**32)) for k in (0, 1))
    static = (1, struct.pack("<q", 562_500)), (2, subject(1, b"lead", 1))
    return (
        packet_of((100001, numbers(*KINDS))),
        packet_of(*static, first, (9, segment)),
        packet_of(second, (9, segment)),
    )


def run(count: int, seed: int) -> Result:
    """Draw and feed `count` packets."""
    client = Client(MocapConfig(source="vicon"), lambda feed: Vicon(ViconConfig(), ("lead", "right"), 8_000_000, feed))
    return fuzz(client, Packets(seed).draw, sound, count)


if __name__ == "__main__":
    main(run, __doc__)
