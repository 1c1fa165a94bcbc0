"""The external pose: when it is accepted, when the drone is ready, and what it believes then."""

import numpy as np
import pytest
from agent_bench import LEVEL, Bench

from formation.maths.frames import from_yaw, multiply, rotate
from wire.link_messages.commands import Result
from wire.link_messages.motion import (
    AttitudeQuaternion,
    EstimatorType,
    LocalPosition,
    MocapPose,
    Odometry,
    OdometryFrame,
    SetOrigin,
    VisionPose,
)
from wire.link_messages.packet import LinkMessage
from wire.link_messages.status import EkfStatus, SysStatus

ZERO = np.zeros(3)
PREARM = 1 << 28
VISION = 128


def vision(t_us: int) -> LinkMessage:
    return VisionPose(t_us, ZERO, LEVEL)


def att_pos_mocap(t_us: int) -> LinkMessage:
    return MocapPose(t_us, ZERO, LEVEL)


def odometry(frame: OdometryFrame, estimator: EstimatorType, vel: float) -> object:
    return lambda t_us: Odometry(t_us, frame, estimator, ZERO, LEVEL, np.full(3, vel), ZERO)


def is_ready(autopilot: str, message: object) -> bool:
    bench = Bench(pose="mocap", autopilot=autopilot)
    bench.send(SetOrigin(1, 47.0, 8.0, 400.0))
    for _ in range(60):
        bench.run(0.033, mocap=False)
        bench.send(message(bench.now_ns // 1000))
    # Hold (main 4, sub 3) of one, GUIDED (4) of the other.
    bench.command(176, 1.0, 4.0, 3.0)
    return bench.command(400, 1.0) is Result.ACCEPTED


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
    bench = Bench(pose="mocap", autopilot="ardupilot")

    def see(seconds: float) -> None:
        for _ in range(round(seconds * 30)):
            bench.run(1.0 / 30.0, mocap=False)
            bench.send(vision(bench.now_ns // 1000))

    see(2.0)
    bench.command(176, 1.0, 4.0)
    assert bench.command(400, 1.0) is Result.FAILED
    assert "Arm: Need Position Estimate: EKF origin not set" in bench.texts()
    assert bench.last(EkfStatus).flags & 0x410 == 0x400
    bench.send(SetOrigin(1, 47.0, 8.0, 400.0))
    see(1.0)
    assert bench.last(EkfStatus).flags & 0x410 == 0x10
    assert bench.command(400, 1.0) is Result.ACCEPTED


def test_not_fused_where_a_parameter_says_so() -> None:
    bench = Bench(pose="mocap", parameters={"EKF2_EV_CTRL": 0.0})
    bench.run(1.0)
    bench.send(vision(bench.now_ns // 1000))
    assert bench.command(400, 1.0) is Result.TEMPORARILY_REJECTED


def test_not_ready_without_a_pose_then_ready_then_not() -> None:
    bench = Bench(pose="mocap")
    bench.run(4.0, mocap=False)
    assert not bench.last(SysStatus).sensors_healthy & (PREARM | VISION)
    assert not bench.of(LocalPosition)
    assert bench.command(400, 1.0) is Result.TEMPORARILY_REJECTED
    assert any("no external pose" in text for text in bench.texts())
    bench.run(0.8)
    assert bench.command(400, 1.0) is Result.TEMPORARILY_REJECTED
    bench.run(1.5)
    assert bench.last(SysStatus).sensors_healthy & PREARM
    assert bench.last(EkfStatus).flags & 16
    bench.run(1.5, mocap=False)
    assert not bench.last(SysStatus).sensors_healthy & PREARM
    assert bench.command(400, 1.0) is Result.TEMPORARILY_REJECTED
    assert any("stale" in text for text in bench.texts())


def test_believes_the_pose_over_a_biased_accelerometer() -> None:
    bench = Bench(pose="mocap", start_lab_m=(1.0, 2.0, 0.0))
    bench.fly_offboard(0.6)
    np.testing.assert_allclose(bench.last(LocalPosition).pos_lab_m, bench.truth.pos_lab_m, atol=0.02)
    np.testing.assert_allclose(bench.last(LocalPosition).vel_lab_m_s, bench.truth.vel_lab_m_s, atol=0.02)


def test_a_turned_mocap_turns_what_it_believes_and_flies_all_the_same() -> None:
    turn = from_yaw(np.array(np.pi / 2))
    bench = Bench(pose="mocap", start_lab_m=(0.5, 0.0, 0.0))

    def show_turned(seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            bench.run(0.01, mocap=False)
            truth = bench.truth
            bench.show(rotate(turn, truth.pos_lab_m), multiply(turn, truth.q_lab_from_flu))

    show_turned(3.0)
    bench.command(400, 1.0)
    bench.command(22)
    show_turned(8.0)
    np.testing.assert_allclose(bench.truth.pos_lab_m, [0.5, 0.0, 2.5], atol=0.05)
    np.testing.assert_allclose(bench.last(LocalPosition).pos_lab_m, [0.0, 0.5, 2.5], atol=0.05)
    np.testing.assert_allclose(bench.last(AttitudeQuaternion).q_lab_from_flu, turn, atol=0.02)


def pose_fault(bench: Bench) -> str:
    bench.command(400, 1.0)
    return next(text for text in reversed(bench.texts()) if text.startswith("Preflight Fail"))


@pytest.mark.parametrize(
    ("pos", "q", "reason"),
    [
        ([5.0, 0.0, 0.0], LEVEL, "jumped"),
        ([0.0, 0.0, 0.0], np.array([np.cos(0.4), np.sin(0.4), 0.0, 0.0]), "gravity"),
        ([np.nan, 0.0, 0.0], LEVEL, "not finite"),
    ],
)
def test_an_implausible_pose_is_refused_with_its_reason(pos: list[float], q: np.ndarray, reason: str) -> None:
    bench = Bench(pose="mocap")
    bench.run(2.0)
    for _ in range(50):
        bench.run(0.01, mocap=False)
        bench.show(np.array(pos), q)
    assert reason in pose_fault(bench)


def test_a_pose_that_jumped_for_good_is_believed_after_a_second() -> None:
    bench = Bench(pose="mocap")
    bench.run(2.0)
    for _ in range(250):
        bench.run(0.01, mocap=False)
        bench.show(np.array([5.0, 0.0, 0.0]))
    assert bench.command(400, 1.0) is Result.ACCEPTED
    np.testing.assert_allclose(bench.last(LocalPosition).pos_lab_m, [5.0, 0.0, 0.0], atol=0.05)
