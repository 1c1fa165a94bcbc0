"""Setpoints of many drones at once against pymavlink, byte by byte."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from formation.messages import AttitudeTarget
from wire.link_messages.address import Address
from wire.mavlink.setpoint_batch import SetpointBatch

SOURCE = Address(255, 190)


def packet(target: Address, t_ms: int, q: list[float], rate: list[float], thrust: float, mask: int, seq: int) -> bytes:
    """pymavlink's own; q and rate in lab and FLU."""
    (w, x, y, z), (p, q_rate, r) = q, rate
    mav = common.MAVLink(None, srcSystem=SOURCE.system, srcComponent=SOURCE.component)
    mav.seq = seq
    message = common.MAVLink_set_attitude_target_message(
        t_ms, target.system, target.component, mask, [w, x, 0.0 - y, 0.0 - z], p, 0.0 - q_rate, 0.0 - r, thrust
    )
    return bytes(message.pack(mav))


def target(q: np.ndarray, rate: np.ndarray, thrust: np.ndarray) -> AttitudeTarget:
    return AttitudeTarget(0, q, rate, thrust, np.zeros(len(q)), np.zeros(len(q), np.bool_))


@pytest.mark.parametrize("seed", range(20))
def test_every_packet_is_pymavlinks(seed: int) -> None:
    """Also where numbers are zero or its negative, the mask is zero, which shortens the packet, and time wraps."""
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, 30))
    drones = [Address(int(rng.integers(1, 251)), 1) for _ in range(m)]
    q, rate, thrust = rng.normal(size=(m, 4)), rng.normal(size=(m, 3)), rng.random(m)
    for numbers in (q, rate, thrust):
        numbers[rng.random(numbers.shape) < 0.2] = rng.choice([0.0, -0.0])
    masks, seqs = [int(rng.choice([0, 3, 7, 64])) for _ in range(m)], rng.integers(0, 256, m).tolist()
    t_ms = int(rng.integers(0, 2**34))
    packets = SetpointBatch(SOURCE, drones).encode(target(q, rate, thrust), t_ms, masks, seqs)
    assert packets == [
        packet(drones[i], t_ms % 2**32, q[i].tolist(), rate[i].tolist(), float(thrust[i]), masks[i], seqs[i])
        for i in range(m)
    ]


def test_any_memory_layout_of_the_target_gives_the_same_bytes() -> None:
    """The limits may put new arrays in the target."""
    rng = np.random.default_rng(1)
    q, rate, thrust = rng.normal(size=(5, 4)), rng.normal(size=(5, 3)), rng.random(5)
    batch = SetpointBatch(SOURCE, [Address(2 + i, 1) for i in range(5)])
    turned = target(np.asfortranarray(q), np.asfortranarray(rate), np.repeat(thrust, 2)[::2])
    assert batch.encode(turned, 9, [3] * 5, [1] * 5) == batch.encode(target(q, rate, thrust), 9, [3] * 5, [1] * 5)


def test_a_batch_leaves_no_trace_in_the_next() -> None:
    batch, one = SetpointBatch(SOURCE, [Address(2, 1)]), np.ones(1)
    first = batch.encode(target(np.ones((1, 4)), np.ones((1, 3)), one), 1, [7], [1])
    batch.encode(target(np.zeros((1, 4)), np.zeros((1, 3)), 0.0 * one), 0, [0], [0])
    assert batch.encode(target(np.ones((1, 4)), np.ones((1, 3)), one), 1, [7], [1]) == first
