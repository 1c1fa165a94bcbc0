"""A DataStream server: it says what it has, hears what is wanted, and pushes frames or gives them one by one."""

from collections import deque

from formation.messages import RawFrame
from formation.mocap_config import MocapConfig, ViconConfig
from sim.cameras.servers.server import Server
from sim.cameras.servers.server_clock import ServerClock
from sim.cameras.servers.tcp import TcpPort
from sim.cameras.servers.vicon import objects
from sim.cameras.servers.vicon.conversation import ViconConversation
from sim.cameras.servers.vicon.objects import Block
from wire.clock import Clock

REMEMBERED = 200
FIRST_FRAME = 1000
"""Real servers count since the cameras were started, not since anybody connected."""
EXPOSURE_SHARE = 0.4
"""Of the latency, in the cameras; the rest is the program's."""


def vicon_server(config: MocapConfig, bodies: tuple[str, ...], clock: Clock) -> Server:
    """Where the lab file's client looks for it."""
    vicon = config.vicon or ViconConfig()
    return ViconServer(vicon.host, vicon.port, bodies, config.rate_hz, clock)


class ViconServer:
    """Frames are numbered by its own clock's frame periods, so that one that is not published leaves a gap."""

    def __init__(self, host: str, port: int, bodies: tuple[str, ...], rate_hz: float, clock: Clock) -> None:
        self._bodies = bodies
        self._rate_hz = rate_hz
        self._clock = clock
        self._time = ServerClock()
        self._number = 0
        self._ages_ns: deque[int] = deque(maxlen=REMEMBERED)
        hello = objects.packet([(objects.OBJECT_ENUMS, objects.kinds(objects.OFFERED))])
        self._port = TcpPort(host, port, lambda _: (ViconConversation(), hello))

    async def start(self) -> None:
        """Listen, frames counted anew; OSError where the address is taken."""
        self._time, self._number = ServerClock(), 0
        self._ages_ns.clear()
        await self._port.start()

    def publish(self, frame: RawFrame) -> None:
        """One exposure to every client that streams or has asked for a frame."""
        self._bodies = frame.bodies
        periods = round(self._time.at_ns(frame.t_capture_ns) * self._rate_hz * 1e-9)
        self._number = max(self._number + 1, FIRST_FRAME + periods)
        # What the program takes of itself; what comes on top now and then is not known to it.
        self._ages_ns.append(max(self._clock.monotonic_ns() - frame.t_capture_ns, 0))
        latency_s = 1e-9 * min(self._ages_ns)
        latencies_s = {"Exposure": EXPOSURE_SHARE * latency_s, "Processing": (1.0 - EXPOSURE_SHARE) * latency_s}
        if any(client.wants_frame for client in self._port.conversations()):
            dynamic = objects.dynamic_objects(self._number, self._rate_hz, latencies_s, frame)
            made: dict[tuple[frozenset[int], bool], bytes] = {}
            self._port.send(lambda to: self._frame_for(to, dynamic, made))

    async def close(self) -> None:
        """End every connection and listen no more."""
        await self._port.close()

    def _frame_for(
        self, to: ViconConversation, dynamic: list[Block], made: dict[tuple[frozenset[int], bool], bytes]
    ) -> bytes:
        if not to.wants_frame:
            return b""
        to.requested = max(to.requested - 1, 0)
        knows, to.has = to.has == self._bodies, self._bodies
        key = to.wanted, knows
        if key not in made:
            made[key] = self._packet(to.wanted, knows, dynamic)
        return made[key]

    def _packet(self, wanted: frozenset[int], knows: bool, dynamic: list[Block]) -> bytes:
        static = [] if knows else objects.static_objects(self._bodies, self._rate_hz)
        blocks = [block for block in (*static, *dynamic) if block[0] in wanted]
        if objects.CONTENTS in wanted:
            unchanged = wanted.intersection(objects.STATIC) if knows else ()
            blocks.insert(0, objects.contents(blocks, unchanged))
        return objects.packet(blocks)
