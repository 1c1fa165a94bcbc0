"""NatNet packets written by hand from the published layout, field by field; nothing of the product makes them."""

from struct import pack

TOKEN, ANSWERED_TICKS, FREQUENCY_HZ = 278_554, 987_656_000_000, 3_312_787


def packet(kind: int, payload: bytes) -> bytes:
    return pack("<HH", kind, len(payload)) + payload


SERVER_INFO = packet(
    1,
    b"Motive".ljust(256, b"\0") + bytes((2, 1, 0, 0)) + bytes((3, 0, 0, 0))
    + pack("<QHB", FREQUENCY_HZ, 1511, 1) + bytes((239, 255, 42, 99)),
)  # fmt: skip
ECHO_REQUEST = packet(12, pack("<Q", TOKEN))
ECHO_RESPONSE = packet(13, pack("<QQ", TOKEN, ANSWERED_TICKS))
DISCOVERY = packet(14, b"NatNetLib".ljust(256, b"\0") + bytes((3, 0, 0, 0)) + bytes((3, 0, 0, 0)))
MODELS_REQUEST = packet(4, b"")

BODIES = ((7, (1.5, -2.0, 0.25), (0.0, 0.6, 0.0, 0.8), 1), (9, (0.0, 4.0, 8.0), (0.0, 0.0, 0.0, 1.0), 0))
"""Of `whole_frame`: id, position, rotation x y z w, params."""
EXPOSURE, NUMBER = 123_456_789_012, 4711
NAMES = {3: "Wand", 7: "lead", 9: "Körper 2"}


def whole_frame(version: tuple[int, int], params: int = 0) -> bytes:
    """A frame with something in every section, byte by byte as the versions' layouts have it."""
    bone = pack("<i7ffh", 65_538, *range(7), 0.001, 1)
    marker = pack("<i4fhf", 458_753, 1, 2, 3, 0.014, 10, 0.0002)
    channels = pack("<ii", 1, 2) + pack("<i3f", 3, 1, 2, 3) + pack("<if", 1, 9)
    sections = [
        (2, b"lead\0" + pack("<i3f", 1, 1, 2, 3) + b"all\0" + pack("<i6f", 2, *range(6))),
        (1, pack("<3f", 7, 8, 9)),
        (2, b"".join(pack("<i3f4ffh", k, *pos, *q, 0.0001, seen) for k, pos, q, seen in BODIES)),
        (1, pack("<ii", 1, 2) + 2 * bone),
        (1, pack("<ii", 5, 1) + bone + pack("<i", 1) + marker),
        (2, 2 * marker),
        (1, channels),
        (1, channels),
    ]
    if version < (4, 1):
        del sections[4]
    body = b"".join(
        pack("<i", count) + (pack("<i", len(content)) if version >= (4, 1) else b"") + content
        for count, content in sections
    )
    end = pack("<IId", 1, 2, 40.5) + pack("<QQQ", EXPOSURE, EXPOSURE + 5, EXPOSURE + 9)
    end += pack("<II", 1_700_000_000, 99) if version >= (4, 1) else b""
    return packet(7, pack("<i", NUMBER) + body + end + pack("<h", params) + bytes(4))


def whole_models(version: tuple[int, int]) -> bytes:
    """A description of every type, three of them rigid bodies, and one of those in the skeleton besides."""
    rotation = pack("<4f", 0, 0, 0, 1) if version >= (4, 2) else b""

    def body(number: int, name: str) -> bytes:
        markers = pack("<i", 2) + pack("<6f", *range(6)) + pack("<2i", 0, 0)
        names = b"M1\0Marker 2\0" if version >= (4, 0) else b""
        return name.encode() + b"\0" + pack("<ii3f", number, -1, 0, 0, 0) + rotation + markers + names

    parts = [
        (0, b"lead\0" + pack("<i", 2) + b"M1\0M2\0"),
        *((1, body(number, name)) for number, name in NAMES.items()),
        (2, b"Man\0" + pack("<ii", 1, 1) + body(65_537, "Hip")),
        (3, pack("<i", 1) + b"serial\0" + bytes(4 * (2 + 3 + 144 + 12 + 2)) + pack("<i", 2) + b"Fx\0Fy\0"),
        (4, pack("<i", 2) + b"NIDAQ\0" + b"serial\0" + pack("<ii", 1, 1) + pack("<i", 1) + b"ai0\0"),
        (5, b"Prime 13 #1\0" + bytes(28)),
    ]
    if version >= (4, 1):
        marker = b"m\0" + bytes(4 + 12 + 4 + 2)
        parts.append((6, b"asset\0" + pack("<iii", 1, 5, 1) + body(1, "bone") + pack("<i", 1) + marker))
    payload = pack("<i", len(parts))
    for kind, content in parts:
        payload += pack("<i", kind) + (pack("<i", len(content)) if version >= (4, 1) else b"") + content
    return packet(5, payload)


FRAME, MODELS = whole_frame((3, 0)), whole_models((3, 0))
