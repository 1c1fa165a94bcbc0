"""Flights of the agent by itself, by a stream, and by other people's positions, velocities and body rates."""

import numpy as np
import pytest

from drone_agent.autopilots.model import Task
from tests.drone_agent.agent_harness import LEVEL, MS, Harness, hover_at, target
from wire.autopilots.table import FlightMode
from wire.link_messages import (
    AttitudeSetpoint,
    Heartbeat,
    Ignore,
    LocalFrame,
    PositionIgnore,
    PositionSetpoint,
    Result,
)


def test_disarms_what_does_not_take_off() -> None:
    harness = Harness()
    harness.run(3.0)
    harness.command(400, 1.0)
    harness.run(9.9)
    assert harness.autopilot.armed
    harness.run(0.2)
    assert not harness.autopilot.armed
    assert "Disarmed by auto preflight disarming" in harness.texts()


def test_kill_stops_the_motors_in_the_air_and_disarm_does_not() -> None:
    harness = Harness()
    harness.fly_offboard(1.0)
    assert harness.command(400, 0.0) is Result.TEMPORARILY_REJECTED
    assert harness.autopilot.armed
    assert harness.command(400, 0.0, 21196.0) is Result.ACCEPTED
    harness.run(0.3)
    assert harness.truth.vel_lab_m_s[2] < -1.5


def test_returns_home_and_lands() -> None:
    harness = Harness(profile="px4_quad", parameters={"RTL_RETURN_ALT": 1.0, "MIS_TAKEOFF_ALT": 0.8})
    harness.fly_offboard(0.6, hover_at(0.6))
    lean = np.array([np.cos(0.04), 0.0, np.sin(0.04), 0.0])
    harness.run(1.5, lambda b: target(b, 0.49, lean))
    harness.run(0.3, hover_at(0.6))
    assert harness.truth.pos_lab_m[0] > 0.3
    assert harness.command(20) is Result.ACCEPTED
    harness.run(15.0)
    np.testing.assert_allclose(harness.truth.pos_lab_m[:2], 0.0, atol=0.2)
    assert not harness.autopilot.armed


def test_battery_action_lands() -> None:
    pack = {"battery": {"capacity_mah": 9.0, "hover_current_a": 4.0}}
    harness = Harness(profile="paper_40g", vehicle=pack, parameters={"COM_LOW_BAT_ACT": 2.0})
    harness.run(2.5)
    harness.command(400, 1.0)
    harness.command(22)
    harness.run(8.5)
    assert harness.autopilot.task is Task.LAND
    assert harness.last(Heartbeat).system_status == 5


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
