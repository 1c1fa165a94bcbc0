"""Cuts a stream of bytes into whole MAVLink frames and leaves them as they are, for who passes them on.

`wire.mavlink.Codec` reads what packets say; this only finds where they begin and end.
"""

from fastcrc import crc16

from wire.mavlink_layout import CRC_EXTRA

_MAGIC_1, _MAGIC_2 = 0xFE, 0xFD
_MAGICS = (_MAGIC_1, _MAGIC_2)
_SIGNED = 0x01
_LONGEST = 280


class FrameCutter:
    """One direction of one link. Bytes between frames, and frames whose checksum is wrong, are counted and dropped."""

    def __init__(self) -> None:
        self.dropped_bytes = 0
        self._held = b""

    def cut(self, data: bytes) -> list[bytes]:
        """The frames that `data` completes, in order; never raises."""
        buffer = self._held + data
        frames: list[bytes] = []
        at = 0
        while at < len(buffer):
            length = _length(buffer, at)
            if length > len(buffer) - at:
                break
            follower = buffer[at + length : at + length + 1]
            if length and _is_whole(buffer[at : at + length], follower):
                frames.append(buffer[at : at + length])
                at += length
            else:
                at += 1
                self.dropped_bytes += 1
        self._held = buffer[at:]
        return frames


def message_id(frame: bytes) -> int:
    """The message a whole frame carries."""
    return int.from_bytes(frame[7:10], "little") if frame[0] == _MAGIC_2 else frame[5]


def _length(buffer: bytes, at: int) -> int:
    """Length of the frame that may begin at `at`: 0 if none does, more than is there while its header is not."""
    if buffer[at] not in _MAGICS:
        return 0
    if len(buffer) - at < 3:
        return _LONGEST
    size, flags = buffer[at + 1], buffer[at + 2]
    if buffer[at] == _MAGIC_1:
        return 6 + size + 2
    return 0 if flags & ~_SIGNED else 10 + size + 2 + (13 if flags else 0)


def _is_whole(frame: bytes, follower: bytes) -> bool:
    """Whether the checksum is right.

    A message that is in no dialect of ours cannot be checked: it is believed if a frame, or nothing, follows it.
    """
    seed = CRC_EXTRA.get(message_id(frame))
    if seed is None:
        return not follower or follower[0] in _MAGICS
    end = (10 if frame[0] == _MAGIC_2 else 6) + frame[1]
    return crc16.mcrf4xx(frame[1:end] + bytes((seed,))) == int.from_bytes(frame[end : end + 2], "little")
