"""MAVLink's bytes: how a message's fields are laid out, how frames are made, and how bytes are cut into whole ones.

Layouts are pymavlink's generated tables. Fields are handled flat and in the order of the message's documentation
(arrays spread out); the order on the wire, by size, stays inside `Layout`. Nothing else knows where packets begin and
end; `wire.mavlink.codec` reads what they say. The cost of any piece of bytes is bounded, whatever they are: where a
frame might begin and does not, the search goes on behind that byte, but only so often; then what is left is no MAVLink.
"""

import operator
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from fastcrc import crc16
from pymavlink.dialects.v20 import ardupilotmega as dialect

from wire.link_messages import Address

# A field is an int, a float or (for char arrays) bytes: the message's own layout knows which.
Fields = tuple[Any, ...]
LARGEST_DATAGRAM = 2048
"""Bytes; no MAVLink sender sends more at once, and a larger datagram is rejected unread."""
FRAMES_MOST = 8
"""Places of one datagram where a frame is looked for, found or not; `packed` keeps to it, and who sends one frame a
datagram (most do) never meets it."""
_PACKED_BYTES = 1200
# On a line that noise and restarts cut anywhere, false starts are what is bounded, by the bytes read.
_FALSE_STARTS, _BYTES_A_FALSE_START = 8, 32
MAGIC_1, MAGIC_2 = 0xFE, 0xFD
_MAGICS = (MAGIC_1, MAGIC_2)
SIGNED, SIGNATURE_BYTES = 0x01, 13
_OVERHEAD_1, _OVERHEAD_2 = 8, 12
_HEAD_1, _HEAD_2 = struct.Struct("<xBBBBB"), struct.Struct("<xBxxBBBHB")
_WRITTEN_2 = struct.Struct("<BBBBBBBHB")
_SEED = tuple(bytes([value]) for value in range(256))
_mcrf4xx = crc16.mcrf4xx
_address = lru_cache(maxsize=1024)(Address)


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
    codes = field_codes(message.unpacker.format)
    if raw:
        codes[message.ordered_fieldnames.index(raw)] = "4s"
    counts = [1 if code.endswith("s") else int(code[:-1] or 1) for code in codes]
    starts = [sum(counts[:i]) for i in range(len(counts))]
    order = [starts[i] + k for i in message.orders for k in range(counts[i])][:count]
    used = [code for code, start in zip(codes, starts, strict=True) if start < count]
    missing = count - len(order)
    if missing > len(extension) or sorted(order) != list(range(len(order))):
        raise ValueError(f"{name} with {count} fields is none that pymavlink knows")
    order += range(len(order), count)
    back = sorted(range(count), key=order.__getitem__)
    return Layout(
        id=message.id,
        name=name,
        crc_extra=message.crc_extra,
        payload=struct.Struct("<" + "".join(used) + extension[len(extension) - missing :]),
        to_wire=operator.itemgetter(*back),
        from_wire=operator.itemgetter(*order),
    )


def field_codes(structure: str) -> list[str]:
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


@dataclass(slots=True, eq=False)
class Frame:
    """One whole frame: its bytes as they came, its message's number, its sender, its sequence number and its payload.

    message: what it says, once somebody has read it (wire.mavlink.codec); it is read once, however many it reaches.
    """

    data: bytes
    number: int
    source: Address
    seq: int
    payload: bytes
    message: Any = None

    @property
    def head(self) -> int:
        """Bytes before the payload."""
        return _HEAD_1.size if self.data[0] == MAGIC_1 else _HEAD_2.size


class FrameCutter:
    """One direction of one link. Bytes between frames, and frames whose checksum is wrong, are counted and dropped.

    `stream`: data is a byte stream (serial, TCP) that cuts frames anywhere; else every piece of data is a datagram:
    of at most LARGEST_DATAGRAM bytes and FRAMES_MOST frames, and an unfinished one at its end is lost, not waited for.
    """

    def __init__(self, *, stream: bool = False) -> None:
        self.dropped_bytes = 0
        self.bad_frames = 0
        self._stream = stream
        self._held = b""

    def cut(self, data: bytes) -> list[Frame]:
        """The frames that `data` completes, in order; never raises."""
        buffer = self._held + data if self._held else data
        self._held = b""
        end = len(buffer)
        if self._stream:
            tries = _FALSE_STARTS + end // _BYTES_A_FALSE_START
        else:
            tries = FRAMES_MOST
            if end > LARGEST_DATAGRAM:
                self.dropped_bytes += end
                return []
        frames: list[Frame] = []
        at = 0
        while at < end and tries:
            if buffer[at] == MAGIC_2 and end - at >= _OVERHEAD_2 and not buffer[at + 2]:
                stop = at + _OVERHEAD_2 + buffer[at + 1]  # as _stop has it: nearly every frame is one of these
            else:
                stop = _stop(buffer, at, end)
            if stop > end and self._stream:
                self._held = buffer[at:]
                return frames
            if at < stop <= end:
                frame = _frame(buffer, at, stop)
                if frame is not None:
                    frames.append(frame)
                    at = stop
                    tries -= not self._stream
                    continue
                self.bad_frames += 1
            tries -= 1
            following = _next_magic(buffer, at + 1)
            self.dropped_bytes += following - at
            at = following
        self.dropped_bytes += end - at
        return frames


def packed(frames: bytes) -> list[bytes]:
    """Whole frames, end to end, in as few datagrams as carry them."""
    datagrams: list[bytes] = []
    start = at = count = 0
    end = len(frames)
    if end and frames[0] == MAGIC_2 and not frames[2] and end == _OVERHEAD_2 + frames[1]:
        return [frames]
    while at < end:
        stop = _stop(frames, at, end)
        if count == FRAMES_MOST or (count and stop - start > _PACKED_BYTES):
            datagrams.append(frames[start:at])
            start, count = at, 0
        at, count = stop, count + 1
    return [*datagrams, frames[start:]] if at > start else datagrams


def framed(layout: Layout, fields: Fields, source: Address, seq: int) -> Frame:
    """One MAVLink 2 frame, unsigned; raises `struct.error`, `OverflowError`."""
    number = layout.id
    payload = layout.pack(fields)
    head = _WRITTEN_2.pack(
        MAGIC_2, len(payload), 0, 0, seq, source.system, source.component, number & 0xFFFF, number >> 16
    )
    crc: int = _mcrf4xx(head[1:] + payload + _SEED[layout.crc_extra])
    return Frame(head + payload + crc.to_bytes(2, "little"), number, source, seq, payload)


def frame_count(datagram: bytes) -> int:
    """How many whole frames a datagram holds, one after the other, as their heads say; sound or not."""
    at = count = 0
    end = len(datagram)
    while at < end:
        stop = _stop(datagram, at, end)
        if not at < stop <= end:
            break
        at, count = stop, count + 1
    return count


def renumbered(frame: Frame, seq: int) -> bytes:
    """The frame with another sequence number; as it is if it is signed, of version 1, or in no dialect of ours."""
    return frame.data if frame.data[2] else resealed(frame.data, 0, seq) or frame.data


def sealed(body: bytes, crc_extra: int) -> bytes:
    """A frame's head and payload with their checksum behind them."""
    crc: int = _mcrf4xx(body[1:] + _SEED[crc_extra])
    return body + crc.to_bytes(2, "little")


def resealed(frame: bytes, flags: int, seq: int | None = None) -> bytes | None:
    """A whole MAVLink 2 frame with other incompatibility flags and its checksum anew, without its signature.

    seq: another sequence number; None: the same. Returns None for MAVLink 1, and for what is in no dialect of ours.
    """
    if frame[0] != MAGIC_2:
        return None
    crc_extra = CRC_EXTRA.get(frame[7] | frame[8] << 8 | frame[9] << 16)
    if crc_extra is None:
        return None
    number = _SEED[frame[4] if seq is None else seq % 256]
    return sealed(frame[:2] + _SEED[flags] + frame[3:4] + number + frame[5 : 10 + frame[1]], crc_extra)


def whole_stop(data: bytes, at: int) -> int | None:
    """Where the whole frame that starts at `at` stops, as its head says; None where none does."""
    if at >= len(data):
        return None
    stop = _stop(data, at, len(data))
    return stop if at < stop <= len(data) else None


def _stop(buffer: bytes, at: int, end: int) -> int:
    """Where the frame that starts at `at` stops, as far as its head says: `at` if none starts there.

    Beyond `end` where the frame, or the head itself, is not whole yet.
    """
    magic = buffer[at]
    if magic == MAGIC_2:
        if end - at < 3:
            return end + 1
        flags = buffer[at + 2]
        if flags > SIGNED:
            return at
        return at + _OVERHEAD_2 + buffer[at + 1] + (SIGNATURE_BYTES if flags else 0)
    if magic == MAGIC_1:
        return at + _OVERHEAD_1 + buffer[at + 1] if end - at > 1 else end + 1
    return at


def _frame(buffer: bytes, at: int, stop: int) -> Frame | None:
    """The frame between `at` and `stop`; None if its checksum is wrong.

    A message that is in no dialect of ours cannot be checked: it is believed if a frame, or nothing, follows it.
    """
    if buffer[at] == MAGIC_2:
        size, seq, system, component, low, high = _HEAD_2.unpack_from(buffer, at)
        number, start = low | high << 16, at + 10
    else:
        size, seq, system, component, number = _HEAD_1.unpack_from(buffer, at)
        start = at + 6
    crc_at = start + size
    crc_extra = CRC_EXTRA.get(number)
    if crc_extra is None:
        if stop < len(buffer) and buffer[stop] not in _MAGICS:
            return None
    elif _mcrf4xx(buffer[at + 1 : crc_at] + _SEED[crc_extra]) != buffer[crc_at] | buffer[crc_at + 1] << 8:
        return None
    return Frame(buffer[at:stop], number, _address(system, component), seq, buffer[start:crc_at])


def _next_magic(buffer: bytes, at: int) -> int:
    """Index of the next byte that could start a frame, or the buffer's length."""
    second = buffer.find(MAGIC_2, at)
    first = buffer.find(MAGIC_1, at) if second < 0 else buffer.find(MAGIC_1, at, second)
    if first >= 0:
        return first
    return second if second >= 0 else len(buffer)
