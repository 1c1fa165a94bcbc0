"""The MAVLink codec: bytes to and from the messages of `wire.link_messages`. MAVLink 2 out, 1 and 2 in, never signed.

The invariant: any bytes either read as packets or raise the one error, `MavlinkError`; `Codec.receive` counts
that error and goes on. Bytes out are those of pymavlink, whose tables are used (wire.mavlink_layout).
"""

import struct
from functools import lru_cache
from typing import Any

from fastcrc import crc16

from wire import mavlink_guidance, mavlink_motion, mavlink_service, mavlink_storage
from wire.link_messages.address import BROADCAST, Address
from wire.link_messages.clocks import Ping, TimeSync
from wire.link_messages.commands import Command, CommandAck, CommandInt, SetMode
from wire.link_messages.motion import SetOrigin
from wire.link_messages.packet import LinkMessage, Packet, Unknown
from wire.link_messages.parameters import ParamRequestList, ParamRequestRead, ParamSet
from wire.link_messages.setpoints import AttitudeSetpoint, PositionSetpoint
from wire.link_messages.status import StatusText
from wire.link_messages.storage import LogRequestList, MissionCount, MissionRequestList
from wire.mavlink_layout import CRC_EXTRA, Fields, Layout, MavlinkError
from wire.mavlink_params import param_from_raw, param_to_raw
from wire.mavlink_text import STATUSTEXT, TextChunk, TextJoiner, chunk_text, text_of

__all__ = ["Codec", "MavlinkError", "decode_packet", "param_from_raw", "param_to_raw"]

_MAGIC_1, _MAGIC_2 = 0xFE, 0xFD
_HEADER_1, _HEADER_2 = 6, 10
_CHECKSUM, _SIGNATURE = 2, 13
_SIGNED = 0x01
_HEADER = struct.Struct("<BBBBBBBHB")
_SEED = tuple(bytes([value]) for value in range(256))

_GROUPS = (mavlink_motion, mavlink_service, mavlink_guidance, mavlink_storage)
_WRITERS = {kind: write for group in _GROUPS for kind, write in group.WRITERS.items()}
_READERS = {layout.id: (layout, read) for group in _GROUPS for layout, read in group.READERS.items()}
# What says for whom it is: both numbers of an address, or the system alone.
_ADDRESSED = frozenset(
    {AttitudeSetpoint, PositionSetpoint, Command, CommandInt, CommandAck, TimeSync, Ping, ParamSet,
     ParamRequestRead, ParamRequestList, MissionRequestList, MissionCount, LogRequestList}
)  # fmt: skip
_FOR_SYSTEM = frozenset({SetMode, SetOrigin})


def decode_packet(frame: bytes) -> Packet:
    """The packet that `frame` is, whole and alone; a chunk of a long text reads as a text of its own.

    Raises MavlinkError. A packet of an id that is in no dialect of ours reads as Unknown, unchecked.
    """
    if not frame or _frame_length(frame, 0) != len(frame):
        raise MavlinkError("not one whole MAVLink packet")
    seq, source, number, start, stop = _head(frame, 0)
    if not _is_checked(frame, 0, len(frame), number, stop):
        raise MavlinkError("wrong checksum")
    message = _read(frame, number, start, stop)
    if isinstance(message, TextChunk):
        message = text_of(message.severity, [message.part])
    return Packet(source, seq, message)


class Codec:
    """One end of one drone's link: its own address, its sequence number, its counters.

    Packets addressed to somebody else are dropped here, so that no reader can forget to; system or component
    zero is everybody. `stream`: data is a byte stream (serial, TCP) that cuts packets anywhere; else every
    piece of data is a datagram and an unfinished packet at its end is lost, not waited for.
    """

    def __init__(self, own: Address, *, stream: bool = False) -> None:
        self.own = own
        self.bad_bytes = 0
        self.bad_packets = 0
        self.lost_packets = 0
        self.misaddressed_packets = 0
        self._stream = stream
        self._partial = b""
        self._seq = 0
        self._text_id = 0
        self._texts = TextJoiner()
        self._next_seq: dict[Address, int] = {}

    def encode(self, message: LinkMessage) -> bytes:
        """The packet of `message` (several, end to end, for a long text).

        Raises MavlinkError where MAVLink cannot carry it: a number out of its field's range, a name too long.
        """
        if isinstance(message, StatusText):
            self._text_id = self._text_id % 0xFFFF + 1
            return b"".join(self._frame(STATUSTEXT, chunk) for chunk in chunk_text(message, self._text_id))
        write = _WRITERS.get(type(message))
        if write is None:
            raise MavlinkError(f"{type(message).__name__} has no bytes of its own")
        try:
            layout, fields = write(message)
            return self._frame(layout, fields)
        except (struct.error, OverflowError) as error:
            raise MavlinkError(f"{type(message).__name__}: {error}") from error

    def receive(self, data: bytes) -> list[Packet]:
        """The packets in `data`, in order; never raises, what cannot be read is skipped and counted."""
        buffer = self._partial + data if self._partial else data
        self._partial = b""
        packets: list[Packet] = []
        at, end = 0, len(buffer)
        while at < end:
            length = _frame_length(buffer, at)
            if at + length > end:
                if self._stream:
                    self._partial = buffer[at:]
                    break
                length = 0
            if length > 0 and self._take(buffer, at, length, packets):
                at += length
            else:
                following = _next_magic(buffer, at + 1)
                self.bad_bytes += following - at
                at = following
        return packets

    def _take(self, buffer: bytes, at: int, length: int, packets: list[Packet]) -> bool:
        """Read one frame into `packets`; False if it is none (the checksum is wrong), so that the search goes on."""
        seq, source, number, start, stop = _head(buffer, at)
        if not _is_checked(buffer, at, length, number, stop):
            self.bad_packets += 1
            return False
        self._count_lost(source, seq)
        try:
            message = _read(buffer, number, start, stop)
        except MavlinkError:
            self.bad_packets += 1
            return True
        if isinstance(message, TextChunk):
            packets.extend(Packet(source, seq, text) for text in self._texts.join(source, message))
        elif self._is_ours(message):
            packets.append(Packet(source, seq, message))
        else:
            self.misaddressed_packets += 1
        return True

    def _is_ours(self, message: Any) -> bool:
        own, kind = self.own, type(message)
        if kind is TimeSync and message.tc1_ns:
            return True  # an answer is known by what it repeats: PX4 1.16 leaves its target to chance
        if kind in _ADDRESSED:
            target: Address = message.target
            return target.system in (BROADCAST, own.system) and target.component in (BROADCAST, own.component)
        return kind not in _FOR_SYSTEM or message.target_system in (BROADCAST, own.system)

    def _count_lost(self, source: Address, seq: int) -> None:
        self.lost_packets += (seq - self._next_seq.get(source, seq)) & 0xFF
        self._next_seq[source] = (seq + 1) & 0xFF

    def _frame(self, layout: Layout, fields: Fields) -> bytes:
        payload = layout.pack(fields)
        number = layout.id
        own = self.own
        head = _HEADER.pack(
            _MAGIC_2, len(payload), 0, 0, self._seq, own.system, own.component, number & 0xFFFF, number >> 16
        )
        self._seq = (self._seq + 1) & 0xFF
        body = head + payload
        crc = crc16.mcrf4xx(body[1:] + _SEED[layout.crc_extra])
        return body + crc.to_bytes(2, "little")


def _frame_length(buffer: bytes, at: int) -> int:
    """Length of the frame that starts at `at`, as far as its header says; 0 if none starts there.

    More than what is left of the buffer where the frame, or the header itself, is not whole yet.
    """
    magic, left = buffer[at], len(buffer) - at
    if magic == _MAGIC_2:
        if left < 3:
            return _HEADER_2
        flags = buffer[at + 2]
        if flags & ~_SIGNED:
            return 0
        return _HEADER_2 + buffer[at + 1] + _CHECKSUM + (_SIGNATURE if flags else 0)
    if magic == _MAGIC_1:
        return _HEADER_1 + _CHECKSUM + (buffer[at + 1] if left > 1 else 0)
    return 0


def _next_magic(buffer: bytes, at: int) -> int:
    """Index of the next byte that could start a packet, or the buffer's length."""
    found = [i for i in (buffer.find(_MAGIC_2, at), buffer.find(_MAGIC_1, at)) if i >= 0]
    return min(found, default=len(buffer))


_address = lru_cache(maxsize=1024)(Address)


def _head(buffer: bytes, at: int) -> tuple[int, Address, int, int, int]:
    """Sequence number, sender and message id of the whole frame at `at`; where its payload starts and stops."""
    if buffer[at] == _MAGIC_2:
        _, size, _, _, seq, system, component, low, high = _HEADER.unpack_from(buffer, at)
        start = at + _HEADER_2
        return seq, _address(system, component), low | high << 16, start, start + size
    _, size, seq, system, component, number = buffer[at : at + _HEADER_1]
    start = at + _HEADER_1
    return seq, _address(system, component), number, start, start + size


def _is_checked(buffer: bytes, at: int, length: int, number: int, stop: int) -> bool:
    """Whether the frame's checksum is right.

    An id that is in no dialect of ours cannot be checked: it is believed if a packet, or nothing, follows it.
    """
    crc_extra = CRC_EXTRA.get(number)
    if crc_extra is None:
        end = at + length
        return end == len(buffer) or buffer[end] in (_MAGIC_1, _MAGIC_2)
    crc: int = crc16.mcrf4xx(buffer[at + 1 : stop] + _SEED[crc_extra])
    return crc == buffer[stop] | buffer[stop + 1] << 8


def _read(buffer: bytes, number: int, start: int, stop: int) -> LinkMessage | TextChunk:
    """The message of a frame whose checksum is right; MavlinkError if its payload says something impossible."""
    known = _READERS.get(number)
    if known is None:
        return Unknown(number)
    layout, read = known
    try:
        message: LinkMessage | TextChunk = read(layout.unpack(buffer[start:stop]))
    except ValueError as error:
        raise MavlinkError(f"{layout.name}: {error}") from error
    return message
