"""The body's mocap poses in the bridge: checked by the guard's navigator and sent to the autopilot. No bytes."""

from math import isfinite, nan

from drone_agent.guard.estimate import BodyEstimate
from formation.messages import LabFrame
from formation.navigation.receive import RejectReason
from wire.link_messages import VisionPose

_POSE_NS = 20_000_000
_DEAD_RECKONING_NS = 500_000_000
"""Longest hold on the inertial sensors alone, unseen or with faulty poses: they drift by some centimetres."""
_FROZEN_NS = 100_000_000
"""So long repeated poses are taken for lost frames: ten at 100 Hz."""
_LIFTED_M = 0.05
"""Height above its stand with motors off: below, the floor disturbs the IMU, and no pose moves the drone."""


class BodyFeed:
    """One body's poses: each goes to its estimate, and to the autopilot unless the poses are rejected."""

    def __init__(self, body: str, estimate: BodyEstimate, t0_ns: int) -> None:
        self._body, self._estimate = body, estimate
        self._index = 0
        """Where the body was in the last frame."""
        self._pose_due_ns = t0_ns
        self._seen_ns: int | None = None
        self._rejecting_ns: int | None = None
        self._frozen_ns: int | None = None
        self._floor_m = nan
        self.stands = True
        """Whether it was last seen within _LIFTED_M of where it stood with motors off."""

    @property
    def begun(self) -> bool:
        """Whether the body was ever seen."""
        return self._seen_ns is not None

    @property
    def is_rejecting(self) -> bool:
        """Whether the poses are rejected: setpoints made from them are, too."""
        return self._rejecting_ns is not None

    def fresh(self, now_ns: int) -> bool:
        """Whether it is known where the body is."""
        return self._seen_ns is not None and now_ns - self._seen_ns < _DEAD_RECKONING_NS

    def receive_frame(self, frame: LabFrame, now_ns: int, *, armed: bool) -> VisionPose | None:
        """Receive a frame; returns the pose for the autopilot, at most fifty a second."""
        bodies = frame.bodies
        if self._index >= len(bodies) or bodies[self._index] != self._body:
            if self._body not in bodies:
                return None
            self._index = bodies.index(self._body)
        index = self._index
        t_ns, pos, q = frame.t_capture_ns, frame.pos_lab_m[index], frame.q_lab_from_flu[index]
        position_m = pos.tolist()
        if not frame.seen[index] or not all(map(isfinite, position_m)) or not all(map(isfinite, q.tolist())):
            return None
        if not armed:
            self._floor_m = position_m[2]
        self.stands = not armed or (not self.is_rejecting and position_m[2] - self._floor_m <= _LIFTED_M)
        reason = self._estimate.receive_pose(t_ns, pos, q, stands=self.stands)
        if reason is RejectReason.FROZEN:
            self._frozen_ns = self._frozen_ns or now_ns
        elif reason is RejectReason.NONE:
            self._frozen_ns = None
        self.check(now_ns)
        if self._rejecting_ns is not None or reason is not RejectReason.NONE:
            return None
        self._seen_ns = now_ns
        if now_ns < self._pose_due_ns:
            return None
        self._pose_due_ns = max(self._pose_due_ns + _POSE_NS, now_ns)  # a steady 50 Hz out of frames that jitter
        return VisionPose(t_ns // 1000, pos, q)

    def check(self, now_ns: int) -> str:
        """Why the poses are rejected now, empty where they are not; after every input of the estimate."""
        fault = self._estimate.pose_fault
        if not fault and self._frozen_ns is not None and now_ns - self._frozen_ns >= _FROZEN_NS:
            fault = "pose frozen"
        self._rejecting_ns = (self._rejecting_ns or now_ns) if fault else None
        return fault
