"""A Vicon DataStream server as a source: its frames with names, numbers and capture times."""

from formation.mocap_config import ViconConfig
from mocap.capture_time import CaptureTime
from mocap.sources.numbered import NumberedFrames
from mocap.sources.poses import from_matrices
from mocap.sources.source import Feed, SourceStatus
from mocap.sources.tcp import TcpClient
from mocap.sources.vicon.packets import TICKS_HZ
from mocap.sources.vicon.session import ViconFrame, ViconSession


class Vicon:
    """One server's client. lab: the bodies that are expected; latency_ns: where the server does not report its own.

    The exposures' times are those of a clock that counts frame periods; the latency the server reports with a frame is
    taken off its arrival first, so that what is left is the network's.
    """

    def __init__(self, config: ViconConfig, lab: tuple[str, ...], latency_ns: int, feed: Feed) -> None:
        self._latency_ns = latency_ns
        self._feed = feed
        self._frames = NumberedFrames(f"Vicon at {config.host}:{config.port}", lab, feed)
        self._period: int | None = None
        self._time = CaptureTime(0)
        self._sent_ns = 0
        self._latency_measured = False
        self._client = TcpClient(config.host, config.port, self, feed)

    async def run(self) -> None:
        """Take frames until cancelled."""
        await self._client.run()

    def status(self) -> SourceStatus:
        """How it is doing."""
        return self._frames.status(
            self._client.connected, self._time.uncertainty_ns(self._sent_ns), self._latency_measured
        )

    def open(self, now_ns: int, _ours: str, _theirs: str) -> tuple[ViconSession, bytes]:
        """A new connection's session; the server speaks first."""
        return ViconSession(self._receive, self._frames.name, self._feed, now_ns), b""

    def _receive(self, frame: ViconFrame, now_ns: int) -> None:
        seq = self._frames.number(frame.number)
        if seq is None:
            return
        t_capture_ns = self._capture_ns(frame, now_ns)
        placed = from_matrices(frame.rows, by_columns=False, unit_m=self._feed.unit_m, lost_is_nan=False)
        self._feed.frame(seq, t_capture_ns, self._frames.bodies, *placed)

    def _capture_ns(self, frame: ViconFrame, now_ns: int) -> int:
        """0, for a frame without a stamp, as long as the frame period is not known."""
        if frame.period is None:
            return 0
        if frame.period != self._period:
            self._period, self._time = frame.period, CaptureTime(0)
        self._latency_measured = frame.latency_s is not None
        latency_ns = self._latency_ns if frame.latency_s is None else round(1e9 * frame.latency_s)
        # Frames come in order: a latency that leaps must not turn it round.
        self._sent_ns = max(self._sent_ns, now_ns - latency_ns)
        stamp_ns = frame.number * frame.period * 1_000_000_000 // TICKS_HZ
        t_capture_ns = self._time.capture_ns(stamp_ns, self._sent_ns)
        self._frames.note_exposed(t_capture_ns, now_ns)
        return t_capture_ns
