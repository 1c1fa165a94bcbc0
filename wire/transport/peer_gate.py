"""Who may speak on the port of one drone: it, and nobody else while it does. Pure; time is an argument."""

from wire.mavlink.framing import FrameCutter

SocketAddress = tuple[str, int]

QUIET_NS = 1_000_000_000


class PeerGate:
    """Judges each datagram by its sender before anything reads it.

    `expected`: the drone's own address, where it is known; None where it chooses. Another sender is taken only while
    nobody better was heard for a second, and only once it speaks MAVLink as the drone `sysid`: a drone that came back
    on another port, or whose answers pass through another address.
    """

    def __init__(self, sysid: int, expected: SocketAddress | None) -> None:
        self.current = expected
        """Whom to answer: the expected address until another was learned; None while nobody is known."""
        self._sysid = sysid
        self._expected = expected
        self._heard_ns: int | None = None

    def refusal(self, sender: SocketAddress, data: bytes, now_ns: int) -> str:
        """Why this datagram is not taken, in words that few refusals share; empty where it is."""
        if sender != self._expected and sender != self.current:
            if self._heard_ns is not None and now_ns - self._heard_ns < QUIET_NS:
                return f"datagram at the port of drone {self._sysid}, from another address"
            if not self._speaks_as_drone(data):
                return f"datagram at the port of drone {self._sysid}, no MAVLink of that system"
        self.current, self._heard_ns = sender, now_ns
        return ""

    def _speaks_as_drone(self, data: bytes) -> bool:
        """By its head first, which nearly every stray fails."""
        system_at = 5 if data[:1] == b"\xfd" else 3
        if len(data) <= system_at or data[0] not in (0xFD, 0xFE) or data[system_at] != self._sysid:
            return False
        return any(frame.source.system == self._sysid for frame in FrameCutter().cut(data))
