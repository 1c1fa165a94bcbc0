"""Numbered frames of bodies that the server lists, as of Qualisys and Vicon: what is known of those so far."""

from mocap.sources.body_list import BodyList
from mocap.sources.frame_count import FrameCount
from mocap.sources.source import Feed, SourceStatus, seconds


class NumberedFrames:
    """One source's, over all its connections. server: what it is called; lab: the bodies that are expected."""

    def __init__(self, server: str, lab: tuple[str, ...], feed: Feed) -> None:
        self._server = server
        self._feed = feed
        self._body_list = BodyList(lab, feed)
        self._count = FrameCount()
        self._latency_ns: int | None = None

    @property
    def bodies(self) -> tuple[str, ...]:
        """What the server sends, by the names of the lab."""
        return self._body_list.bodies

    def name(self, theirs: tuple[str, ...]) -> None:
        """The server's list has come."""
        self._body_list.receive(theirs)

    def number(self, theirs: int) -> int | None:
        """Our number of the frame that they number so; None, refused, if it came already."""
        seq = self._count.receive(theirs)
        if seq is None:
            self._feed.reject("a frame whose number came already")
        return seq

    def note_exposed(self, t_capture_ns: int, now_ns: int) -> None:
        """The newest frame."""
        self._latency_ns = now_ns - t_capture_ns

    def status(self, connected: bool, uncertainty_ns: int | None, latency_measured: bool) -> SourceStatus:
        """How the source is doing."""
        return SourceStatus(
            self._server,
            connected,
            self._count.lost,
            seconds(self._latency_ns),
            seconds(uncertainty_ns),
            latency_measured,
            self.bodies,
        )
