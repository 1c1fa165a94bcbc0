"""Poses of many drones at once against pymavlink, byte by byte."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from formation.maths.frames import canonical
from wire.link_messages.address import Address
from wire.link_messages.motion import VisionPose
from wire.mavlink.codec import Codec
from wire.mavlink.pose_batch import PoseBatch

SOURCE = Address(255, 190)


def packet(t_us: int, position_ned_m: list[float], euler_ned_rad: list[float], seq: int) -> bytes:
    """pymavlink's own."""
    mav = common.MAVLink(None, srcSystem=SOURCE.system, srcComponent=SOURCE.component)
    mav.seq = seq
    unknown = [math.nan, *[0.0] * 20]
    message = common.MAVLink_vision_position_estimate_message(t_us, *position_ned_m, *euler_ned_rad, unknown, 0)
    return bytes(message.pack(mav))


def test_a_pose_worked_out_by_hand() -> None:
    """1 m forward, 2 m to the left, 0.5 m up; faces lab left, nose up 30 degrees: tests/wire/mavlink/test_golden.py."""
    c, s = math.cos(math.radians(45.0)), math.sin(math.radians(15.0))
    d = math.cos(math.radians(15.0))
    q = np.array([[c * d, c * s, -c * s, c * d]])
    (found,) = PoseBatch(SOURCE, 1).encode(1_234_567, np.array([[1.0, 2.0, 0.5]]), q, [7])
    expected = packet(1_234_567, [1.0, -2.0, -0.5], [0.0, math.radians(30.0), math.radians(-90.0)], 7)
    assert len(found) == len(expected)
    read = common.MAVLink(None).parse_char(bytearray(found))
    assert (read.usec, read.x, read.y, read.z) == (1_234_567, 1.0, -2.0, -0.5)
    assert (read.roll, read.pitch, read.yaw) == pytest.approx((0.0, math.radians(30.0), math.radians(-90.0)), abs=1e-6)
    assert math.isnan(read.covariance[0])


def test_level_poses_are_pymavlinks_byte_by_byte() -> None:
    """Of a level body, roll and pitch are zero, and no yaw is rounded by how it is computed."""
    pos, q = np.array([[0.0, -0.0, 0.0], [1.5, -0.25, 2.0]]), np.tile([1.0, 0.0, 0.0, 0.0], (2, 1))
    found = PoseBatch(SOURCE, 2).encode(5, pos, q, [0, 255])
    assert found == [packet(5, [0.0, 0.0, 0.0], [0.0] * 3, 0), packet(5, [1.5, 0.25, -2.0], [0.0] * 3, 255)]


@pytest.mark.parametrize("seed", range(20))
def test_every_packet_is_the_codecs(seed: int) -> None:
    """The codec's packets are held against pymavlink's; nose straight up and down, too."""
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, 30))
    pos, q = rng.normal(size=(m, 3)), rng.normal(size=(m, 4))
    for numbers in (pos, q):
        numbers[rng.random(numbers.shape) < 0.2] = rng.choice([0.0, -0.0])
    q[np.all(q == 0.0, axis=1)] = [1.0, 0.0, 0.0, 0.0]
    upright = rng.random(m) < 0.3
    q[upright] = np.array([math.sqrt(0.5), 0.0, rng.choice([-1.0, 1.0]) * math.sqrt(0.5), 0.0])
    q = canonical(q)
    t_us, seqs = int(rng.integers(0, 2**40)), rng.integers(0, 256, m).tolist()
    expected = []
    for i in range(m):
        codec = Codec(SOURCE)
        for _ in range(seqs[i]):
            codec.next_seq()
        expected.append(codec.encode(VisionPose(t_us, pos[i], q[i])))
    assert PoseBatch(SOURCE, m).encode(t_us, pos, q, seqs) == expected
