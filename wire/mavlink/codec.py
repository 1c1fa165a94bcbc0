"""The MAVLink codec: bytes to and from the messages of `wire.link_messages`. MAVLink 2 out, 1 and 2 in, never signed.

The invariant: any bytes either read as packets or raise the one error, `MavlinkError`; `Codec.receive` counts
that error and goes on. Bytes out are those of pymavlink, whose tables are used (wire.mavlink.framing).
"""

import struct
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from wire.link_messages import (
    BROADCAST,
    Address,
    LinkMessage,
    MavAutopilot,
    Packet,
    ParamType,
    StatusText,
    TimeSync,
    UnknownMessage,
)
from wire.mavlink.framing import Frame, FrameCutter, Layout, MavlinkError, framed
from wire.mavlink.messages import READERS, TABLE, WRITERS, Read
from wire.mavlink.text import STATUSTEXT, TextChunk, TextJoiner, chunk_text

# What says for whom it is: both numbers of an address, or the system alone.
_ADDRESSED = frozenset(kind for kind in WRITERS if "target" in kind.__match_args__)
_FOR_SYSTEM = frozenset(kind for kind in WRITERS if "target_system" in kind.__match_args__)
_TARGETED = frozenset(each.layout.id for each in TABLE if each.kind in _ADDRESSED | _FOR_SYSTEM)
_REAL32 = struct.Struct("<f")
_BYTEWISE = {
    ParamType.UINT8: struct.Struct("<Bxxx"),
    ParamType.INT8: struct.Struct("<bxxx"),
    ParamType.UINT16: struct.Struct("<Hxx"),
    ParamType.INT16: struct.Struct("<hxx"),
    ParamType.UINT32: struct.Struct("<I"),
    ParamType.INT32: struct.Struct("<i"),
    ParamType.REAL32: _REAL32,
}


def read_message(frame: Frame, readers: Mapping[int, tuple[Layout, Read]] = READERS) -> LinkMessage | TextChunk:
    """The message in a frame, of a long text a chunk; MavlinkError if its payload says something impossible.

    One of an id that none of `readers` reads is Unknown.
    """
    known = readers.get(frame.number)
    if known is None:
        return UnknownMessage(frame.number)
    if frame.message is None:
        layout, read = known
        try:
            frame.message = read(layout.unpack(frame.payload))
        except ValueError as error:
            raise MavlinkError(f"{layout.name}: {error}") from error
    message: LinkMessage | TextChunk = frame.message
    return message


class Codec:
    """One end of one drone's link: its own address, its sequence number, its counters.

    Packets addressed to somebody else are dropped here, so that no reader can forget to; system or component
    zero is everybody. `reads`: the message ids that this end acts on, where it is not all; the others are
    Unknown to it and cost no reading. `stream`: whether data is a byte stream or datagrams, see
    `wire.mavlink.framing.FrameCutter`.
    """

    def __init__(self, own: Address, *, reads: frozenset[int] | None = None, stream: bool = False) -> None:
        self.own = own
        self.unreadable_packets = 0
        self.misaddressed_packets = 0
        self.overheard: Address | None = None
        """To whom the newest of them was addressed."""
        self._cutter = FrameCutter(stream=stream)
        self._readers = READERS if reads is None else {number: READERS[number] for number in reads}
        self._seq = 0
        self._text_id = 0
        self._texts = TextJoiner()

    def encode(self, message: LinkMessage) -> bytes:
        """The bytes of its frames, end to end. Raises MavlinkError as `frames` does."""
        return b"".join([frame.data for frame in self.frames(message)])

    def frames(self, message: LinkMessage) -> list[Frame]:
        """The frame of `message`; several for a long text.

        Raises MavlinkError where MAVLink cannot carry it: a number out of its field's range, a name too long.
        """
        write: Callable[[LinkMessage], tuple[Any, ...]] = WRITERS.get(type(message)) or self._written_text
        frames: list[Frame] = []
        try:
            layout, *several = write(message)
            for fields in several:
                frames.append(framed(layout, fields, self.own, self._seq))  # which may raise, and then takes no number
                self._seq = (self._seq + 1) & 0xFF
            return frames
        except (struct.error, OverflowError, ValueError) as error:  # NaN in the place of an integer, too
            raise MavlinkError(f"{type(message).__name__}: {error}") from error

    def next_seq(self) -> int:
        """Take the sequence number of a packet that was encoded elsewhere."""
        seq = self._seq
        self._seq = (seq + 1) & 0xFF
        return seq

    @property
    def bad_bytes(self) -> int:
        """Bytes that belong to no packet."""
        return self._cutter.dropped_bytes

    @property
    def bad_packets(self) -> int:
        """Packets with a wrong checksum, and those that say something impossible."""
        return self._cutter.bad_frames + self.unreadable_packets

    def receive(self, data: bytes) -> list[Packet]:
        """The packets in `data`, in order; never raises, what cannot be read is skipped and counted."""
        return self.read(self._cutter.cut(data))

    def read(self, frames: Iterable[Frame]) -> list[Packet]:
        """The packets in frames that somebody else has cut, in order, by the same rules."""
        packets: list[Packet] = []
        for frame in frames:
            source, seq = frame.source, frame.seq
            try:
                message = read_message(frame, self._readers)
            except MavlinkError:
                self.unreadable_packets += 1
                continue
            if isinstance(message, TextChunk):
                packets += [Packet(source, seq, text) for text in self._texts.join(source, message)]
            elif frame.number not in _TARGETED or self._is_ours(message):
                packets.append(Packet(source, seq, message))
            else:
                self.misaddressed_packets += 1
                self.overheard = getattr(message, "target", None)
        return packets

    def _is_ours(self, message: Any) -> bool:
        own, kind = self.own, type(message)
        if kind is TimeSync and message.tc1_ns:
            return True  # an answer is known by what it repeats: PX4 1.16 leaves its target to chance
        if kind in _ADDRESSED:
            target: Address = message.target
            return target.system in (BROADCAST, own.system) and target.component in (BROADCAST, own.component)
        return kind not in _FOR_SYSTEM or message.target_system in (BROADCAST, own.system)

    def _written_text(self, message: LinkMessage) -> tuple[Any, ...]:
        """What has no row of its own: the chunks of a text, numbered."""
        if not isinstance(message, StatusText):
            raise MavlinkError("it has no bytes of its own")
        self._text_id = self._text_id % 0xFFFF + 1
        return STATUSTEXT, *chunk_text(message, self._text_id)


def param_to_raw(value: float, kind: ParamType, autopilot: MavAutopilot) -> bytes:
    """The four bytes that carry `value`; MavlinkError if the type cannot hold it.

    PX4 (and every autopilot but ArduPilot): the integer's own bytes. ArduPilot: the number as a float.
    """
    form = _form(kind, autopilot)
    try:
        return form.pack(value if form is _REAL32 else _whole(value))
    except (struct.error, OverflowError) as error:
        raise MavlinkError(f"{value} does not fit a parameter of type {kind.name}: {error}") from error


def param_from_raw(raw: bytes, kind: ParamType, autopilot: MavAutopilot) -> int | float:
    """The value in `raw` (four bytes): an int for integer types, else a float; MavlinkError if there is none."""
    value: int | float = _form(kind, autopilot).unpack(raw)[0]
    return value if kind is ParamType.REAL32 else _whole(value)


def _form(kind: ParamType, autopilot: MavAutopilot) -> struct.Struct:
    if kind not in _BYTEWISE:
        raise MavlinkError(f"a parameter of type {kind.name} does not fit MAVLink's four bytes")
    return _REAL32 if autopilot is MavAutopilot.ARDUPILOT else _BYTEWISE[kind]


def _whole(value: float) -> int:
    try:
        whole = int(value)
    except (ValueError, OverflowError) as error:
        raise MavlinkError(f"{value} is no integer") from error
    if whole != value:
        raise MavlinkError(f"{value} is no integer")
    return whole
