"""The external pose: when it is accepted, when the drone is ready, and what it believes then."""

import numpy as np
import pytest

from formation.maths.frames import from_yaw, multiply, rotate
from tests.drone_agent.agent_harness import LEVEL, Harness
from wire.link_messages import (
    AttitudeQuaternion,
    EkfStatus,
    EstimatorType,
    LinkMessage,
    LocalPosition,
    MocapPose,
    Odometry,
    OdometryFrame,
    Result,
    SetOrigin,
    VisionPose,
)

ZERO = np.zeros(3)
VISION = 128


def vision(t_us: int) -> LinkMessage:
    return VisionPose(t_us, ZERO, LEVEL)


def att_pos_mocap(t_us: int) -> LinkMessage:
    return MocapPose(t_us, ZERO, LEVEL)


def odometry(frame: OdometryFrame, estimator: EstimatorType, vel: float) -> object:
    return lambda t_us: Odometry(t_us, frame, estimator, ZERO, LEVEL, np.full(3, vel), ZERO)


def is_ready(autopilot: str, message: object) -> bool:
    harness = Harness(pose="mocap", guard=False, autopilot=autopilot)
    harness.send(SetOrigin(1, 47.0, 8.0, 400.0))
    for _ in range(60):
        harness.run(0.033, mocap=False)
        harness.send(message(harness.now_ns // 1000))
    # Hold (main 4, sub 3) of one, GUIDED (4) of the other.
    harness.command(176, 1.0, 4.0, 3.0)
    return harness.command(400, 1.0) is Result.ACCEPTED


FRD, NED = OdometryFrame.LOCAL_FRD, OdometryFrame.LOCAL_NED


@pytest.mark.parametrize(
    ("autopilot", "message", "fused"),
    [
        ("px4", vision, True),
        ("px4", att_pos_mocap, False),
        ("px4", odometry(NED, EstimatorType.VISION, np.nan), True),
        ("px4", odometry(FRD, EstimatorType.VISION, np.nan), True),
        ("px4", odometry(NED, EstimatorType.MOCAP, np.nan), False),
        ("ardupilot", vision, True),
        ("ardupilot", att_pos_mocap, True),
        ("ardupilot", odometry(FRD, EstimatorType.MOCAP, 0.0), True),
        ("ardupilot", odometry(FRD, EstimatorType.MOCAP, np.nan), False),
        ("ardupilot", odometry(NED, EstimatorType.VISION, 0.0), False),
    ],
)
def test_each_make_fuses_what_it_was_seen_to_fuse(autopilot: str, message: object, fused: bool) -> None:
    assert is_ready(autopilot, message) is fused


def test_ardupilot_needs_an_origin_beside_the_pose() -> None:
    harness = Harness(pose="mocap", guard=False, autopilot="ardupilot")

    def see(seconds: float) -> None:
        for _ in range(round(seconds * 30)):
            harness.run(1.0 / 30.0, mocap=False)
            harness.send(vision(harness.now_ns // 1000))

    see(2.0)
    harness.command(176, 1.0, 4.0)
    assert harness.command(400, 1.0) is Result.FAILED
    assert "Arm: Need Position Estimate: EKF origin not set" in harness.texts()
    assert harness.last(EkfStatus).flags & 0x410 == 0x400
    harness.send(SetOrigin(1, 47.0, 8.0, 400.0))
    see(1.0)
    assert harness.last(EkfStatus).flags & 0x410 == 0x10
    assert harness.command(400, 1.0) is Result.ACCEPTED


def test_a_turned_mocap_turns_what_it_believes_and_flies_all_the_same() -> None:
    turn = from_yaw(np.array(np.pi / 2))
    harness = Harness(pose="mocap", guard=False, start_lab_m=(0.5, 0.0, 0.0))

    def show_turned(seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            harness.run(0.01, mocap=False)
            truth = harness.truth
            harness.show(rotate(turn, truth.pos_lab_m), multiply(turn, truth.q_lab_from_flu))

    show_turned(3.0)
    harness.command(400, 1.0)
    harness.command(22)
    show_turned(8.0)
    np.testing.assert_allclose(harness.truth.pos_lab_m, [0.5, 0.0, 2.5], atol=0.05)
    np.testing.assert_allclose(harness.last(LocalPosition).pos_lab_m, [0.0, 0.5, 2.5], atol=0.05)
    np.testing.assert_allclose(harness.last(AttitudeQuaternion).q_lab_from_flu, turn, atol=0.02)


def test_a_position_that_goes_on_jumping_is_reset_to_five_times_and_then_no_more() -> None:
    harness = Harness(pose="mocap", guard=False)
    harness.run(2.0)
    places = []
    for k in range(8):
        for _ in range(150):
            harness.run(0.01, mocap=False)
            harness.show(np.array([3.0 * (k + 1), 0.0, 0.0]))
        places.append(float(harness.autopilot.estimator.pos_lab_m[0]))
    np.testing.assert_allclose(places, [3.0, 6.0, 9.0, 12.0, 15.0, 15.0, 15.0, 15.0], atol=0.1)


def test_an_accelerometer_that_is_wrong_makes_it_lean_while_it_says_that_it_is_level() -> None:
    """0.2 m/s^2 along x: by hand, atan(0.2 / 9.81), until flight tells bias from lean."""
    harness = Harness(
        pose="mocap", guard=False, profile="px4_quad",
        inertial_error={"bias_flu_m_s2": (0.2, 0.0, 0.0), "noise_m_s2": 0.0, "vibration_m_s2": 0.0},
    )  # fmt: skip
    harness.run(20.0)
    q_lab_from_flu = harness.last(AttitudeQuaternion).q_lab_from_flu
    assert 2.0 * q_lab_from_flu[2] == pytest.approx(-np.arctan(0.2 / 9.81), rel=0.1)
