"""MocapCore, the mocap process without its inputs and outputs: raw frames in, aligned and checked frames out.

The one door through which poses come to everyone: ground, agents, bridges and tools. Sans-IO, time an argument.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from formation.config import LabConfig
from formation.maths.frames import IDENTITY
from formation.messages import Event, LabFrame, RawFrame, Rejection, Severity
from formation.mocap_config import BODY_BY_BODY
from mocap.alignment import Alignment
from mocap.retiming import LONGEST_GAP, Retiming
from mocap.sources import poses
from mocap.validator import PoseValidator
from wire.rejections import RejectionLog
from wire.transport.frame_check import OLDEST_NS, raw_fault

TURNS, TWO_SHARE = 50, 0.2
"""Over so many frames, numbers that go back in this share are two publishers'."""
UNNUMBERED = (*BODY_BY_BODY, "csv")
"""Sources without numbers of their own: ours follow from the stamps."""
SOURCE = "mocap"


class MocapCore:
    """The mocap process of one lab, without inputs and outputs.

    reject_log: counts rejected frames; a new one by default.
    without: checks of the pose validator to switch off (mocap.validator.NAMES).
    """

    def __init__(
        self, config: LabConfig, reject_log: RejectionLog | None = None, without: frozenset[str] = frozenset()
    ) -> None:
        self.reject_log = reject_log or RejectionLog()
        self.frames = 0
        self.unknown: Counter[str] = Counter()
        self._alignment = Alignment(config)
        self._validator = PoseValidator(config, without)
        self._retiming = Retiming(config.mocap.source not in UNNUMBERED)
        self._is_retimed = False
        self._delay_ns = round(config.mocap.delay_s * 1e9)
        self._raw_seq: int | None = None
        self._seq = -1
        self._newest_ns: int | None = None
        self._named: tuple[str, ...] = ()
        self._events: list[Event] = []
        self._received: tuple[int, int] | None = None
        self._turning_back = 0.0
        """How many of the last frames' numbers went back: those of two publishers take turns."""
        self._is_interleaved = False

    def receive(self, raw: RawFrame, now_ns: int) -> LabFrame | None:
        """The frame for the bus, or None for a rejected frame. A rejected pose makes its body unseen."""
        is_stamped = raw.t_capture_ns != 0
        fault = raw_fault(raw, now_ns, OLDEST_NS)
        if fault is not None:
            self.reject_log.note(SOURCE, f"frame {fault}", now_ns)
            return None
        self._note_names(raw.bodies)
        self._note_turn(raw)
        stamp_ns = raw.t_capture_ns if is_stamped else now_ns - self._delay_ns
        t_capture_ns = self._retiming.capture_ns(raw.seq, stamp_ns, is_stamped)
        if t_capture_ns is None:
            self._reject_order("out of order", now_ns)
            return None
        if self._retiming.restarted:
            text = f"frame numbers begin anew, {raw.seq} after {self._raw_seq}: the cameras were started again"
            self._events.append(Event(Severity.WARNING, SOURCE, text))
        frame = self._alignment.align(raw, raw.seq, t_capture_ns, now_ns)
        is_known = is_stamped or self._retiming.scatter_ns is not None
        stamp_rejected = is_known and self._validator.rejects_stamp(t_capture_ns, now_ns)
        if not stamp_rejected and self._newest_ns is not None and t_capture_ns <= self._newest_ns:
            self._reject_order("whose capture time does not advance", now_ns)
            return None
        for body, code in zip(frame.bodies, frame.rejected.tolist(), strict=True):
            if code:
                self.reject_log.note(SOURCE, f"{body}: {Rejection(code).text}", now_ns)
        if stamp_rejected:
            frame = self._validator.without_poses(frame, (self._newest_ns or 0) + 1, now_ns)
        else:
            frame = self._validator.judge(frame, now_ns)
        self._newest_ns = min(frame.t_capture_ns, now_ns)  # the cameras' clock may be ahead of ours
        self.frames += 1
        return replace(frame, seq=self._number(raw.seq), t_capture_ns=self._newest_ns)

    def note_motors(self, on: Mapping[str, bool]) -> None:
        """Which drones have their motors on, by body, whenever the ground says so of some."""
        self._validator.note_motors(on)

    def events(self, now_ns: int) -> tuple[Event, ...]:
        """Events that are due: poses rejected, or accepted again; names given twice; frames that are re-timed."""
        named, self._events = self._events, []
        return (*named, *self._validator.events(now_ns), *self._newly_retimed())

    @property
    def retimed_scatter_s(self) -> float | None:
        """The residual scatter of re-timed capture times; None where the source's stamps are used as they are."""
        scatter_ns = self._retiming.scatter_ns
        return None if scatter_ns is None else scatter_ns * 1e-9

    def rejections(self) -> dict[str, dict[str, int]]:
        """Poses rejected since the start, by body and reason."""
        return self._validator.counts()

    def _newly_retimed(self) -> tuple[Event, ...]:
        scatter_s, was_retimed = self.retimed_scatter_s, self._is_retimed
        self._is_retimed = scatter_s is not None
        if scatter_s is None or was_retimed:
            return ()
        text = f"stamps are arrival times: frames are re-timed, with a scatter of {1e3 * scatter_s:.2f} ms"
        return (Event(Severity.WARNING, SOURCE, text),)

    def _reject_order(self, fault: str, now_ns: int) -> None:
        if self._is_interleaved:  # which was said
            self.reject_log.count += 1
        else:
            self.reject_log.note(SOURCE, f"frame {fault}", now_ns)

    def _note_names(self, bodies: tuple[str, ...]) -> None:
        """Remember bodies that are none of the lab's; report, once, those of the lab's that are named twice."""
        if bodies == self._named:
            return
        before, self._named, known, count = Counter(self._named), bodies, set(self._alignment.bodies), Counter(bodies)
        for body in self._alignment.bodies:
            if count[body] > 1 and before[body] <= 1:
                text = f"{body} is named {count[body]} times by the source, so it has no one pose: left out, rename one"
                self._events.append(Event(Severity.ERROR, SOURCE, text))
        for body in count.keys() - known:
            if len(self.unknown) < 16:  # to be named
                self.unknown[body[:64]] += 1

    def _note_turn(self, raw: RawFrame) -> None:
        """Report, once, frames of two publishers; a second copy of a frame is none."""
        newest, self._received = self._received, (raw.seq, raw.t_capture_ns)
        if newest is None or newest == self._received:
            return
        self._turning_back += 1.0 / TURNS * (float(raw.seq <= newest[0]) - self._turning_back)
        if self._turning_back > TWO_SHARE and not self._is_interleaved:
            text = f"two publishers of frames: numbers {newest[0]} and {raw.seq} take turns; end one of them"
            self._events.append(Event(Severity.ERROR, SOURCE, text))
        self._is_interleaved = self._turning_back > (0.1 * TWO_SHARE if self._is_interleaved else TWO_SHARE)

    def _number(self, raw_seq: int) -> int:
        """Ours go on where the source starts again; a gap stays the gap it was."""
        step = 1 if self._raw_seq is None else raw_seq - self._raw_seq
        self._raw_seq = raw_seq
        self._seq += step if 0 < step <= LONGEST_GAP else 1
        return self._seq


QUATERNIONS = {"vrpn": np.float64, "chingmu": np.float64, "nokov": np.float64, "ros2": np.float64, "natnet": np.float32}
MATRICES = {"qualisys": np.float32, "vicon": np.float64}
"""The numbers that each source sends, and as what."""


def warm_up(config: LabConfig) -> None:
    """Read and align one frame that nobody sees."""
    bodies = tuple(v.body for v in config.vehicles)
    n = len(bodies)
    frame = RawFrame(0, 0, bodies, np.zeros((n, 3)), np.tile(IDENTITY, (n, 1)), np.ones(n, np.bool_))
    MocapCore(config).receive(frame, 1)
    warm_up_source(config.mocap.source)


def warm_up_source(source: str) -> None:
    """Read one body as the source's client does, where it has poses to convert."""
    if source in QUATERNIONS:
        poses.from_quaternions(np.zeros((1, 7), QUATERNIONS[source]), 1.0)
    elif source in MATRICES:
        poses.from_matrices(np.zeros((1, 12), MATRICES[source]), by_columns=True, unit_m=1.0, lost_is_nan=True)
