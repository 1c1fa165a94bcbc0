"""Little-endian fields of a packet, read in order; nothing beyond its end."""

from struct import Struct

_COUNT, _COUNTS = Struct("<i"), Struct("<ii")
LONGEST_TEXT = 256


class PacketError(ValueError):
    """What came is not NatNet of the version agreed upon. Its text names message and field, and is one of few."""


class Reader:
    """A packet's payload and how far it is read. `message` is what errors call it."""

    __slots__ = ("_at", "_data", "_message")

    def __init__(self, data: bytes, message: str) -> None:
        self._data = data
        self._message = message
        self._at = 0

    @property
    def left(self) -> int:
        """Bytes not read yet."""
        return len(self._data) - self._at

    def fields(self, layout: Struct, what: str) -> tuple[int | float | bytes, ...]:
        """The fields of `layout`."""
        return layout.unpack_from(self._data, self.skip(layout.size, what))

    def integer(self, layout: Struct, what: str) -> int:
        """The one integer of `layout`."""
        number: int = layout.unpack_from(self._data, self.skip(layout.size, what))[0]
        return number

    def skip(self, size: int, what: str) -> int:
        """Leave out `size` bytes; where they begin."""
        at = self._at
        if not 0 <= size <= len(self._data) - at:
            raise self.error(what, "ends beyond the packet")
        self._at = at + size
        return at

    def count(self, least: int, what: str) -> int:
        """How many follow, each of `least` bytes at least."""
        count = self.integer(_COUNT, what)
        if not 0 <= count * least <= self.left:
            raise self.error(what, "more than the packet holds")
        return count

    def rows(self, each: int, what: str) -> tuple[int, int]:
        """A count, and so many of `each` bytes: the count, and where they begin."""
        count = self.count(each, what)
        return count, self.skip(count * each, what)

    def section(self, what: str) -> tuple[int, int, int]:
        """A count, a byte count, and so many bytes: both, and where these begin. In one, for there are many a frame."""
        at = self._at + _COUNTS.size
        left = len(self._data) - at
        if left < 0:
            raise self.error(what, "ends beyond the packet")
        count, size = _COUNTS.unpack_from(self._data, self._at)
        if count < 0 or not 0 <= size <= left:
            raise self.error(what, "more than the packet holds")
        self._at = at + size
        return count, size, at

    def text(self, what: str) -> str:
        """A text that a zero ends, 255 bytes at most."""
        end = self._data.find(b"\0", self._at, self._at + LONGEST_TEXT)
        if end < 0:
            raise self.error(what, "has no end")
        text = self._data[self._at : end].decode("utf-8", "replace")
        self._at = end + 1
        return text

    def whole(self) -> None:
        """PacketError unless everything is read."""
        if self.left:
            raise self.error("length", "longer than its content")

    def error(self, what: str, why: str) -> PacketError:
        """To be raised."""
        return PacketError(f"{self._message}: {what}: {why}")
