"""The pose validator of one lab: capture times held against arrivals, every pose against what its body can do."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from formation.config import LabConfig
from formation.maths import frames
from formation.maths.records import blank
from formation.messages import Event, LabFrame
from formation.rejection import Rejection
from mocap.validator.bounds import bounds
from mocap.validator.checks import EARLY_NS, LATE_NS, name_of, watched
from mocap.validator.episodes import Episodes
from mocap.validator.judge import Criteria, Frame, Memory, judge
from wire.clock_offset import LeastDelay
from wire.transport.frame_check import AHEAD_NS

SETTLED_FRAMES = 50
RELEARN_FRAMES = 50


@dataclass(slots=True)
class StampWatch:
    """One source's least delay, from exposure to arrival."""

    _least: LeastDelay = field(default_factory=LeastDelay)
    _frames: int = 0
    _rejected: int = 0

    def rejects(self, t_capture_ns: int, now_ns: int, in_flight: bool) -> bool:
        """Whether the stamp is rejected. A lasting new delay is accepted while no drone flies."""
        delay_ns = now_ns - t_capture_ns
        least_ns = self._least.at_ns(now_ns)
        settled = least_ns is not None and self._frames >= SETTLED_FRAMES
        if delay_ns >= -AHEAD_NS and settled and least_ns is not None:
            wrong = not -EARLY_NS <= delay_ns - least_ns <= LATE_NS
            if wrong and not in_flight and self._rejected >= RELEARN_FRAMES:
                self._least, self._frames, wrong = LeastDelay(), 0, False
        else:
            wrong = delay_ns < -AHEAD_NS
        if wrong:
            self._rejected += 1
            return True
        self._least.offer(delay_ns, now_ns)
        self._frames, self._rejected = self._frames + 1, 0
        return False

    def why(self, t_capture_ns: int, now_ns: int) -> str:
        """What is wrong with a rejected stamp, in words."""
        usual_ms, ms = 1e-6 * (self._least.at_ns(now_ns) or 0), 1e-6 * (now_ns - t_capture_ns)
        if ms > usual_ms:
            what = "the network or a busy computer holds frames back, or the cameras' clock was set"
            return f"its frames come {ms:.0f} ms after their exposure, not {usual_ms:.0f}: {what}"
        return f"its frames are stamped {usual_ms - ms:.0f} ms too late: the cameras' clock was set"

    def likely_ns(self, now_ns: int) -> int:
        """When what arrives now was captured, if it took as long as the quickest did."""
        return now_ns - max(self._least.at_ns(now_ns) or 0, 0)


class PoseValidator:
    """Judges every body of every frame. `without`: names of checks that are switched off (mocap.validator.checks)."""

    def __init__(self, config: LabConfig, without: frozenset[str] = frozenset()) -> None:
        counted = watched(without)
        self._bodies = tuple(v.body for v in config.vehicles)
        self._commanded = np.array([v.sysid is not None for v in config.vehicles])
        self._criteria = Criteria(
            bounds=bounds(config),
            q_marker_from_flu=frames.canonical(np.array([v.q_marker_from_flu for v in config.vehicles])),
            armed=np.zeros(len(self._bodies), np.bool_),
            armed_known=np.zeros(len(self._bodies), np.bool_),
            watched=np.array([reason in counted for reason in Rejection]),
        )
        self._memory = blank(Memory, len(self._bodies))
        self._stamps = StampWatch() if Rejection.STAMP in counted else None
        self._episodes = Episodes(self._bodies)

    def note_motors(self, on: Mapping[str, bool]) -> None:
        """Which drones have their motors on, as far as the ground knows; a body that is only observed leads them."""
        armed, armed_known = self._criteria.armed, self._criteria.armed_known
        for i, body in enumerate(self._bodies):
            if self._commanded[i] and body in on:
                armed[i], armed_known[i] = on[body], True
        armed[~self._commanded] = armed[self._commanded].any()
        armed_known[~self._commanded] = armed_known[self._commanded].all()

    def rejects_stamp(self, t_capture_ns: int, now_ns: int) -> bool:
        """Whether a frame that arrives now cannot have been captured then."""
        return self._stamps is not None and self._stamps.rejects(
            t_capture_ns, now_ns, True in self._criteria.armed.tolist()
        )

    def judge(self, frame: LabFrame, now_ns: int) -> LabFrame:
        """The frame with what is not believed unseen; its own arrays are written to."""
        swaps = judge(
            Frame(frame.t_capture_ns, frame.pos_lab_m, frame.q_lab_from_flu, frame.seen, frame.rejected),
            self._criteria, self._memory,
        )  # fmt: skip
        if swaps:
            self._episodes.note_swaps(swaps, now_ns)
        if any(frame.rejected.tolist()):
            self._episodes.note(frame, now_ns)
        return frame

    def without_poses(self, frame: LabFrame, earliest_ns: int, now_ns: int) -> LabFrame:
        """The frame without poses, for a rejected stamp; stamped with its likely time, not before earliest_ns."""
        likely_ns = now_ns if self._stamps is None else self._stamps.likely_ns(now_ns)
        t_ns = max(min(frame.t_capture_ns, likely_ns), earliest_ns)
        rejected = np.where(frame.seen, np.uint8(Rejection.STAMP), frame.rejected)
        without_poses = replace(frame, t_capture_ns=t_ns, seen=np.zeros(len(frame.seen), np.bool_), rejected=rejected)
        self._episodes.note(without_poses, now_ns, self._stamps.why(frame.t_capture_ns, now_ns) if self._stamps else "")
        return without_poses

    def events(self, now_ns: int) -> tuple[Event, ...]:
        """Events that are due: rejections that began, or ended."""
        return self._episodes.due(now_ns)

    def counts(self) -> dict[str, dict[str, int]]:
        """Poses rejected since the start, by body and reason; bodies without any are left out."""
        return {
            body: {name_of(reason) or reason.text: count for reason, count in counts.items()}
            for body, counts in self._episodes.counts.items()
            if counts
        }
