"""The MAVLink codec: bytes to and from the messages of `wire.link_messages`. MAVLink 2 out, 1 and 2 in, never signed.

The invariant: any bytes either read as packets or raise the one error, `MavlinkError`; `Codec.receive` counts
that error and goes on. Bytes out are those of pymavlink, whose tables are used (wire.mavlink.framing).
"""

import struct
from collections.abc import Callable, Mapping
from typing import Any

from wire.link_messages import (
    BROADCAST,
    Address,
    AttitudeSetpoint,
    CommandAck,
    CommandInt,
    CommandLong,
    LinkMessage,
    LogRequestList,
    MissionCount,
    MissionRequestList,
    Packet,
    ParamRequestList,
    ParamRequestRead,
    ParamSet,
    Ping,
    PositionSetpoint,
    SetMode,
    SetOrigin,
    StatusText,
    TimeSync,
    Unknown,
)
from wire.mavlink import guidance as mavlink_guidance
from wire.mavlink import motion as mavlink_motion
from wire.mavlink import service as mavlink_service
from wire.mavlink import storage as mavlink_storage
from wire.mavlink.framing import Fields, Frame, FrameCutter, Layout, MavlinkError, framed, whole_frame
from wire.mavlink.params import param_from_raw, param_to_raw
from wire.mavlink.text import STATUSTEXT, TextChunk, TextJoiner, chunk_text, text_of

__all__ = ["Codec", "MavlinkError", "decode_packet", "param_from_raw", "param_to_raw"]

_GROUPS = (mavlink_motion, mavlink_service, mavlink_guidance, mavlink_storage)
_WRITERS = {kind: write for group in _GROUPS for kind, write in group.WRITERS.items()}
Reader = Callable[[Fields], Any]
_READERS: dict[int, tuple[Layout, Reader]] = {
    layout.id: (layout, read) for group in _GROUPS for layout, read in group.READERS.items()
}
# What says for whom it is: both numbers of an address, or the system alone.
_ADDRESSED = frozenset(
    {AttitudeSetpoint, PositionSetpoint, CommandLong, CommandInt, CommandAck, TimeSync, Ping, ParamSet,
     ParamRequestRead, ParamRequestList, MissionRequestList, MissionCount, LogRequestList}
)  # fmt: skip
_FOR_SYSTEM = frozenset({SetMode, SetOrigin})


def read_frame(frame: Frame) -> Packet:
    """What a frame says; a chunk of a long text reads as a text of its own. Raises MavlinkError.

    A packet of an id that nothing here reads is Unknown.
    """
    message = _read(frame, _READERS)
    if isinstance(message, TextChunk):
        message = text_of(message.severity, [message.part])
    return Packet(frame.source, frame.seq, message)


def decode_packet(data: bytes) -> Packet:
    """The packet that `data` is, whole and alone, as `read_frame` reads it. Raises MavlinkError."""
    frame = whole_frame(data)
    if frame is None:
        raise MavlinkError("not one whole MAVLink packet with its checksum")
    return read_frame(frame)


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
        self._readers = _READERS if reads is None else {number: _READERS[number] for number in reads}
        self._seq = 0
        self._text_id = 0
        self._texts = TextJoiner()

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
        packets: list[Packet] = []
        for frame in self._cutter.cut(data):
            source, seq = frame.source, frame.seq
            try:
                message = _read(frame, self._readers)
            except MavlinkError:
                self.unreadable_packets += 1
                continue
            if isinstance(message, TextChunk):
                packets += [Packet(source, seq, text) for text in self._texts.join(source, message)]
            elif self._is_ours(message):
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

    def _frame(self, layout: Layout, fields: Fields) -> bytes:
        data = framed(layout, layout.pack(fields), self.own, self._seq)  # which may raise, and then takes no number
        self._seq = (self._seq + 1) & 0xFF
        return data


def _read(frame: Frame, readers: Mapping[int, tuple[Layout, Reader]]) -> LinkMessage | TextChunk:
    """The message of a frame; MavlinkError if its payload says something impossible."""
    known = readers.get(frame.number)
    if known is None:
        return Unknown(frame.number)
    layout, read = known
    try:
        message: LinkMessage | TextChunk = read(layout.unpack(frame.payload))
    except ValueError as error:
        raise MavlinkError(f"{layout.name}: {error}") from error
    return message
