"""North, east, down and forward, right, down against `lab` and `flu`, by hand and by matrices, for both autopilots.

Lab x is north, lab y west, lab z up: both turns are S = diag(1, -1, -1), so R_ned_from_frd = S R_lab_from_flu S.
"""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as oracle

from formation.maths import frames
from wire.link_messages import (
    GROUND,
    Address,
    AttitudeSetpoint,
    EstimatorType,
    Ignore,
    LinkMessage,
    Odometry,
    OdometryFrame,
    VisionPose,
)
from wire.mavlink.axes import heading_ned, lab, ned, q_lab_from_euler
from wire.mavlink.codec import Codec

S = np.diag([1.0, -1.0, -1.0])
ANGLES = [(0.3, -0.5, 1.1), (-0.7, 0.4, -2.0), (1.2, 1.0, 3.0), (0.1, -1.2, 0.2)]  # roll, pitch, yaw in NED
POS, RATE, VEL = np.array([1.1, 2.3, 0.7]), np.array([0.4, 0.5, 0.6]), np.array([0.15, 0.25, 0.35])
DRONE = Address(1, 1)


def turn(axis: int, angle: float) -> np.ndarray:
    """A right-handed turn about one axis."""
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    r = np.eye(3)
    r[i, i] = r[j, j] = np.cos(angle)
    r[i, j], r[j, i] = -np.sin(angle), np.sin(angle)
    return r


def r_ned(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Intrinsic z-y-x, as MAVLink's angles are defined."""
    return turn(2, yaw) @ turn(1, pitch) @ turn(0, roll)


def test_east_is_minus_y_and_down_is_minus_z() -> None:
    """A place 1.1 m forward, 2.3 m to the left and 0.7 m up is 1.1 m north, 2.3 m west (-2.3 m east), 0.7 m up."""
    assert ned(POS) == pytest.approx((1.1, -2.3, -0.7))
    np.testing.assert_allclose(lab(1.1, -2.3, -0.7), POS)


def test_headings_are_clockwise_from_north() -> None:
    """Facing lab left is west, 270 degrees; facing lab right is east, 90."""
    assert np.degrees([heading_ned(0.5 * np.pi), heading_ned(-0.5 * np.pi)]) == pytest.approx([270.0, 90.0])


def read(message: LinkMessage):
    """What pymavlink, which knows nothing of `lab`, reads in the bytes."""
    return oracle.MAVLink(None).parse_buffer(Codec(GROUND).encode(message))[0]


@pytest.mark.parametrize("angles", ANGLES)
def test_both_autopilots_are_sent_attitudes_in_ned_and_frd(angles: tuple[float, float, float]) -> None:
    """SET_ATTITUDE_TARGET of PX4 and of ArduPilot: q of FRD in NED, body rates about forward, right, down."""
    q = q_lab_from_euler(*angles)
    np.testing.assert_allclose(frames.matrix(q), S @ r_ned(*angles) @ S, atol=1e-12)
    sent = read(AttitudeSetpoint(DRONE, 1, q, RATE, 0.5, Ignore.NONE))
    np.testing.assert_allclose(frames.matrix(np.array(sent.q)), r_ned(*angles), atol=1e-6)
    rates = (sent.body_roll_rate, sent.body_pitch_rate, sent.body_yaw_rate)
    assert rates == pytest.approx((0.4, -0.5, -0.6))


@pytest.mark.parametrize("angles", ANGLES)
def test_a_px4_is_told_its_pose_in_ned_by_vision_position_estimate(angles: tuple[float, float, float]) -> None:
    sent = read(VisionPose(5, POS, q_lab_from_euler(*angles)))
    assert (sent.x, sent.y, sent.z, sent.roll, sent.pitch, sent.yaw) == pytest.approx((1.1, -2.3, -0.7, *angles))


@pytest.mark.parametrize("angles", ANGLES)
def test_an_ardupilot_is_told_its_pose_in_frd_by_odometry(angles: tuple[float, float, float]) -> None:
    q = q_lab_from_euler(*angles)
    sent = read(Odometry(5, OdometryFrame.LOCAL_FRD, EstimatorType.VISION, POS, q, VEL, RATE, 3))
    assert (sent.frame_id, sent.child_frame_id) == (oracle.MAV_FRAME_LOCAL_FRD, oracle.MAV_FRAME_BODY_FRD)
    assert (sent.x, sent.y, sent.z, sent.vx, sent.vy, sent.vz) == pytest.approx((1.1, -2.3, -0.7, 0.15, -0.25, -0.35))
    assert (sent.rollspeed, sent.pitchspeed, sent.yawspeed) == pytest.approx((0.4, -0.5, -0.6))
    np.testing.assert_allclose(frames.matrix(np.array(sent.q)), r_ned(*angles), atol=1e-6)
