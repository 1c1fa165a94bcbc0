"""Golden packets: poses worked out by hand, as pymavlink and as MAVSDK put them into bytes.

The drone of the hand-computed pose is 1 m forward, 2 m to the left and 0.5 m up, faces lab left and has its nose
up 30 degrees. In MAVLink's axes: 1 m north, 2 m west, 0.5 m up; heading west (yaw -90 degrees), pitch +30 degrees:

    q_ned_from_frd = (cos 45, 0, 0, -sin 45) (cos 15, 0, sin 15, 0)
                   = (cos 45 cos 15, sin 45 sin 15, cos 45 sin 15, -sin 45 cos 15)

and in lab and flu (left instead of right, up instead of down) y and z change sign:

    q_lab_from_flu = (cos 45 cos 15, sin 45 sin 15, -cos 45 sin 15, sin 45 cos 15)
"""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as oracle

from tests.wire.messages import decode_packet
from wire.link_messages import (
    GROUND,
    Address,
    Attitude,
    AttitudeQuaternion,
    EstimatorType,
    GlobalPosition,
    InertialSample,
    LinkMessage,
    LocalPosition,
    MocapPose,
    Odometry,
    OdometryFrame,
    ParamRequestList,
    TimeSync,
    UnknownMessage,
)
from wire.mavlink.codec import Codec
from wire.mavlink.framing import MavlinkError

C45, C15, S15 = math.sqrt(0.5), math.cos(math.pi / 12), math.sin(math.pi / 12)
POS_LAB = np.array([1.0, 2.0, 0.5])
Q_LAB = np.array([C45 * C15, C45 * S15, -C45 * S15, C45 * C15])
NORTH, EAST, DOWN = 1.0, -2.0, -0.5
Q_NED = [C45 * C15, C45 * S15, C45 * S15, -C45 * C15]
ROLL, PITCH, YAW = 0.0, math.pi / 6, -math.pi / 2
RATE_FLU, RATE_FRD = np.array([0.4, 0.5, 0.6]), (0.4, -0.5, -0.6)
ZERO = np.zeros(3)
DRONE = Address(1, 1)
MAVSDK = Address(245, 190)


def pymavlinks(message) -> bytes:
    return message.pack(oracle.MAVLink(None, srcSystem=255, srcComponent=190))


def ours(message: LinkMessage) -> bytes:
    return Codec(GROUND).encode(message)


class Build:
    """pymavlink's encoders, without a link behind them."""

    mav = oracle.MAVLink(None)


def test_telemetry():
    attitude = Build.mav.attitude_encode(9, ROLL, PITCH, YAW, *RATE_FRD)
    assert ours(Attitude(9, Q_LAB, RATE_FLU)) == pymavlinks(attitude)
    quaternion = Build.mav.attitude_quaternion_encode(9, *Q_NED, *RATE_FRD)
    assert ours(AttitudeQuaternion(9, Q_LAB, RATE_FLU)) == pymavlinks(quaternion)
    position = Build.mav.local_position_ned_encode(9, NORTH, EAST, DOWN, 0.25, -0.5, -0.75)
    assert ours(LocalPosition(9, POS_LAB, np.array([0.25, 0.5, 0.75]))) == pymavlinks(position)
    world = Build.mav.global_position_int_encode(9, 473977420, 85455940, 488500, 500, 25, -50, -75, 27000)
    message = GlobalPosition(9, 47.397742, 8.545594, 488.5, 0.5, np.array([0.25, 0.5, 0.75]), math.pi / 2)
    assert ours(message) == pymavlinks(world)


FORCE_FLU, FORCE_FRD = np.array([0.5, 0.25, 9.75]), (0.5, -0.25, -9.75)
NOTHING_ELSE = (0.0,) * 7  # magnetometer, pressures, altitude, temperature
ACCELEROMETER, GYROSCOPE = 0x7, 0x38  # HIGHRES_IMU_UPDATED_XACC to ZACC, and XGYRO to ZGYRO


def test_an_inertial_sample_at_rest_is_up_here_and_minus_down_there():
    golden = Build.mav.highres_imu_encode(2**33, *FORCE_FRD, *RATE_FRD, *NOTHING_ELSE, 0x3F)
    assert ours(InertialSample(2**33, FORCE_FLU, RATE_FLU)) == pymavlinks(golden)


def test_of_an_inertial_sample_only_what_is_said_to_be_there_is_taken():
    def read(updated: int) -> LinkMessage:
        return decode_packet(
            pymavlinks(Build.mav.highres_imu_encode(7, *FORCE_FRD, *RATE_FRD, *NOTHING_ELSE, updated))
        ).message

    assert [read(updated) for updated in (0, GYROSCOPE, 0x3B, 0x1FF8)] == [UnknownMessage(105)] * 4
    force_only = read(ACCELEROMETER)
    assert isinstance(force_only, InertialSample)
    assert np.isnan(force_only.rate_flu_rad_s).all()
    golden = Build.mav.highres_imu_encode(7, *FORCE_FRD, 0.0, 0.0, 0.0, *NOTHING_ELSE, ACCELEROMETER)
    assert ours(force_only) == pymavlinks(golden)


def test_a_specific_force_that_is_not_finite_is_refused():
    golden = Build.mav.highres_imu_encode(7, math.inf, 0.0, 0.0, *RATE_FRD, *NOTHING_ELSE, 0x3F)
    with pytest.raises(MavlinkError):
        decode_packet(pymavlinks(golden))


@pytest.mark.parametrize(
    ("roll_deg", "pitch_deg", "yaw_deg", "q_lab"),
    [
        (90.0, 0.0, 0.0, [C45, C45, 0.0, 0.0]),  # right side down, the same axis in both frames
        (0.0, 0.0, 90.0, [C45, 0.0, 0.0, -C45]),  # facing east: lab right
        (0.0, 0.0, 180.0, [0.0, 0.0, 0.0, 1.0]),
        (0.0, 90.0, 0.0, [C45, 0.0, -C45, 0.0]),  # nose straight up: roll and yaw are one
        (0.0, -90.0, 0.0, [C45, 0.0, C45, 0.0]),
        (0.0, 90.0, -90.0, [0.5, 0.5, -0.5, 0.5]),
    ],
)
def test_attitude_by_hand(roll_deg, pitch_deg, yaw_deg, q_lab):
    euler = [math.radians(angle) for angle in (roll_deg, pitch_deg, yaw_deg)]
    read = decode_packet(pymavlinks(Build.mav.attitude_encode(0, *euler, 0, 0, 0))).message
    assert abs(np.dot(read.q_lab_from_flu, q_lab)) == pytest.approx(1.0, abs=1e-13)
    sent = Build.mav.attitude_encode(0, *euler, 0, 0, 0)
    again = decode_packet(ours(Attitude(0, np.array(q_lab), ZERO))).message
    assert abs(np.dot(again.q_lab_from_flu, q_lab)) == pytest.approx(1.0, abs=1e-13)
    if abs(yaw_deg) != 180.0:
        assert ours(Attitude(0, np.array(q_lab), ZERO)) == pymavlinks(sent)


# What MAVSDK 4.1.0 put on the wire for the pose above: its mocap plugin (covariance [NaN]), its direct plugin for
# TIMESYNC with the target that pymavlink has no field for.
FROM_MAVSDK = {
    "TIMESYNC": (
        4,
        "fd12000004f5be6f0000000000000000000079df0d8648700000010190e7",
        TimeSync(0, 123456789012345, DRONE),
    ),
    "ATT_POS_MOCAP": (
        8,
        "fd28000008f5be8a00007b00000000000000ecd92e3faf673b3eaf673b3eecd92ebf0000803f000000c0000000bf0000c07ff11b",
        MocapPose(123, POS_LAB, Q_LAB),
    ),
    "ODOMETRY": (
        9,
        "fde8000009f5be4b01007b000000000000000000803f000000c0000000bfecd92e3faf673b3eaf673b3eecd92ebfcdcccc3dcdcc4c3e"
        "9a99993ecdcccc3e0000003f9a99193f0000c07f" + "00" * 80 + "0000c07f" + "00" * 80 + "140c00023d55",
        Odometry(
            123,
            OdometryFrame.LOCAL_FRD,
            EstimatorType.VISION,
            POS_LAB,
            Q_LAB,
            np.array([0.1, -0.2, -0.3]),
            np.array([0.4, -0.5, -0.6]),
        ),
    ),
}


@pytest.mark.parametrize("name", FROM_MAVSDK)
def test_bytes_are_mavsdks(name):
    seq, golden, message = FROM_MAVSDK[name]
    codec = Codec(MAVSDK)
    for _ in range(seq):
        codec.encode(ParamRequestList(DRONE))
    assert codec.encode(message).hex() == golden
    packet = decode_packet(bytes.fromhex(golden))
    assert (packet.source, packet.seq, type(packet.message)) == (MAVSDK, seq, type(message))
