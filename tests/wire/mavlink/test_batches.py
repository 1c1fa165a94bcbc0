"""Setpoints and poses of many drones at once against pymavlink and the codec, byte by byte."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from formation.maths.frames import canonical
from formation.messages import AttitudeTarget
from wire.link_messages import Address, VisionPose
from wire.mavlink.batches import PoseBatch, SetpointBatch
from wire.mavlink.codec import Codec

SOURCE = Address(255, 190)


def pymavlinks(message, seq: int) -> bytes:
    mav = common.MAVLink(None, srcSystem=SOURCE.system, srcComponent=SOURCE.component)
    mav.seq = seq
    return bytes(message.pack(mav))


def setpoint(to: Address, t_ms: int, q: list[float], rate: list[float], thrust: float, mask: int, seq: int) -> bytes:
    """pymavlink's own; q and rate in lab and FLU."""
    (w, x, y, z), (p, q_rate, r) = q, rate
    message = common.MAVLink_set_attitude_target_message(
        t_ms, to.system, to.component, mask, [w, x, 0.0 - y, 0.0 - z], p, 0.0 - q_rate, 0.0 - r, thrust
    )
    return pymavlinks(message, seq)


def target(q: np.ndarray, rate: np.ndarray, thrust: np.ndarray) -> AttitudeTarget:
    return AttitudeTarget(0, q, rate, thrust, np.zeros(len(q)), np.zeros(len(q), np.bool_))


def zeroed(rng: np.random.Generator, *numbers: np.ndarray) -> None:
    for each in numbers:
        each[rng.random(each.shape) < 0.2] = rng.choice([0.0, -0.0])


@pytest.mark.parametrize("seed", range(6))
def test_every_setpoint_is_pymavlinks(seed: int) -> None:
    """Also where numbers are zero or its negative, the mask is zero, which shortens the packet, and time wraps."""
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, 30))
    drones = [Address(int(rng.integers(1, 251)), 1) for _ in range(m)]
    q, rate, thrust = rng.normal(size=(m, 4)), rng.normal(size=(m, 3)), rng.random(m)
    zeroed(rng, q, rate, thrust)
    masks, seqs = [int(rng.choice([0, 3, 7, 64])) for _ in range(m)], rng.integers(0, 256, m).tolist()
    t_ms = int(rng.integers(0, 2**34))
    order = "CF"[seed % 2]  # the limits may put arrays of any layout in the target
    given = target(np.array(q, order=order), np.array(rate, order=order), np.repeat(thrust, 2)[::2])
    assert SetpointBatch(SOURCE, drones).encode(given, t_ms, masks, seqs) == [
        setpoint(drones[i], t_ms % 2**32, q[i].tolist(), rate[i].tolist(), float(thrust[i]), masks[i], seqs[i])
        for i in range(m)
    ]


def test_a_batch_leaves_no_trace_in_the_next() -> None:
    batch, one = SetpointBatch(SOURCE, [Address(2, 1)]), np.ones(1)
    first = batch.encode(target(np.ones((1, 4)), np.ones((1, 3)), one), 1, [7], [1])
    batch.encode(target(np.zeros((1, 4)), np.zeros((1, 3)), 0.0 * one), 0, [0], [0])
    assert batch.encode(target(np.ones((1, 4)), np.ones((1, 3)), one), 1, [7], [1]) == first


def test_level_poses_are_pymavlinks() -> None:
    """Of a level body, roll and pitch are zero, and no yaw is rounded by how it is computed."""
    unknown = [math.nan, *[0.0] * 20]
    expected = [
        pymavlinks(common.MAVLink_vision_position_estimate_message(5, *ned_m, 0.0, 0.0, 0.0, unknown, 0), seq)
        for ned_m, seq in (((0.0, 0.0, 0.0), 0), ((1.5, 0.25, -2.0), 255))
    ]
    pos, q = np.array([[0.0, -0.0, 0.0], [1.5, -0.25, 2.0]]), np.tile([1.0, 0.0, 0.0, 0.0], (2, 1))
    assert PoseBatch(SOURCE, 2).encode(5, pos, q, [0, 255]) == expected


@pytest.mark.parametrize("seed", range(6))
def test_every_pose_is_the_codecs(seed: int) -> None:
    """The codec's packets are held against pymavlink's; nose straight up and down, too."""
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, 30))
    pos, q = rng.normal(size=(m, 3)), rng.normal(size=(m, 4))
    zeroed(rng, pos, q)
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
