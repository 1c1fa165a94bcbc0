"""When Qualisys' and Vicon's clients say a frame was exposed, against a room that knows: jitter, bursts, set clocks."""

import struct
from collections.abc import Callable

import numpy as np
import pytest

from formation.maths.arrays import Float
from formation.mocap_config import QualisysConfig, ViconConfig
from mocap.sources.qualisys.source import Qualisys
from mocap.sources.tcp import Session
from mocap.sources.vicon.packets import Kind, packet_of
from mocap.sources.vicon.source import Vicon
from tests.mocap.sources.qtm_bytes import FRAME, PARAMETERS_1_19, VERSION_SET, WELCOME, xml
from tests.mocap.sources.recorded_feed import Kept, kept
from tests.mocap.sources.vicon_bytes import FIRST, OFFER

RATE_HZ, LATENCY_S, LENGTH_S, STEP_AT_S = 100.0, 0.004, 40.0, 20.0
DRIFT = 20e-6
HOUR_S = 3600.0
Packet = Callable[[float, int], bytes]


def qualisys(record: Kept) -> tuple[Session, Packet]:
    session, _ = Qualisys(QualisysConfig(), (), round(LATENCY_S * 1e9), record.feed()).open(0, "", "")
    session.received(WELCOME + VERSION_SET + xml(PARAMETERS_1_19), 0)
    return session, lambda t_s, k: FRAME[:8] + struct.pack("<qI", round(t_s * 1e6), k) + FRAME[20:]


def vicon(record: Kept) -> tuple[Session, Packet]:
    """It reports the latency of each frame, which scatters by a millisecond, in truth too."""
    session, _ = Vicon(ViconConfig(), (), 99_000_000, record.feed()).open(0, "", "")
    session.received(OFFER + FIRST, 0)
    record.frames.clear()

    def packet(t_s: float, k: int) -> bytes:
        latency = struct.pack("<IId", 1, 0, LATENCY_S + more_s(k))
        return packet_of((Kind.FRAME_INFO, struct.pack("<I", round(t_s * RATE_HZ))), (Kind.LATENCY_INFO, latency))

    return session, packet


def more_s(k: int) -> float:
    return 0.001 * (k * 7 % 10) / 10


def errors_s(system: Callable[[Kept], tuple[Session, Packet]], step_s: float) -> tuple[Float, Float]:
    """When each frame came, s, and how far off its exposure was said to be, s."""
    rng = np.random.default_rng(5)
    exposed = 1.0 + np.arange(round(LENGTH_S * RATE_HZ)) / RATE_HZ
    ready = exposed + LATENCY_S + np.array([more_s(k) if system is vicon else 0.0 for k in range(len(exposed))])
    arrived = ready + rng.exponential(0.005, len(exposed))
    for first in range(0, len(exposed), 200):  # ten at once, every two seconds
        arrived[first : first + 10] = arrived[first : first + 10].max() + 50e-6 * np.arange(10)
    arrived = np.maximum.accumulate(arrived)
    theirs = 2 * HOUR_S + exposed * (1.0 + DRIFT) + np.where(exposed > STEP_AT_S, step_s, 0.0)
    record = kept("qualisys" if system is qualisys else "vicon")
    session, packet = system(record)
    for k in range(len(exposed)):
        session.received(packet(theirs[k], k + 1), round(arrived[k] * 1e9))
    assert len(record.frames) == len(exposed)
    return arrived, np.array([frame.t_capture_ns for frame in record.frames]) * 1e-9 - exposed


@pytest.mark.parametrize("system", [qualisys, vicon])
def test_exposures_are_known_within_a_millisecond(system):
    arrived_s, off_s = errors_s(system, 0.0)
    settled = off_s[arrived_s > 5.0]
    assert np.percentile(np.abs(settled), 99.0) < 1e-3


@pytest.mark.parametrize("step_s", [HOUR_S, -HOUR_S])
@pytest.mark.parametrize("system", [qualisys, vicon])
def test_a_clock_that_is_set_by_an_hour_is_known_five_seconds_later(system, step_s):
    arrived_s, off_s = errors_s(system, step_s)
    later = off_s[arrived_s > STEP_AT_S + 5.0]
    assert np.abs(later).max() < 2e-3
