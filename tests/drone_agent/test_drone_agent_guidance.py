"""Guidance by positions, velocities and body rates, as other people's scripts do it."""

import numpy as np
import pytest
from agent_bench import LEVEL, MS, Bench, hover_at

from drone_agent.autopilots.model import Task
from wire.autopilots.table import FlightMode
from wire.link_messages.commands import Result
from wire.link_messages.motion import GlobalPosition, Origin, SetOrigin, SimTruth
from wire.link_messages.setpoints import AttitudeSetpoint, Ignore, LocalFrame, PositionIgnore, PositionSetpoint
from wire.link_messages.status import MessageInterval

NOT_POSITION = PositionIgnore.POSITION | PositionIgnore.ACCELERATION | PositionIgnore.YAW_RATE
NOT_VELOCITY = PositionIgnore.VELOCITY | PositionIgnore.ACCELERATION | PositionIgnore.YAW_RATE


def guide(
    bench: Bench, vector: tuple[float, float, float], frame: LocalFrame, ignore: PositionIgnore, yaw: float = np.nan
) -> PositionSetpoint:
    return PositionSetpoint(
        bench.target, bench.now_ns // MS, frame, ignore, np.array(vector), np.array(vector), np.zeros(3), yaw, 0.0
    )


def in_the_air(autopilot: str, **config: object) -> Bench:
    bench = Bench(autopilot=autopilot, profile="px4_quad", **config)
    bench.fly_offboard(0.8) if autopilot == "px4" else guided(bench)
    return bench


def guided(bench: Bench) -> None:
    bench.run(3.0)
    # GUIDED (4) of one, hold (main 4, sub 3) of the other.
    bench.command(176, 1.0, 4.0, 3.0)
    bench.command(400, 1.0)
    bench.command(22, 0, 0, 0, 0, 0, 0, 0.8)
    bench.run(5.0)


def test_px4_flies_to_a_streamed_position_with_a_heading() -> None:
    bench = in_the_air("px4")
    there = (0.6, -0.4, 1.2)
    bench.run(8.0, lambda b: guide(b, there, LocalFrame.LOCAL, NOT_VELOCITY, 0.5))
    np.testing.assert_allclose(bench.truth.pos_lab_m, there, atol=0.05)
    assert bench.truth.q_lab_from_flu[3] == pytest.approx(np.sin(0.25), abs=0.02)
    assert bench.core.autopilot.mode is FlightMode.OFFBOARD


def test_px4_takes_off_by_positions() -> None:
    bench = Bench(profile="px4_quad")
    bench.run(3.0)

    def above(b: Bench) -> PositionSetpoint:
        return guide(b, (0.0, 0.0, 1.0), LocalFrame.LOCAL, NOT_VELOCITY)

    bench.run(1.0, above)
    assert bench.command(176, 1.0, 6.0) is Result.ACCEPTED
    assert bench.command(400, 1.0) is Result.ACCEPTED
    bench.run(5.0, above)
    np.testing.assert_allclose(bench.truth.pos_lab_m, [0.0, 0.0, 1.0], atol=0.05)
    bench.run(3.0)
    assert bench.core.autopilot.mode is FlightMode.POSITION


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_flies_a_velocity_in_lab_and_in_body_axes(autopilot: str) -> None:
    bench = Bench(autopilot=autopilot, profile="px4_quad", start_yaw_rad=np.pi / 2)
    guided(bench)
    bench.run(0.1, lambda b: guide(b, (0.4, 0.0, 0.1), LocalFrame.LOCAL, NOT_POSITION))
    bench.command(176, 1.0, 6.0 if autopilot == "px4" else 4.0)
    bench.run(3.0, lambda b: guide(b, (0.4, 0.0, 0.1), LocalFrame.LOCAL, NOT_POSITION))
    np.testing.assert_allclose(bench.truth.vel_lab_m_s, [0.4, 0.0, 0.1], atol=0.06)
    # Forward, for a vehicle that faces lab left.
    bench.run(3.0, lambda b: guide(b, (0.4, 0.0, 0.0), LocalFrame.BODY, NOT_POSITION))
    np.testing.assert_allclose(bench.truth.vel_lab_m_s, [0.0, 0.4, 0.0], atol=0.06)


def test_ardupilot_goes_where_it_was_told_once() -> None:
    bench = in_the_air("ardupilot")
    bench.send(guide(bench, (0.5, 0.3, 0.4), LocalFrame.LOCAL_OFFSET, NOT_VELOCITY))
    bench.run(8.0)
    np.testing.assert_allclose(bench.truth.pos_lab_m, [0.5, 0.3, 1.2], atol=0.06)
    assert bench.core.autopilot.mode is FlightMode.OFFBOARD


def test_a_velocity_stream_that_dies_ends_in_a_hold() -> None:
    bench = in_the_air("ardupilot")
    bench.run(1.5, lambda b: guide(b, (0.5, 0.0, 0.0), LocalFrame.LOCAL, NOT_POSITION))
    bench.run(2.0)
    assert abs(bench.truth.vel_lab_m_s[0]) < 0.05


@pytest.mark.parametrize("profile", ["paper_40g", "px4_quad"])
def test_body_rates_turn_it_at_that_rate(profile: str) -> None:
    bench = Bench(profile=profile)
    bench.fly_offboard(3.0)
    hover = bench.config.true_vehicle().hover_thrust_norm

    def spin(b: Bench) -> AttitudeSetpoint:
        return AttitudeSetpoint(b.target, 0, LEVEL, np.array([0.0, 0.0, 0.8]), hover, Ignore.ATTITUDE)

    bench.run(1.0, spin)
    assert bench.truth.rate_flu_rad_s[2] == pytest.approx(0.8, rel=0.15)


def test_ardupilot_stops_on_a_target_it_cannot_read() -> None:
    bench = Bench(autopilot="ardupilot", profile="px4_quad", parameters={"GUID_OPTIONS": 8.0})
    bench.fly_offboard(0.8)
    half = AttitudeSetpoint(bench.target, 0, LEVEL, np.zeros(3), 0.5, Ignore.ROLL_RATE)
    bench.send(half)
    assert bench.core.autopilot.task is Task.HOLD
    bench.run(0.1, hover_at(0.8))
    assert bench.core.autopilot.task is Task.EXTERNAL


def test_an_indoor_drone_has_no_place_on_the_globe_until_told() -> None:
    bench = Bench(pose="mocap")
    bench.run(2.0)
    bench.command(512, 49.0)
    assert not bench.of(Origin)
    bench.send(SetOrigin(1, 48.0, 11.0, 500.0))
    assert bench.last(Origin).lat_deg == pytest.approx(48.0)
    bench.run(1.0)
    assert bench.last(GlobalPosition).lat_deg == pytest.approx(48.0, abs=1e-6)


def test_intervals_are_told() -> None:
    bench = Bench()
    for number, interval in ((31, 20000), (32, 33333), (83, -1), (9999, 0)):
        assert bench.command(510, float(number)) is Result.ACCEPTED
        assert bench.last(MessageInterval) == MessageInterval(number, interval)


def test_the_true_state_is_told_where_asked() -> None:
    bench = Bench(start_lab_m=(1.0, 0.0, 0.0))
    bench.command(511, 115.0, 40000.0)
    bench.run(1.0)
    north_m = (bench.last(SimTruth).lat_deg - 47.397742) * 111319.49
    assert north_m == pytest.approx(1.0, abs=0.02)
