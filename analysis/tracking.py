"""How well each follower held its slot, and a commanded leader its trajectory: mocap frames against the reference.

The followers' error is in the leader's frame, the leader's own in lab axes: the first says nothing of the second.

Which frames count as formation is decided here, once, for the numbers and the pictures alike:
the phase is FORMATION, the follower's reference is held on the leader, and its slot has come to rest in the leader's
frame. The blend from wherever the follower was into its slot, and a change of shape, move the slot; those frames
are shown but not scored.
"""

from dataclasses import dataclass

import numpy as np

from analysis.load import Flight, Poses
from analysis.series import Columns, nearest, smoothed
from formation.maths import frames
from formation.maths.arrays import Bool, Float
from formation.messages import Phase

MATCH_S = 0.025  # a frame and the reference made for it are at most this far apart
HEADING_WINDOW_S = 0.15
AT_REST_M_S = 1e-3  # a slot slower than this is at rest


@dataclass(frozen=True, slots=True, eq=False)
class Tracking:
    """Every frame that has a reference, for the k followers.

    error_lead_m (T, k, 3): measured less asked, in the leader's frame (Eq. 2);
    scored (T, k): the frames the formation metrics count; formed (T, k): the same with moving slots included.
    """

    t_s: Float
    error_lead_m: Float
    formed: Bool
    scored: Bool


@dataclass(frozen=True, slots=True, eq=False)
class LeaderTracking:
    """Every formation frame in which a commanded leader was seen and had a reference.

    reference_lab_m, error_lab_m (T, 3): where it was asked to be, and measured minus asked, lab axes.
    """

    t_s: Float
    reference_lab_m: Float
    error_lab_m: Float


def track_leader(flight: Flight) -> LeaderTracking:
    """The leader's tracking error; empty (T = 0) where it is only observed, or poses or references are missing."""
    poses, reference, column = flight.poses, flight.reference, flight.leader.column if flight.vehicles else None
    if not len(poses) or not len(reference) or column is None:
        return LeaderTracking(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    matched = nearest(reference.t_s, poses.t_s)
    scored = np.abs(reference.t_s[matched] - poses.t_s) <= MATCH_S
    scored &= poses.seen[:, 0] & in_formation_phase(flight, poses.t_s)
    wanted = reference_lab_m(reference)[matched[scored], column]
    return LeaderTracking(poses.t_s[scored], wanted, poses.pos_lab_m[scored, 0] - wanted)


def reference_lab_m(reference: Columns) -> Float:
    """Where each commanded vehicle should be, lab axes, shape (T, m, 3)."""
    slot: Float = frames.rotate_about_z(reference["heading_rad"], reference["slot_lead_m"])
    return reference["origin_lab_m"] + slot


def track(flight: Flight) -> Tracking:
    """Formation tracking of a flight; empty (T = 0) where poses or references are missing."""
    poses, reference = flight.poses, flight.reference
    columns = [v.column for v in flight.followers if v.column is not None]
    if not len(poses) or not len(reference) or not columns:
        return _nothing(len(flight.followers))
    matched = nearest(reference.t_s, poses.t_s)
    close = np.abs(reference.t_s[matched] - poses.t_s) <= MATCH_S
    matched, t_s = matched[close], poses.t_s[close]
    origin, slot, slot_vel, on_leader = (
        reference[name][matched][:, columns]
        for name in ("origin_lab_m", "slot_lead_m", "slot_vel_lead_m_s", "in_formation")
    )
    pos = _in_leader_frame(poses.pos_lab_m[close], leader_heading(poses)[close], origin)
    seen = poses.seen[close]
    formed = on_leader & seen[:, :1] & seen[:, 1:] & in_formation_phase(flight, t_s)[:, None]
    return Tracking(t_s, pos - slot, formed, formed & (np.linalg.norm(slot_vel, axis=-1) < AT_REST_M_S))


def _nothing(followers: int) -> Tracking:
    """A tracking of no frame."""
    vectors, flags = np.zeros((0, followers, 3)), np.zeros((0, followers), dtype=np.bool_)
    return Tracking(np.zeros(0), vectors, flags, flags)


def leader_heading(poses: Poses) -> Float:
    """The leader's measured heading (T,), rad, unwrapped, smoothed over HEADING_WINDOW_S without lag.

    A single frame's yaw is noisy by about a milliradian, which at the end of a slot's arm would pass for an error
    of the follower.
    """
    yaw = np.unwrap(frames.yaw(poses.q_lab_from_flu[:, 0]))
    return smoothed(poses.t_s, yaw, HEADING_WINDOW_S, poses.seen[:, 0])


def _in_leader_frame(pos_lab_m: Float, heading_rad: Float, origin_lab_m: Float) -> Float:
    """Followers seen from the measured leader, rotated by its heading (Eq. 2); height from the reference's origin.

    The horizontal origin is the leader as measured; the height is the reference's choice (the leader's or the floor's).
    """
    relative = pos_lab_m[:, 1:] - pos_lab_m[:, :1]
    relative[..., 2] = pos_lab_m[:, 1:, 2] - origin_lab_m[..., 2]
    return frames.rotate_about_z(-heading_rad[:, None], relative)


def in_formation_phase(flight: Flight, t_s: Float) -> Bool:
    """Which of the times (T,) fall into the phase FORMATION; all of them where the log holds no phases."""
    if not flight.phases:
        return np.ones(len(t_s), dtype=np.bool_)
    inside = np.zeros(len(t_s), dtype=np.bool_)
    for span in flight.spans(Phase.FORMATION):
        inside |= (t_s >= span.start_s) & (t_s <= span.end_s)
    return inside


def airborne(flight: Flight, t_s: Float) -> Bool:
    """Which of the times (T,) fall between take-off and touch-down; all of them where the log holds no phases."""
    if not flight.phases:
        return np.ones(len(t_s), dtype=np.bool_)
    inside = np.zeros(len(t_s), dtype=np.bool_)
    for span in flight.spans(Phase.TAKEOFF, Phase.FORMATION, Phase.HOLD, Phase.LAND):
        inside |= (t_s >= span.start_s) & (t_s <= span.end_s)
    return inside
