"""A NatNet server without its sockets: requests in, answers out; exposures in, frames out; its own clock. Pure."""

from dataclasses import dataclass, field
from struct import pack, unpack_from

from formation.messages import RawFrame
from sim.cameras.servers.natnet import encode
from sim.cameras.servers.natnet.encode import Stamps, Version

Address = tuple[str, int]
CONNECT, REQUEST, REQUEST_MODELS, DISCONNECT, KEEP_ALIVE, ECHO_REQUEST, DISCOVERY = 0, 2, 4, 9, 10, 12, 14
HEADER = 4
CLIENT_NS = 10_000_000_000
"""So long a unicast client is served after its last word."""
CLIENTS = 16
TRACKED_MODELS_CHANGED = 0x02
READOUT_NS = 2_000_000
"""From the middle of the exposure until Motive has the cameras' data."""


@dataclass(frozen=True, slots=True)
class NatNetSettings:
    """What differs between one Motive and another.

    clock_hz, clock_s: the high-resolution clock's ticks a second, and what it shows more than ours. stamps: whether
    the cameras report the exposure time (Ethernet cameras do, USB cameras do not).
    """

    version: Version = (4, 1)
    clock_hz: int = 10_000_000
    clock_s: float = 7_200.0
    stamps: bool = True
    rate_hz: float = 100.0


@dataclass(slots=True)
class Responder:
    """One server. group: None for unicast. Bodies go by Motive's names."""

    settings: NatNetSettings
    data_port: int
    group: str | None
    unit_m: float = 1.0
    clients: dict[Address, int] = field(default_factory=dict)
    """Of unicast: when each was last heard."""
    clock_step_ns: int = 0
    """How much the clock was set since the start."""
    ids: dict[str, int] = field(default_factory=dict)
    """Of each body."""
    _last_id: int = 0
    changed: bool = False
    """Whether the next frame says that the models changed."""
    _t0_ns: int | None = None

    def ticks(self, t_ns: int) -> int:
        """The server's clock when ours shows t_ns."""
        shown_ns = t_ns + round(self.settings.clock_s * 1e9) + self.clock_step_ns
        return shown_ns * self.settings.clock_hz // 1_000_000_000

    def show(self, bodies: tuple[str, ...]) -> None:
        """The models are these now. One in another's place is that one renamed: it keeps the id."""
        if bodies == tuple(self.ids):
            return
        self.changed = bool(self.ids)
        if len(bodies) == len(self.ids):
            self.ids = dict(zip(bodies, self.ids.values(), strict=True))
            return
        known = self.ids
        self.ids = {}
        for name in bodies:
            if name not in known:
                self._last_id += 1
            self.ids[name] = known.get(name, self._last_id)

    def received(self, data: bytes, sender: Address, now_ns: int) -> list[bytes]:
        """A client's packet; what to answer it."""
        if len(data) < HEADER:
            return []
        kind, payload = int.from_bytes(data[:2], "little"), data[HEADER:]
        settings = self.settings
        match kind:
            case 0 | 14:
                if kind == CONNECT and self.group is None and (sender in self.clients or len(self.clients) < CLIENTS):
                    self.clients[sender] = now_ns
                info = encode.server_info("Motive", settings.version, settings.clock_hz, self.data_port, self.group)
                return [info]
            case 4:
                return [encode.models({number: name for name, number in self.ids.items()}, settings.version)]
            case 12 if len(payload) == 8:
                (theirs,) = unpack_from("<Q", payload)
                return [encode.message(encode.ECHO_RESPONSE, pack("<QQ", theirs, self.ticks(now_ns)))]
            case 2:
                return [self._answer(payload.partition(b"\0")[0])]
            case 10 if sender in self.clients:
                self.clients[sender] = now_ns
            case 9:
                self.clients.pop(sender, None)
        return []

    def frame(self, raw: RawFrame, now_ns: int) -> bytes:
        """The packet of an exposure, sent now."""
        self.show(raw.bodies)
        exposed_ns = raw.t_capture_ns or now_ns
        if self._t0_ns is None:
            self._t0_ns = exposed_ns
        stamps = Stamps(
            (exposed_ns - self._t0_ns) * 1e-9,
            self.ticks(exposed_ns) if self.settings.stamps else 0,
            self.ticks(min(exposed_ns + READOUT_NS, now_ns)) if self.settings.stamps else 0,
            self.ticks(now_ns),
        )
        params = TRACKED_MODELS_CHANGED if self.changed else 0
        self.changed = False
        bodies = encode.rows(raw, list(self.ids.values()), self.unit_m)
        return encode.frame(raw.seq & 0x7FFFFFFF, bodies, list(self.ids), stamps, params, self.settings.version)

    def listeners(self, now_ns: int) -> list[Address]:
        """Where frames go: the group, or who connected and is alive."""
        if self.group is not None:
            return [(self.group, self.data_port)]
        for client in [each for each, received_ns in self.clients.items() if now_ns - received_ns > CLIENT_NS]:
            del self.clients[client]
        return list(self.clients)

    def _answer(self, request: bytes) -> bytes:
        if request == b"FrameRate":
            return encode.message(encode.RESPONSE, pack("<f", self.settings.rate_hz))
        if request == b"Bitstream" and self.settings.version >= (4, 0):
            major, minor = self.settings.version
            return encode.message(encode.RESPONSE, f"Bitstream,{major}.{minor}.0\0".encode())
        return encode.message(encode.UNRECOGNIZED, b"")
