"""What one DataStream client wants. Sans-IO."""

import struct

from sim.cameras.servers.vicon import objects

LARGEST_PACKET = 65_536


class ViconConversation:
    """One client's: which kinds of objects it wants, whether they are pushed, and what it has of those that change."""

    def __init__(self) -> None:
        self.wanted: frozenset[int] = frozenset()
        self.streaming = False
        self.requested = 0
        """Frames it has asked for one by one."""
        self.has: object = None
        """The static objects it was sent."""
        self._data = bytearray()

    @property
    def wants_frame(self) -> bool:
        """Whether the next frame is for it."""
        return bool(self.wanted) and (self.streaming or self.requested > 0)

    def received(self, data: bytes) -> bytes:
        """Take the next bytes; what to answer. ValueError for what is no packet of objects."""
        self._data += data
        answers = []
        while len(self._data) >= 8:
            tag, size = struct.unpack_from("<II", self._data)
            if tag != objects.OBJECTS or size > LARGEST_PACKET:
                raise ValueError("not a packet of objects")
            if len(self._data) < 8 + size:
                break
            answers.append(self._packet(bytes(self._data[8 : 8 + size])))
            del self._data[: 8 + size]
        return b"".join(answers)

    def _packet(self, body: bytes) -> bytes:
        answers, at = [], 0
        while at < len(body):
            try:
                kind, size = struct.unpack_from("<II", body, at)
                answers.append(self._object(kind, body[at + 8 : at + 8 + size]))
            except struct.error as error:
                raise ValueError("an object cut short") from error
            at += 8 + size
        return b"".join(answers)

    def _object(self, kind: int, data: bytes) -> bytes:
        if kind == objects.OBJECT_ENUMS:
            n = struct.unpack_from("<I", data)[0]
            if n > len(data) // 4:
                raise ValueError("a set longer than its object")
            self.wanted = frozenset(struct.unpack_from(f"<{n}I", data, 4)) & frozenset(objects.OFFERED)
            self.has = None
        elif kind == objects.REQUEST_FRAME:
            self.streaming = struct.unpack_from("<?", data)[0]
            self.requested = 0 if self.streaming else 1
        elif kind == objects.REQUEST_NEXT_FRAME:
            self.requested += 1
        elif kind == objects.PING:
            return objects.packet([(objects.PING, data[:8])])
        return b""
