"""The gate of one lab: aligned frames in, believed frames out. Pure; all that it remembers is its own."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from formation.config import LabConfig
from formation.maths import frames
from formation.maths.records import blank
from formation.messages import Event, LabFrame
from formation.rejection import Rejection
from gcs.mocap.gate.bounds import bounds
from gcs.mocap.gate.checks import name_of, watched
from gcs.mocap.gate.episodes import Episodes
from gcs.mocap.gate.judge import Frame, Given, Memory, judge
from gcs.mocap.gate.stamps import StampWatch


class Gate:
    """Judges every body of every frame. `without`: names of checks that are switched off (gcs.mocap.gate.checks)."""

    def __init__(self, config: LabConfig, without: frozenset[str] = frozenset()) -> None:
        counted = watched(without)
        self._bodies = tuple(v.body for v in config.vehicles)
        self._commanded = np.array([v.sysid is not None for v in config.vehicles])
        self._given = Given(
            bounds=bounds(config),
            q_marker_from_flu=frames.canonical(np.array([v.q_marker_from_flu for v in config.vehicles])),
            armed=np.zeros(len(self._bodies), np.bool_),
            told=np.zeros(len(self._bodies), np.bool_),
            watched=np.array([reason in counted for reason in Rejection]),
        )
        self._memory = blank(Memory, len(self._bodies))
        self._stamps = StampWatch() if Rejection.STAMP in counted else None
        self._episodes = Episodes(self._bodies)

    def note_motors(self, on: Mapping[str, bool]) -> None:
        """Which drones have their motors on, as far as the ground knows; a body that is only observed leads them."""
        armed, told = self._given.armed, self._given.told
        for i, body in enumerate(self._bodies):
            if self._commanded[i] and body in on:
                armed[i], told[i] = on[body], True
        armed[~self._commanded] = armed[self._commanded].any()
        told[~self._commanded] = told[self._commanded].all()

    def refuses_stamp(self, t_capture_ns: int, now_ns: int) -> bool:
        """Whether a frame that arrives now cannot have been captured then."""
        return self._stamps is not None and self._stamps.refuses(
            t_capture_ns, now_ns, True in self._given.armed.tolist()
        )

    def judge(self, frame: LabFrame, now_ns: int) -> LabFrame:
        """The frame with what is not believed unseen; its own arrays are written to."""
        exchanged = judge(
            Frame(frame.t_capture_ns, frame.pos_lab_m, frame.q_lab_from_flu, frame.seen, frame.rejected),
            self._given, self._memory,
        )  # fmt: skip
        if exchanged:
            self._episodes.note_exchanged(exchanged, now_ns)
        if any(frame.rejected.tolist()):
            self._episodes.note(frame, now_ns)
        return frame

    def blind(self, frame: LabFrame, earliest_ns: int, now_ns: int) -> LabFrame:
        """The frame where its stamp is refused: nobody is seen in it; stamped with what is likely, not before that."""
        likely_ns = now_ns if self._stamps is None else self._stamps.likely_ns(now_ns)
        t_ns = max(min(frame.t_capture_ns, likely_ns), earliest_ns)
        rejected = np.where(frame.seen, np.uint8(Rejection.STAMP), frame.rejected)
        blind = replace(frame, t_capture_ns=t_ns, seen=np.zeros(len(frame.seen), np.bool_), rejected=rejected)
        self._episodes.note(blind, now_ns)
        return blind

    def events(self, now_ns: int) -> tuple[Event, ...]:
        """What there is to tell: rejections that began, or are over."""
        return self._episodes.due(now_ns)

    def counts(self) -> dict[str, dict[str, int]]:
        """Poses rejected since the start, by body and reason; bodies without any are left out."""
        return {
            body: {name_of(reason) or reason.text: count for reason, count in counts.items()}
            for body, counts in self._episodes.counts.items()
            if counts
        }
