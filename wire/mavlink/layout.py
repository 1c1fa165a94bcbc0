"""How MAVLink lays a message's fields out in bytes, from pymavlink's generated tables.

Fields are handled flat and in the order of the message's documentation (arrays spread out); the order
on the wire, by size, stays inside `Layout`.
"""

import operator
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

# A field is an int, a float or (for char arrays) bytes: the message's own layout knows which.
Fields = tuple[Any, ...]


class MavlinkError(ValueError):
    """Bytes that are not a MAVLink packet we can read, or a message that MAVLink cannot carry."""


@dataclass(frozen=True, slots=True)
class Layout:
    """The bytes of one message: its number, its checksum seed and its payload's structure."""

    id: int
    name: str
    crc_extra: int
    payload: struct.Struct
    to_wire: Callable[[Fields], Fields]
    from_wire: Callable[[Fields], Fields]

    def pack(self, fields: Fields) -> bytes:
        """Payload with trailing zeros cut, at least one byte (MAVLink 2); raises `struct.error`, `OverflowError`."""
        return self.payload.pack(*self.to_wire(fields)).rstrip(b"\0") or b"\0"

    def unpack(self, payload: bytes) -> Fields:
        """Fields of a payload; a short one is filled with zeros, a longer one is a newer dialect's, cut."""
        return self.from_wire(self.payload.unpack_from(payload.ljust(self.payload.size, b"\0")))


CRC_EXTRA: dict[int, int] = {number: message.crc_extra for number, message in dialect.mavlink_map.items()}


def layout(name: str, count: int, *, raw: str = "", extension: str = "") -> Layout:
    """The layout of the message `name` with `count` fields, arrays spread out.

    Another version of pymavlink may know more extension fields, which are left out, or fewer, for which
    `extension` has the structure; extensions come last and take no part in the checksum's seed.
    raw: a four-byte field to keep as bytes. ValueError if these fields cannot be had.
    """
    message = getattr(dialect, f"MAVLink_{name.lower()}_message")
    codes = _field_codes(message.unpacker.format)
    if raw:
        codes[message.ordered_fieldnames.index(raw)] = "4s"
    counts = [1 if code.endswith("s") else int(code[:-1] or 1) for code in codes]
    starts = [sum(counts[:i]) for i in range(len(counts))]
    order = [starts[i] + k for i in message.orders for k in range(counts[i])][:count]
    kept = [code for code, start in zip(codes, starts, strict=True) if start < count]
    missing = count - len(order)
    if missing > len(extension) or sorted(order) != list(range(len(order))):
        raise ValueError(f"{name} with {count} fields is none that pymavlink knows")
    order += range(len(order), count)
    back = sorted(range(count), key=order.__getitem__)
    return Layout(
        id=message.id,
        name=name,
        crc_extra=message.crc_extra,
        payload=struct.Struct("<" + "".join(kept) + extension[len(extension) - missing :]),
        to_wire=operator.itemgetter(*back),
        from_wire=operator.itemgetter(*order),
    )


def _field_codes(structure: str) -> list[str]:
    """ "<I4fB" -> ["I", "4f", "B"], one code a field; pymavlink writes only arrays with a count."""
    codes: list[str] = []
    count = ""
    for character in structure.lstrip("<"):
        if character.isdigit():
            count += character
        else:
            codes.append(count + character)
            count = ""
    return codes
