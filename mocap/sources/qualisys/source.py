"""Qualisys Track Manager as a source: its frames with names, numbers and capture times."""

from formation.mocap_config import QualisysConfig
from mocap.capture_time import CaptureTime
from mocap.sources.numbered import NumberedFrames
from mocap.sources.poses import from_matrices
from mocap.sources.qualisys.packets import SixD
from mocap.sources.qualisys.session import QualisysSession
from mocap.sources.source import Feed, SourceStatus
from mocap.sources.tcp import TcpClient

NS_PER_US = 1000


class Qualisys:
    """One QTM's client. lab: the bodies that are expected; latency_ns: from exposure to receipt, which QTM keeps."""

    def __init__(self, config: QualisysConfig, lab: tuple[str, ...], latency_ns: int, feed: Feed) -> None:
        self._feed = feed
        self._frames = NumberedFrames(f"QTM at {config.host}:{config.port}", lab, feed)
        self._time = CaptureTime(latency_ns)
        self._client = TcpClient(config.host, config.port, self, feed)

    async def run(self) -> None:
        """Take frames until cancelled."""
        await self._client.run()

    def status(self) -> SourceStatus:
        """How it is doing."""
        now_ns = self._feed.clock.monotonic_ns()
        return self._frames.status(self._client.connected, self._time.uncertainty_ns(now_ns), latency_measured=False)

    def open(self, now_ns: int, _ours: str, _theirs: str) -> tuple[QualisysSession, bytes]:
        """A new connection's session; QTM speaks first."""
        return QualisysSession(self._receive, self._frames.name, self._feed, now_ns), b""

    def _receive(self, frame: SixD, now_ns: int) -> None:
        seq = self._frames.number(frame.number)
        if seq is None:
            return
        t_capture_ns = self._time.capture_ns(frame.stamp_us * NS_PER_US, now_ns)
        self._frames.note_exposed(t_capture_ns, now_ns)
        placed = from_matrices(frame.rows, by_columns=True, unit_m=self._feed.unit_m, lost_is_nan=True)
        self._feed.frame(seq, t_capture_ns, self._frames.bodies, *placed)
