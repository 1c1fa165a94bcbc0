"""The check of a frame from outside before anything reads its arrays, one for both kinds. Pure, linear."""

import numpy as np

from formation.maths.arrays import Bool, Float
from formation.messages import FARTHEST_M, LabFrame, RawFrame, Rejection

MOST_BODIES = 1000
UNIT_WITHIN = 0.1
"""How far the square of a quaternion's length may be from 1."""
OLDEST_NS = 1_000_000_000
AHEAD_NS = 20_000_000
"""How far ahead of ours a camera system's clock may be."""
DOUBT_NS = 2_000_000
"""How far after now a lab frame's times may lie: the mocap process's clock is ours, or known to this."""


def raw_fault(frame: RawFrame, now_ns: int, ahead_ns: int = AHEAD_NS) -> str | None:
    """Why the frame cannot be used, None if it can. Its poses are judged one by one, later (mocap.alignment).

    ahead_ns: how far after `now_ns` its capture may be.
    """
    shape = _shape_fault(frame.bodies, frame.pos_mocap_m, frame.q_mocap_from_marker, frame.seen)
    if shape is not None or frame.t_capture_ns == 0:
        return shape
    return _stamp_fault(frame.t_capture_ns, now_ns, ahead_ns)


def lab_fault(frame: LabFrame, now_ns: int) -> str | None:
    """Why the frame cannot be used now, None if it can; no mocap process of ours sends one with a fault."""
    newest_ns = max(frame.t_capture_ns, frame.t_receive_ns)
    fault = pose_fault(frame)
    if fault is None and (frame.rejected >= len(Rejection)).any():
        fault = "with a rejection code that is none"
    return fault or _stamp_fault(frame.t_capture_ns, now_ns, DOUBT_NS) or _future_fault(newest_ns, now_ns)


def pose_fault(frame: LabFrame) -> str | None:
    """Why the frame can never be used, None if it can; what rejections a log of a later version knows is no fault."""
    fault = _shape_fault(frame.bodies, frame.pos_lab_m, frame.q_lab_from_flu, frame.seen)
    if fault is not None:
        return fault
    if frame.rejected.shape != frame.seen.shape:
        return "with unequal numbers of names and rejections"
    return None if are_poses(frame.pos_lab_m, frame.q_lab_from_flu) else "with a pose that is none"


def are_poses(pos: Float, q: Float) -> Bool:
    """Whether all poses (..., n) of a frame are ones, of each frame (...)."""
    off_unit = np.abs(np.einsum("...j,...j->...", q, q) - 1.0)
    # Written so that NaN fails.
    sound: Bool = (np.abs(pos) <= 2.0 * FARTHEST_M).all(axis=(-2, -1)) & (off_unit <= UNIT_WITHIN).all(axis=-1)
    return sound


def _shape_fault(bodies: tuple[str, ...], pos: Float, q: Float, seen: Bool) -> str | None:
    n = len(bodies)
    if n > MOST_BODIES:
        return f"of more than {MOST_BODIES} bodies"
    if pos.shape != (n, 3) or q.shape != (n, 4) or seen.shape != (n,):
        return "with unequal numbers of names, positions, quaternions and flags"
    return None


def _stamp_fault(t_capture_ns: int, now_ns: int, ahead_ns: int = AHEAD_NS) -> str | None:
    if now_ns - t_capture_ns >= OLDEST_NS:
        return "captured more than 1 s ago"
    return _future_fault(t_capture_ns, now_ns, ahead_ns)


def _future_fault(t_ns: int, now_ns: int, ahead_ns: int = DOUBT_NS) -> str | None:
    return "captured in the future of this machine's clock" if t_ns - now_ns > ahead_ns else None
