"""The bridge's HIGHRES_IMU: asked for where it does not come, and taken for as old as it is."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from drone_agent.bridge import imu_rate_limit_hz
from drone_agent.guard.config import GuardConfig
from drone_agent.guard.core import GuardCore
from drone_agent.guard.estimate import BodyEstimate, InertialStream
from formation.maths.arrays import Float
from formation.messages import Datagram
from formation.vehicle.profile import PROFILES
from tests.drone_agent.agent_harness import MS, S
from wire.autopilots.ardupilot import ARDUPILOT
from wire.autopilots.px4 import PX4
from wire.autopilots.table import AutopilotTable
from wire.link_messages import (
    BRIDGE_COMPONENT,
    GROUND,
    Address,
    CommandAck,
    CommandLong,
    InertialSample,
    MavCommand,
    Result,
    command_long,
)
from wire.mavlink.codec import Codec

DRONE, BRIDGE = Address(1, 1), Address(1, BRIDGE_COMPONENT)
IMU = 105.0
G = np.array([0.0, 0.0, 9.80665])


class Asked:
    """A stream whose requests are kept, with an autopilot that sends what it likes."""

    def __init__(self, rate_hz: float = 100.0) -> None:
        self.stream = InertialStream(DRONE, rate_hz, BodyEstimate(PROFILES["px4_quad"], 1), 0)
        self.requests: list[CommandLong] = []
        self.told_s: list[float] = []
        self.now_ns = 0

    def run(self, seconds: float, rate_hz: float = 0.0) -> None:
        for _ in range(round(seconds * 100)):
            self.now_ns += 10 * MS
            if rate_hz and self.now_ns // (10 * MS) % round(100 / rate_hz) == 0:
                self.stream.receive_sample(InertialSample(self.now_ns // 1000, G, np.zeros(3)), self.now_ns)
            request = self.stream.due(self.now_ns)
            self.requests += [request] if request is not None else []
            self.told_s += [self.now_ns / S] if self.stream.is_missing_report_due(self.now_ns) else []


def test_it_is_asked_for_until_enough_comes_and_kept_from_who_did_not_ask() -> None:
    asked = Asked()
    asked.run(4.0)
    assert [r.params[:2] for r in asked.requests] == [(IMU, 10_000.0)] * 3
    assert not asked.stream.passes
    asked.run(5.0, rate_hz=50.0)
    assert len(asked.requests) <= 4
    assert not asked.stream.requested(command_long(DRONE, MavCommand.SET_MESSAGE_INTERVAL, 30.0, 1e4))
    assert not asked.stream.requested(command_long(DRONE, MavCommand.SET_MESSAGE_INTERVAL, IMU, 5e3))
    assert asked.stream.passes
    assert asked.stream.requested(command_long(DRONE, MavCommand.SET_MESSAGE_INTERVAL, IMU, -1.0))
    assert not asked.stream.passes
    assert asked.stream.requested(command_long(DRONE, MavCommand.SET_MESSAGE_INTERVAL, IMU, 1e5))
    assert asked.stream.passes
    asked.stream.restarted(asked.now_ns)
    asked.run(3.0)
    assert len(asked.requests) > 4
    assert asked.stream.passes


def test_the_operator_is_told_once_that_it_does_not_come() -> None:
    asked = Asked()
    asked.run(4.0)
    asked.run(4.0, rate_hz=50.0)
    assert asked.told_s == []
    asked.run(20.0)
    assert len(asked.told_s) == 1
    asked.stream.restarted(asked.now_ns)
    asked.stream.answered(CommandAck(BRIDGE, MavCommand.SET_MESSAGE_INTERVAL, Result.UNSUPPORTED))
    asked.requests.clear()
    asked.run(20.0)
    assert asked.requests == []
    assert not asked.stream.requested(command_long(DRONE, MavCommand.SET_MESSAGE_INTERVAL, IMU, -1.0))
    assert asked.told_s[1:] == [pytest.approx(28.01)]


def test_a_bridge_that_wants_none_leaves_it_alone() -> None:
    asked = Asked(0.0)
    asked.run(20.0)
    assert asked.requests == []
    assert asked.told_s == []
    assert not asked.stream.requested(command_long(DRONE, MavCommand.SET_MESSAGE_INTERVAL, IMU, -1.0))


def test_the_request_of_a_ground_for_less_ends_here_and_is_answered() -> None:
    bridge, ground = GuardCore(GuardConfig(body="b"), 0), Codec(GROUND)
    bridge.tick(0)
    for interval_us, passes in ((-1.0, False), (5e3, True)):
        asks = ground.encode(command_long(DRONE, MavCommand.SET_MESSAGE_INTERVAL, IMU, interval_us))
        bridge.receive_ground(Datagram(1, asks), MS)
        out = bridge.tick(MS)
        assert bool(out.to_autopilot) is passes
        acks = [p for d in out.to_ground for p in ground.receive(d.data) if isinstance(p.message, CommandAck)]
        assert [(p.source, p.message.result) for p in acks] == [] if passes else [(DRONE, Result.ACCEPTED)]


@pytest.mark.parametrize(
    ("line", "room_hz"),
    [("serial:/dev/ttyACM0:921600", 307.2), ("serial:/dev/ttyUSB0:57600", 19.2), ("udp:h:1", np.inf)],
)
def test_a_slow_line_is_not_filled(line: str, room_hz: float) -> None:
    """A HIGHRES_IMU of 63 bytes with MAVLink 2's frame of 12, 10 bits each: a quarter of the line."""
    assert imu_rate_limit_hz(line) == pytest.approx(room_hz)


def lowpass(rising_m_s2: Float) -> Float:
    """ArduPilot's sample: one value behind a Butterworth low-pass of 20 Hz (AP_InertialSensor, INS_ACCEL_FILTER)."""
    b, a = butter(2, 20.0, fs=1000.0)
    filtered: Float = lfilter(b, a, rising_m_s2)
    return filtered


def mean(rising_m_s2: Float) -> Float:
    """PX4's sample: the mean of 5 ms (IMU_INTEG_RATE), however rarely HIGHRES_IMU is sent."""
    means: Float = lfilter(np.full(5, 0.2), [1.0], rising_m_s2)
    return means


@pytest.mark.parametrize("period_ms", [5, 10, 20])
@pytest.mark.parametrize(
    ("table", "shows", "late_ms"), [(ARDUPILOT, lowpass, 0.0), (PX4, lowpass, 8.75), (PX4, mean, 0.0)]
)
def test_samples_are_taken_for_as_old_as_they_are(
    table: AutopilotTable, shows: Callable[[Float], Float], late_ms: float, period_ms: int
) -> None:
    """Force rises by 10 m/s^3 for 0.5 s and no pose is seen; samples that are late by t leave the velocity 5 t behind.

    By hand: the filter's delay is 11.25 ms, the mean's 2.5 ms. The last sample stands until the next.
    """
    estimate, level = BodyEstimate(PROFILES["px4_quad"], 1), np.array([1.0, 0.0, 0.0, 0.0])
    stream = InertialStream(DRONE, 1000.0 / period_ms, estimate, 0)
    stream.restarted(0, table.inertial_delay_s)
    shown_m_s2 = shows(10.0 * np.clip(0.001 * np.arange(2501) - 2.0, 0.0, None))
    for k in range(period_ms, 2501, period_ms):
        if k % 10 == 0 and k <= 2000:
            pos = 1e-3 * np.random.default_rng(k).standard_normal(3)
            estimate.receive_pose(k * MS, pos, level, stands=False)
        stream.receive_sample(InertialSample(k * 1000, G + np.array([0.0, 0.0, shown_m_s2[k]]), np.zeros(3)), k * MS)
    motion = estimate.motion(2500 * MS)
    assert motion is not None
    assert 5.0 * 0.5**2 - motion.vel_lab_m_s[2] == pytest.approx(5.0 * late_ms * 1e-3, abs=0.01)
