"""Numbered frames of bodies that the server lists, as of Qualisys and Vicon: losses by number, names, latency. Pure."""

from collections import deque
from dataclasses import dataclass, field

from formation.messages import Severity
from mocap.retiming import LATE, LONGEST_GAP
from mocap.sources.source import Feed, SourceStatus, seconds

REMEMBERED = 64


@dataclass(slots=True)
class FrameCount:
    """Numbers that rise by one a frame, or by more where the cameras are faster than what is sent."""

    lost: int = 0
    _number: int | None = None
    _seq: int = 0
    _steps: deque[int] = field(default_factory=lambda: deque(maxlen=REMEMBERED))

    def receive(self, number: int) -> int | None:
        """Our number of the frame with the server's `number`, with gaps for lost frames; None for a repeated frame.

        A number that goes back, or leaps, stays one: what it means is judged for all sources alike (FrameOrder).
        """
        step = 0 if self._number is None else number - self._number
        if self._number is not None and step == 0:
            return None
        if step > 0:
            self._steps.append(step)
        usual = min(self._steps, default=1)  # the least of the last ones
        frames = round(step / usual)
        if step < 0 and -frames <= LATE:
            return self._seq + min(frames, -1)
        self._number, self._seq = number, self._seq + frames
        self.lost += frames - 1 if 0 < frames <= LONGEST_GAP else 0
        return self._seq


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
