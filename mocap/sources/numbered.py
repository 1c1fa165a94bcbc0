"""Bodies that a server lists, and numbered frames of them, as of Qualisys and Vicon: names, losses, latency. Pure."""

from collections import deque

from formation.messages import Severity
from mocap.retiming import LATE, LONGEST_GAP
from mocap.sources.source import Feed, SourceStatus, seconds


class BodyList:
    """Reports to the operator, whenever the server's list changes, which of the lab's bodies are not on it."""

    def __init__(self, lab: tuple[str, ...], feed: Feed) -> None:
        self._lab = lab
        self._feed = feed
        self.bodies: tuple[str, ...] = ()
        """What the server sends, by the names of the lab."""
        self._reported: tuple[str, ...] | None = None

    def receive(self, theirs: tuple[str, ...]) -> tuple[str, ...]:
        """Receive the server's list of names; return the bodies by the names of the lab."""
        self.bodies = tuple(self._feed.name(name) for name in theirs)
        if self.bodies != self._reported:
            self._reported = self.bodies
            self._report()
        return self.bodies

    def _report(self) -> None:
        listed = ", ".join(self.bodies) or "nothing"
        missing = [body for body in self._lab if body not in self.bodies]
        if missing:
            self._feed.report(Severity.WARNING, f"the server does not name {', '.join(missing)}; it names {listed}")
        else:
            self._feed.report(Severity.INFO, f"the server names {listed}")


class NumberedFrames:
    """One source's, over all its connections, whose numbers rise by one a frame, or by more where cameras are faster.

    server: what it is called; lab: the bodies that are expected. latency_ns: of the newest frame.
    """

    def __init__(self, server: str, lab: tuple[str, ...], feed: Feed) -> None:
        self.body_list = BodyList(lab, feed)
        self.latency_ns: int | None = None
        self.lost = 0
        self._server = server
        self._feed = feed
        self._number: int | None = None
        self._seq = 0
        self._steps: deque[int] = deque(maxlen=64)

    def number(self, theirs: int) -> int | None:
        """Our number of the frame that they number so, with gaps for lost frames; None, refused, if it came already.

        A number that goes back, or leaps, stays one: what it means is judged for all sources alike (FrameOrder).
        """
        step = 0 if self._number is None else theirs - self._number
        if self._number is not None and step == 0:
            self._feed.reject("a frame whose number came already")
            return None
        if step > 0:
            self._steps.append(step)
        usual = min(self._steps, default=1)  # the least of the last ones
        frames = round(step / usual)
        if step < 0 and -frames <= LATE:
            return self._seq + min(frames, -1)
        self._number, self._seq = theirs, self._seq + frames
        self.lost += frames - 1 if 0 < frames <= LONGEST_GAP else 0
        return self._seq

    def status(self, connected: bool, uncertainty_ns: int | None, latency_measured: bool) -> SourceStatus:
        """How the source is doing."""
        return SourceStatus(
            self._server,
            connected,
            self.lost,
            seconds(self.latency_ns),
            seconds(uncertainty_ns),
            latency_measured,
            self.body_list.bodies,
        )
