"""Setpoints that are not obeyed: old, out of order, of another ground, beyond bounds; and who owns the stream."""

from collections.abc import Callable

import numpy as np
import pytest

from drone_agent.guard.setpoints import TILT_MAX_RAD, RejectReason, SetpointFilter, within_bounds
from drone_agent.guard.stages import Stage
from formation.maths.frames import from_rotation_vector
from formation.messages import Datagram
from tests.drone_agent.agent_harness import LEVEL, MS, Harness, S, hover_at, hover_over, tilt_rad
from wire.link_messages import (
    BRIDGE_COMPONENT,
    GROUND,
    Address,
    AttitudeSetpoint,
    Ignore,
    LinkMessage,
    TimeSync,
    ground_address,
)
from wire.mavlink.codec import Codec

AHEAD_MS = 7_000_000
"""The ground's clock against the drone's."""


class Synchronised(Harness):
    """A drone whose ground answers TIMESYNC, on a clock of its own."""

    def __init__(self, **config: object) -> None:
        super().__init__(pose="mocap", **config)
        self._answered = 0

    def tick(self) -> None:
        super().tick()
        for _, message in self.heard[self._answered :]:
            if isinstance(message, TimeSync) and message.tc1_ns == 0:
                theirs_ns = self.now_ns + AHEAD_MS * MS
                asker = Address(self.config.sysid, BRIDGE_COMPONENT)
                data = self.codec.encode(TimeSync(theirs_ns, message.ts1_ns, asker))
                self.core.receive(Datagram(self.config.sysid, data), self.now_ns)
        self._answered = len(self.heard)

    def say(self, source: Address, *messages: LinkMessage) -> None:
        """As another ground."""
        data = b"".join(Codec(source).encode(message) for message in messages)
        self.core.receive(Datagram(self.config.sysid, data), self.now_ns)
        self.tick()


def aged(age_ms: int, setpoint: Callable[[Harness], AttitudeSetpoint | None]) -> Callable[[Harness], AttitudeSetpoint]:
    def stream(harness: Harness) -> AttitudeSetpoint:
        made = setpoint(harness)
        assert made is not None
        return made._replace(t_boot_ms=harness.now_ns // MS + AHEAD_MS - age_ms)

    return stream


def flying() -> Synchronised:
    harness = Synchronised()
    harness.fly_offboard(1.0, aged(20, hover_over(0.0, 0.0, 1.0)))
    return harness


def moving(speed_m_s: float) -> Callable[[Harness], AttitudeSetpoint]:
    def stream(harness: Harness) -> AttitudeSetpoint:
        level = hover_at(1.0)(harness)
        assert level is not None
        asked = 2.5 * (np.array([speed_m_s, 0.0]) - harness.truth.vel_lab_m_s[:2])
        lean = np.clip(asked / 9.8, -0.3, 0.3)
        return level._replace(q_lab_from_flu=from_rotation_vector(np.array([-lean[1], lean[0], 0.0])))

    return stream


def test_from_the_circles_speed_it_comes_to_a_standstill_within_0_3_m_of_the_last_setpoint() -> None:
    harness = flying()
    harness.run(1.5, aged(20, moving(0.63)))
    assert harness.truth.vel_lab_m_s[0] > 0.55
    place, drift_m, slowest_m_s = harness.truth.pos_lab_m, 0.0, 1.0
    for _ in range(100):
        harness.run(0.01, aged(300, moving(0.63)))
        drift_m = max(drift_m, float(np.linalg.norm((harness.truth.pos_lab_m - place)[:2])))
        slowest_m_s = min(slowest_m_s, float(np.linalg.norm(harness.truth.vel_lab_m_s[:2])))
    assert drift_m < 0.3
    assert slowest_m_s < 0.05


def test_a_client_without_timesync_flies_and_that_is_said_once() -> None:
    harness = Harness(pose="mocap")
    harness.fly_offboard(0.6)
    assert harness.stream.stage is Stage.FOLLOW
    assert harness.texts().count("Age of setpoints of system 255/190 unknown: no TIMESYNC") == 1
    harness.run(1.0, lambda h: hover_at(0.6)(h)._replace(t_boot_ms=0))
    assert harness.stream.stage is Stage.FOLLOW


def test_the_gate_knows_a_clock_of_its_own_from_an_old_stamp() -> None:
    gate = SetpointFilter()
    ground = gate.sender(GROUND)
    ground.clock.exchange(0, 500 * S, 2 * MS)
    assert gate.judge(ground, 77, 100 * MS) is None  # MAVSDK answers TIMESYNC on another clock than it stamps
    assert gate.judge(ground, 500_099, 100 * MS) is None
    assert gate.judge(ground, 77, 110 * MS) is RejectReason.STALE  # from now on its stamps are known to be on the clock
    assert gate.judge(ground, 500_200, 110 * MS) is RejectReason.STALE  # of the future
    assert gate.judge(ground, 500_099, 110 * MS) is RejectReason.OLD


def test_the_ground_of_an_epoch_has_an_address_of_its_own() -> None:
    """MAV_COMP_ID_USER1 is 25, USER75 is 99."""
    assert [ground_address(epoch) for epoch in (0, 1, 74, 75)] == [(255, 25), (255, 26), (255, 99), (255, 25)]


@pytest.mark.parametrize("tilt", [0.9, 2.0, 3.1])
def test_a_setpoint_is_tilted_no_further_than_the_bound_and_in_its_own_direction(tilt: float) -> None:
    asked = AttitudeSetpoint(
        Address(1, 1), 1, from_rotation_vector(np.array([0.0, tilt, 0.0])), np.zeros(3), 1.2, Ignore.BODY_RATES
    )  # fmt: skip
    got = within_bounds(asked)
    assert tilt_rad(got.q_lab_from_flu) == pytest.approx(TILT_MAX_RAD)
    assert got.thrust_norm == 1.0
    mild = asked._replace(q_lab_from_flu=LEVEL, thrust_norm=0.6)
    assert within_bounds(mild) is mild


@pytest.mark.parametrize(
    ("rate", "ignore", "passes"),
    [
        ([3.7, -3.7, 3.7], Ignore.NONE, True), ([100.0, 0.0, 0.0], Ignore.NONE, False),
        ([0.0, 0.0, -3.9], Ignore.ROLL_RATE | Ignore.PITCH_RATE, False), ([100.0, 0.0, 0.0], Ignore.ROLL_RATE, True),
        ([0.0, -3.9, 0.0], Ignore.ATTITUDE, False), ([100.0, 100.0, 100.0], Ignore.BODY_RATES, True),
    ],
)  # fmt: skip
def test_body_rates_beyond_the_vehicles_are_rejected_and_counted(
    rate: list[float], ignore: Ignore, passes: bool
) -> None:
    """PX4's MC_ROLLRATE_MAX is 220 degrees/s, 3.8 rad/s. Full thrust beside such a rate turns a drone over."""
    harness = Harness(pose="mocap", profile="px4_quad")
    harness.fly_offboard(1.0)
    before = len(harness.texts())
    for _ in range(120):  # a report a second
        harness.run(0.01, lambda h: hover_at(1.0)(h)._replace(rate_flu_rad_s=np.array(rate), ignore=ignore))
    texts = " ".join(harness.texts()[before:])
    assert ("x setpoint beyond the vehicle's body rates (from" in texts) is not passes
    assert (harness.stream.stage is Stage.FOLLOW) is passes
    assert tilt_rad(harness.truth.q_lab_from_flu) < 0.2
