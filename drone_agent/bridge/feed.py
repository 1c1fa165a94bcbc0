"""The body's own mocap poses in the bridge: held against the inertial sensors, told to the autopilot. No bytes."""

from math import nan

import numpy as np

from drone_agent.bridge.hold import BridgeHold
from drone_agent.bridge.reckoning import Reckoning
from formation.messages import LabFrame
from wire.link_messages.motion import VisionPose

_POSE_NS = 20_000_000
_FRESH_NS = 200_000_000
_RECKONED_NS = 500_000_000
"""So long a place is held by the inertial sensors alone: they drift by some centimetres."""
_LIFTED_M = 0.05
"""Above where it stood with its motors off: below, the floor shakes what it feels, and no pose leads it away."""


class BodyFeed:
    """One body's poses; `hold` follows them, and the inertial sensors for a moment where the poses slide."""

    def __init__(self, body: str, hold: BridgeHold, reckoning: Reckoning, t0_ns: int, *, finds_slides: bool) -> None:
        """finds_slides: whether poses are held against what the inertial sensors say."""
        self._body, self._hold, self._reckoning, self._finds_slides = body, hold, reckoning, finds_slides
        self._pose_due_ns = t0_ns
        self._seen_ns: int | None = None
        self._slides_ns: int | None = None
        self._floor_m = nan

    @property
    def begun(self) -> bool:
        """Whether the body was ever seen."""
        return self._seen_ns is not None

    @property
    def slides(self) -> bool:
        """Whether the pose moves as the body does not: nothing made of it is to be obeyed."""
        return self._slides_ns is not None

    def fresh(self, now_ns: int) -> bool:
        """Whether it is known where the body is."""
        return self._seen_ns is not None and now_ns - self._seen_ns < _FRESH_NS

    def see(self, frame: LabFrame, now_ns: int, *, armed: bool) -> VisionPose | None:
        """Take a frame in; the pose to tell the autopilot, at most fifty a second."""
        if self._body not in frame.bodies:
            return None
        index = frame.bodies.index(self._body)
        t_ns, pos, q = frame.t_capture_ns, frame.pos_lab_m[index], frame.q_lab_from_flu[index]
        if not frame.seen[index] or not np.isfinite(pos).all() or not np.isfinite(q).all():
            return None
        self._reckoning.see(t_ns, pos, q)
        if not armed:
            self._floor_m = float(pos[2])
        stands = float(pos[2]) - self._floor_m <= _LIFTED_M and not self.slides
        if self._finds_slides and not stands and self._reckoning.slides:
            moves = self._reckoning.at(t_ns)
            if self._slides_ns is None:
                self._slides_ns = now_ns
                self._hold.take_over(t_ns, moves)
            if now_ns - self._slides_ns < _RECKONED_NS:
                self._seen_ns = now_ns
                self._hold.see(t_ns, moves.pos_lab_m, q)
            return None
        self._slides_ns = None
        self._seen_ns = now_ns
        self._hold.see(t_ns, pos, q)
        if now_ns < self._pose_due_ns:
            return None
        self._pose_due_ns = max(self._pose_due_ns + _POSE_NS, now_ns)  # a steady 50 Hz out of frames that jitter
        return VisionPose(t_ns // 1000, pos, q)
