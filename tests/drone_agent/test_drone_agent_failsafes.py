"""The fail-safes: what happens, and when, as the stream, the pose or the ground goes silent."""

from collections.abc import Callable

import numpy as np
import pytest
from agent_bench import MS, Bench, S, hover_at, idle, target, tilt_rad

from drone_agent.autopilots.model import Task
from drone_agent.flight.estimator import Belief
from drone_agent.flight.flying import Pilot
from formation.maths.frames import IDENTITY
from formation.vehicle.profile import PAPER_40G
from wire.autopilots.table import FlightMode
from wire.link_messages.commands import Result
from wire.link_messages.status import Heartbeat, MavAutopilot

LEAN = np.array([np.cos(0.1), 0.0, np.sin(0.1), 0.0])
GROUND_BEAT = Heartbeat(MavAutopilot.INVALID, 6, 0, 0, 4)


def leaning(bench: Bench) -> object:
    return target(bench, bench.config.true_vehicle().hover_thrust_norm, LEAN)


def silent_since(bench: Bench) -> int:
    return bench.core.autopilot.stream.monitor.last_ns or 0


@pytest.mark.parametrize("pose", ["own", "mocap"])
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_levels_within_a_fifth_of_a_second_of_the_last_setpoint(pose: str, autopilot: str) -> None:
    options = {"GUID_OPTIONS": 8.0} if autopilot == "ardupilot" else {}
    bench = Bench(pose=pose, autopilot=autopilot, parameters=options)
    bench.fly_offboard(1.0)
    bench.run(0.4, leaning)
    assert tilt_rad(bench.truth.q_lab_from_flu) > 0.15
    last_ns = silent_since(bench)
    bench.run(0.08)
    assert bench.core.autopilot.task is Task.EXTERNAL
    bench.run_to(last_ns + 101 * MS)
    assert bench.core.autopilot.task is Task.HOLD
    assert tilt_rad(bench.core.autopilot.airframe.setpoint.q_lab_from_flu) < 1e-6
    bench.run_to(last_ns + 200 * MS)
    assert tilt_rad(bench.truth.q_lab_from_flu) < 0.03
    assert "Setpoints are stale: level and hold" in bench.texts()


@pytest.mark.parametrize(
    "order", [lambda pilot: pilot.drift((0.5, 0.0, 0.0), None), lambda pilot: pilot.follow(IDENTITY, 0.0)]
)
def test_a_new_order_ends_the_hurry_to_be_level(order: Callable[[Pilot], None]) -> None:
    pilot = Pilot(PAPER_40G)
    pilot.begin(Task.HOLD, Belief((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 0.0), level_first=True)
    assert pilot.levelling
    order(pilot)
    assert not pilot.levelling


def test_holds_on_its_own_mocap_feed_then_lands() -> None:
    bench = Bench(pose="mocap")
    bench.fly_offboard(0.5)
    at = bench.truth.pos_lab_m.copy()
    bench.run(0.9)
    assert bench.core.autopilot.mode is FlightMode.OFFBOARD
    np.testing.assert_allclose(bench.truth.pos_lab_m, at, atol=0.03)
    bench.run(5.0)
    assert bench.truth.on_ground
    assert not bench.core.autopilot.armed
    np.testing.assert_allclose(bench.truth.pos_lab_m[:2], at[:2], atol=0.03)


def test_lands_when_stream_and_mocap_stop_together() -> None:
    bench = Bench(pose="mocap")
    bench.fly_offboard(0.5)
    at = bench.truth.pos_lab_m.copy()
    bench.run(8.0, mocap=False)
    assert bench.truth.on_ground
    assert not bench.core.autopilot.armed
    # Blind for four seconds on a biased accelerometer: near, but not exactly, below.
    assert np.hypot(*(bench.truth.pos_lab_m - at)[:2]) < 0.5


def test_takes_the_stream_up_again_when_it_comes_back_in_time() -> None:
    bench = Bench(pose="mocap")
    bench.fly_offboard(0.5)
    bench.run(0.3)
    assert bench.core.autopilot.task is Task.HOLD
    bench.run(0.5, hover_at(0.5))
    assert bench.core.autopilot.task is Task.EXTERNAL
    assert "Setpoints are back" in bench.texts()
    bench.run(1.0, hover_at(0.5))
    assert bench.truth.pos_lab_m[2] == pytest.approx(0.5, abs=0.05)


def test_a_dropout_shorter_than_the_rule_changes_nothing() -> None:
    bench = Bench(pose="mocap")
    bench.fly_offboard(0.5)
    bench.run(0.08)
    bench.run(0.1, hover_at(0.5))
    assert not any("stale" in text for text in bench.texts())


def test_a_stream_that_is_slow_on_purpose_is_not_stale() -> None:
    bench = Bench()
    bench.fly_offboard(0.5)
    hover = hover_at(0.5)
    for _ in range(30):
        bench.run(0.2)
        bench.send(hover(bench))
    quiet_from = len(bench.texts())
    for _ in range(20):
        bench.run(0.2)
        bench.send(hover(bench))
    assert not any("stale" in text for text in bench.texts()[quiet_from:])
    assert bench.core.autopilot.mode is FlightMode.OFFBOARD


def test_px4_by_itself_fails_safe_after_its_own_time_out() -> None:
    bench = Bench(stale_setpoint_s=0.0, parameters={"COM_OF_LOSS_T": 1.0})
    bench.fly_offboard(0.5)
    last_ns = silent_since(bench)
    bench.run_to(last_ns + 990 * MS)
    assert bench.core.autopilot.task is Task.EXTERNAL
    bench.run_to(last_ns + 1001 * MS)
    assert (bench.core.autopilot.mode, bench.core.autopilot.task) == (FlightMode.POSITION, Task.LAND)
    bench.run(1.0)
    beat = bench.last(Heartbeat)
    assert (beat.custom_mode, beat.system_status) == (3 << 16, 5)
    bench.run(7.0, idle)
    assert not bench.core.autopilot.armed


@pytest.mark.parametrize(("action", "mode"), [(4.0, FlightMode.LAND), (5.0, FlightMode.HOLD), (3.0, FlightMode.RETURN)])
def test_px4_offboard_loss_actions(action: float, mode: FlightMode) -> None:
    bench = Bench(stale_setpoint_s=0.0, parameters={"COM_OBL_RC_ACT": action, "COM_OF_LOSS_T": 0.5})
    bench.fly_offboard(0.5)
    bench.run(0.6)
    assert bench.core.autopilot.mode is mode


def test_ardupilot_by_itself_levels_for_ever_and_takes_the_stream_back() -> None:
    bench = Bench(autopilot="ardupilot", stale_setpoint_s=0.0, parameters={"GUID_OPTIONS": 8.0, "GUID_TIMEOUT": 1.0})
    bench.fly_offboard(0.8)
    bench.run(0.3, leaning)
    last_ns = silent_since(bench)
    bench.run_to(last_ns + 990 * MS)
    assert bench.core.autopilot.task is Task.EXTERNAL
    bench.run(20.0)
    assert (bench.core.autopilot.mode, bench.core.autopilot.task) == (FlightMode.OFFBOARD, Task.LEVEL)
    assert tilt_rad(bench.truth.q_lab_from_flu) < 0.01
    assert abs(bench.truth.vel_lab_m_s[2]) < 0.02
    bench.run(0.3, leaning)
    assert bench.core.autopilot.task is Task.EXTERNAL
    assert tilt_rad(bench.truth.q_lab_from_flu) > 0.15


def test_a_lost_position_ends_a_hold() -> None:
    bench = Bench(pose="mocap")
    bench.run(3.0)
    bench.command(400, 1.0)
    bench.command(22)
    bench.run(4.0)
    assert bench.core.autopilot.task is Task.HOLD
    bench.run(1.5, mocap=False)
    assert bench.core.autopilot.task is Task.DESCEND
    assert bench.last(Heartbeat).system_status == 5
    bench.run(9.0, mocap=False)
    assert not bench.core.autopilot.armed


def test_a_lost_ground_station_is_acted_on_where_asked() -> None:
    bench = Bench(parameters={"NAV_DLL_ACT": 3.0, "COM_DL_LOSS_T": 5.0})
    bench.run(3.0)
    bench.send(GROUND_BEAT)
    bench.command(400, 1.0)
    bench.command(22)
    bench.run(4.9)
    assert bench.core.autopilot.mode is FlightMode.HOLD
    bench.run(0.3)
    assert bench.core.autopilot.mode is FlightMode.LAND
    assert "Connection to ground station lost" in bench.texts()


def test_a_process_that_slept_acts_on_the_time_that_passed() -> None:
    bench = Bench(pose="mocap")
    bench.fly_offboard(0.5)
    bench.now_ns += 10 * S
    bench.tick()
    assert not bench.core.autopilot.armed
    assert bench.truth.on_ground
    assert bench.command(400, 1.0) is Result.TEMPORARILY_REJECTED
