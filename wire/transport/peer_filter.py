"""The source filter of one drone's port: it accepts one sender at a time. Pure; time is an argument."""

from wire.mavlink.framing import FrameCutter

SocketAddress = tuple[str, int]

QUIET_NS = 1_000_000_000


class PeerFilter:
    """Accepts or rejects each datagram by its sender, before anything parses it.

    `expected`: the drone's own address; None where the drone chooses it. The filter accepts another sender only after
    a second without datagrams, and only if it sends MAVLink of system `sysid`. Such a sender is the drone on a new
    port, or behind another address.
    """

    def __init__(self, sysid: int, expected: SocketAddress | None) -> None:
        self.current = expected
        """The address to answer: the expected one, or the newest accepted one; None before the first."""
        self._sysid = sysid
        self._expected = expected
        self._received_ns: int | None = None

    def reject_reason(self, sender: SocketAddress, data: bytes, now_ns: int) -> str:
        """Why the filter rejects this datagram, one of a few texts; empty where it accepts it."""
        if sender != self._expected and sender != self.current:
            if self._received_ns is not None and now_ns - self._received_ns < QUIET_NS:
                return f"datagram at the port of drone {self._sysid}, from another address"
            if not self._speaks_as_drone(data):
                return f"datagram at the port of drone {self._sysid}, no MAVLink of that system"
        self.current, self._received_ns = sender, now_ns
        return ""

    def _speaks_as_drone(self, data: bytes) -> bool:
        """Whether it has a valid MAVLink packet of system `sysid`; the header is checked first, which is cheap."""
        system_at = 5 if data[:1] == b"\xfd" else 3
        if len(data) <= system_at or data[0] not in (0xFD, 0xFE) or data[system_at] != self._sysid:
            return False
        return any(frame.source.system == self._sysid for frame in FrameCutter().cut(data))
