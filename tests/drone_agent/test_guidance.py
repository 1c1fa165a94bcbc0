"""Guidance by positions, velocities and body rates, as other people's scripts do it."""

import numpy as np
import pytest

from drone_agent.autopilots.model import Task
from tests.drone_agent.agent_harness import LEVEL, MS, Harness, hover_at
from wire.autopilots.table import FlightMode
from wire.link_messages.commands import Result
from wire.link_messages.motion import GlobalPosition, Origin, SetOrigin, SimTruth
from wire.link_messages.setpoints import AttitudeSetpoint, Ignore, LocalFrame, PositionIgnore, PositionSetpoint
from wire.link_messages.status import MessageInterval

NOT_POSITION = PositionIgnore.POSITION | PositionIgnore.ACCELERATION | PositionIgnore.YAW_RATE
NOT_VELOCITY = PositionIgnore.VELOCITY | PositionIgnore.ACCELERATION | PositionIgnore.YAW_RATE


def guide(
    harness: Harness, vector: tuple[float, float, float], frame: LocalFrame, ignore: PositionIgnore, yaw: float = np.nan
) -> PositionSetpoint:
    return PositionSetpoint(
        harness.target, harness.now_ns // MS, frame, ignore, np.array(vector), np.array(vector), np.zeros(3), yaw, 0.0
    )


def in_the_air(autopilot: str, **config: object) -> Harness:
    harness = Harness(autopilot=autopilot, profile="px4_quad", **config)
    harness.fly_offboard(0.8) if autopilot == "px4" else guided(harness)
    return harness


def guided(harness: Harness) -> None:
    harness.run(3.0)
    # GUIDED (4) of one, hold (main 4, sub 3) of the other.
    harness.command(176, 1.0, 4.0, 3.0)
    harness.command(400, 1.0)
    harness.command(22, 0, 0, 0, 0, 0, 0, 0.8)
    harness.run(5.0)


def test_px4_flies_to_a_streamed_position_with_a_heading() -> None:
    harness = in_the_air("px4")
    there = (0.6, -0.4, 1.2)
    harness.run(8.0, lambda b: guide(b, there, LocalFrame.LOCAL, NOT_VELOCITY, 0.5))
    np.testing.assert_allclose(harness.truth.pos_lab_m, there, atol=0.05)
    assert harness.truth.q_lab_from_flu[3] == pytest.approx(np.sin(0.25), abs=0.02)
    assert harness.autopilot.mode is FlightMode.OFFBOARD


def test_px4_takes_off_by_positions() -> None:
    harness = Harness(profile="px4_quad")
    harness.run(3.0)

    def above(b: Harness) -> PositionSetpoint:
        return guide(b, (0.0, 0.0, 1.0), LocalFrame.LOCAL, NOT_VELOCITY)

    harness.run(1.0, above)
    assert harness.command(176, 1.0, 6.0) is Result.ACCEPTED
    assert harness.command(400, 1.0) is Result.ACCEPTED
    harness.run(5.0, above)
    np.testing.assert_allclose(harness.truth.pos_lab_m, [0.0, 0.0, 1.0], atol=0.05)
    harness.run(3.0)
    assert harness.autopilot.mode is FlightMode.POSITION


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_flies_a_velocity_in_lab_and_in_body_axes(autopilot: str) -> None:
    harness = Harness(autopilot=autopilot, profile="px4_quad", start_yaw_rad=np.pi / 2)
    guided(harness)
    harness.run(0.1, lambda b: guide(b, (0.4, 0.0, 0.1), LocalFrame.LOCAL, NOT_POSITION))
    harness.command(176, 1.0, 6.0 if autopilot == "px4" else 4.0)
    harness.run(3.0, lambda b: guide(b, (0.4, 0.0, 0.1), LocalFrame.LOCAL, NOT_POSITION))
    np.testing.assert_allclose(harness.truth.vel_lab_m_s, [0.4, 0.0, 0.1], atol=0.06)
    # Forward, for a vehicle that faces lab left.
    harness.run(3.0, lambda b: guide(b, (0.4, 0.0, 0.0), LocalFrame.BODY, NOT_POSITION))
    np.testing.assert_allclose(harness.truth.vel_lab_m_s, [0.0, 0.4, 0.0], atol=0.06)


def test_ardupilot_goes_where_it_was_told_once() -> None:
    harness = in_the_air("ardupilot")
    harness.send(guide(harness, (0.5, 0.3, 0.4), LocalFrame.LOCAL_OFFSET, NOT_VELOCITY))
    harness.run(8.0)
    np.testing.assert_allclose(harness.truth.pos_lab_m, [0.5, 0.3, 1.2], atol=0.06)
    assert harness.autopilot.mode is FlightMode.OFFBOARD


def test_a_velocity_stream_that_dies_ends_in_level_flight_after_the_autopilots_own_time_out() -> None:
    harness = in_the_air("ardupilot")
    harness.run(1.5, lambda b: guide(b, (0.5, 0.0, 0.0), LocalFrame.LOCAL, NOT_POSITION))
    harness.run(harness.autopilot.stream_loss.after_s - 0.1)
    assert abs(harness.truth.vel_lab_m_s[0]) > 0.4
    harness.run(2.0)
    assert harness.autopilot.task is Task.LEVEL


@pytest.mark.parametrize("profile", ["paper_40g", "px4_quad"])
def test_body_rates_turn_it_at_that_rate(profile: str) -> None:
    harness = Harness(profile=profile)
    harness.fly_offboard(3.0)
    hover = harness.config.true_vehicle().hover_thrust_norm

    def spin(b: Harness) -> AttitudeSetpoint:
        return AttitudeSetpoint(b.target, 0, LEVEL, np.array([0.0, 0.0, 0.8]), hover, Ignore.ATTITUDE)

    harness.run(1.0, spin)
    assert harness.truth.rate_flu_rad_s[2] == pytest.approx(0.8, rel=0.15)


def test_ardupilot_stops_on_a_target_it_cannot_read() -> None:
    harness = Harness(autopilot="ardupilot", profile="px4_quad", parameters={"GUID_OPTIONS": 8.0})
    harness.fly_offboard(0.8)
    half = AttitudeSetpoint(harness.target, 0, LEVEL, np.zeros(3), 0.5, Ignore.ROLL_RATE)
    harness.send(half)
    assert harness.autopilot.task is Task.HOLD
    harness.run(0.1, hover_at(0.8))
    assert harness.autopilot.task is Task.EXTERNAL


def test_an_indoor_drone_has_no_place_on_the_globe_until_told() -> None:
    harness = Harness(pose="mocap")
    harness.run(2.0)
    harness.command(512, 49.0)
    assert not harness.of(Origin)
    harness.send(SetOrigin(1, 48.0, 11.0, 500.0))
    assert harness.last(Origin).lat_deg == pytest.approx(48.0)
    harness.run(1.0)
    assert harness.last(GlobalPosition).lat_deg == pytest.approx(48.0, abs=1e-6)


def test_intervals_are_told() -> None:
    harness = Harness()
    for number, interval in ((31, 20000), (32, 33333), (83, -1), (9999, 0)):
        assert harness.command(510, float(number)) is Result.ACCEPTED
        assert harness.last(MessageInterval) == MessageInterval(number, interval)


def test_the_true_state_is_told_where_asked() -> None:
    harness = Harness(start_lab_m=(1.0, 0.0, 0.0))
    harness.command(511, 115.0, 40000.0)
    harness.run(1.0)
    north_m = (harness.last(SimTruth).lat_deg - 47.397742) * 111319.49
    assert north_m == pytest.approx(1.0, abs=0.02)
