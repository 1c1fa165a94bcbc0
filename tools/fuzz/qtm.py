"""Any packets to the client of Qualisys: nothing raises, stalls or locks out the next sound frame.

    python -m tools.fuzz.qtm --count 1000000

Packets of every kind that QTM has, with components of every kind, names, events and words; most of them broken in
words, bytes, counts, sizes or length.
"""

import random
import struct

from formation.mocap_config import MocapConfig, QualisysConfig
from mocap.sources.qualisys import Qualisys
from tools.fuzz.command import main
from tools.fuzz.mocap import Client, Result, broken, fuzz

NAMES = ("lead", "right", "", "x" * 300, "\x1b[2J", "ü", "&amp;", "&#0;", "<a/>")
WORDS = (
    b"QTM RT Interface connected",
    b"Version set to 1.19",
    b"Version NOT supported",
    b"Parameters not available",
    b"",
)
FLOATS = (0.0, 1.0, -1.0, 1e3, 1e38, float("nan"), float("inf"), -float("inf"))
STAMPS = (0, 1, -1, 2**62, -(2**63), 2**63 - 1)


class Packets:
    """Draws what QTM may send, and what it may not."""

    def __init__(self, seed: int) -> None:
        self._rng = random.Random(seed)
        self._number = 0

    def draw(self) -> bytes:
        """The next packet, broken more often than not."""
        rng = self._rng
        roll = rng.random()
        if roll < 0.05:
            return rng.randbytes(rng.choice((1, 8, 60, 400)))
        if roll < 0.8:
            packet = packet_of(3, self._frame())
        elif roll < 0.85:
            packet = packet_of(2, self._parameters())
        else:
            packet = packet_of(rng.randrange(10), rng.choice((*WORDS, bytes([rng.randrange(20)]), rng.randbytes(20))))
        return packet if rng.random() < 0.3 else broken(rng, packet)

    def _frame(self) -> bytes:
        rng = self._rng
        self._number += rng.choice((0, 1, 1, 1, 2, 50, -7, 2**31))
        stamp = rng.choice(STAMPS) if rng.random() < 0.1 else 1000 * self._number
        count = rng.choice((0, 1, 1, 1, 2, 3))
        parts = b"".join(self._component() for _ in range(count))
        return struct.pack("<QII", stamp % 2**64, self._number % 2**32, count) + parts

    def _component(self) -> bytes:
        rng = self._rng
        kind = 5 if rng.random() < 0.8 else rng.randrange(22)
        n = rng.choice((0, 1, *10 * (2,), 20))
        if rng.random() < 0.5:
            body = n * struct.pack("<12f", 1.0, 2.0, 3.0, 1, 0, 0, 0, 1, 0, 0, 0, 1)
        else:
            body = struct.pack(f"<{12 * n}f", *(rng.choice(FLOATS) for _ in range(12 * n)))
        return struct.pack("<IIihh", 16 + len(body), kind, n, 0, 0) + body

    def _parameters(self) -> bytes:
        rng = self._rng
        bodies = "".join(
            f"<Body><Name>{rng.choice(NAMES)}</Name></Body>" for _ in range(rng.choice((0, 1, 2, 2, 2, 20)))
        )
        entity = '<!DOCTYPE a [<!ENTITY b "c">]>' if rng.random() < 0.05 else ""
        return f"{entity}<QTM><The_6D>{bodies}</The_6D></QTM>".encode() + b"\0"


def packet_of(kind: int, data: bytes) -> bytes:
    """With its header."""
    return struct.pack("<II", 8 + len(data), kind) + data


def sound(number: int) -> tuple[bytes, ...]:
    """A connection of two bodies, and two frames of them."""
    names = b"<QTM><The_6D><Body><Name>lead</Name></Body><Body><Name>right</Name></Body></The_6D></QTM>\0"
    bodies = 2 * struct.pack("<12f", 1.0, 2.0, 3.0, 1, 0, 0, 0, 1, 0, 0, 0, 1)
    body = struct.pack("<IIihh", 16 + len(bodies), 5, 2, 0, 0) + bodies
    frames = (struct.pack("<qII", 1000 * number, (7 + number + k) % 2**32, 1) + body for k in (0, 1))
    return (
        packet_of(1, WORDS[0] + b"\0"),
        packet_of(1, WORDS[1] + b"\0"),
        packet_of(2, names),
        *(packet_of(3, frame) for frame in frames),
    )


def run(count: int, seed: int) -> Result:
    """Draw and feed `count` packets."""
    client = Client(
        MocapConfig(source="qualisys"), lambda feed: Qualisys(QualisysConfig(), ("lead", "right"), 8_000_000, feed)
    )
    return fuzz(client, Packets(seed).draw, sound, count)


if __name__ == "__main__":
    main(run, __doc__)
