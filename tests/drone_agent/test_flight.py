"""Flights of the agent by itself and by a stream: physics and what the ground is told."""

import numpy as np
import pytest

from drone_agent.autopilots.model import Task
from drone_agent.flight.autopilot import STREAM_MODES
from tests.drone_agent.agent_harness import Harness, S, hover_at, target, tilt_rad
from wire.autopilots.table import FlightMode
from wire.link_messages.commands import Result
from wire.link_messages.motion import AttitudeQuaternion, LocalPosition
from wire.link_messages.status import Battery, ExtendedSysState, Heartbeat, LandedState, SysStatus


@pytest.mark.parametrize("profile", ["paper_40g", "px4_quad"])
def test_takes_off_holds_and_lands_by_itself(profile: str) -> None:
    harness = Harness(profile=profile, start_lab_m=(0.3, -0.2, 0.0), start_yaw_rad=0.7)
    harness.run(3.0)
    assert harness.command(400, 1.0) is Result.ACCEPTED
    assert harness.command(22, 0, 0, 0, np.nan, np.nan, np.nan, np.nan) is Result.ACCEPTED
    harness.run(1.0)
    assert harness.last(ExtendedSysState).landed is LandedState.TAKEOFF
    harness.run(7.0)
    np.testing.assert_allclose(harness.truth.pos_lab_m, [0.3, -0.2, 2.5], atol=0.03)
    assert harness.autopilot.mode is FlightMode.HOLD
    assert harness.last(ExtendedSysState).landed is LandedState.IN_AIR
    np.testing.assert_allclose(harness.last(LocalPosition).pos_lab_m, harness.truth.pos_lab_m, atol=1e-3)
    assert harness.command(21) is Result.ACCEPTED
    harness.run(8.0)
    assert harness.truth.on_ground
    np.testing.assert_allclose(harness.truth.pos_lab_m, [0.3, -0.2, 0.0], atol=0.03)
    assert not harness.autopilot.armed
    assert harness.last(ExtendedSysState).landed is LandedState.ON_GROUND
    assert [text for text in harness.texts() if "anding" in text or "Takeoff" in text] == [
        "Takeoff detected",
        "Landing at current position",
        "Landing detected",
        "Disarmed by landing",
    ]


def test_lands_softly() -> None:
    harness = Harness(profile="px4_quad")
    harness.run(3.0)
    harness.command(400, 1.0)
    harness.command(22)
    harness.run(8.0)
    harness.command(21)
    speeds = []
    while harness.autopilot.armed:
        harness.run(0.01)
        speeds.append(-harness.truth.vel_lab_m_s[2])
    assert max(speeds) < 0.9
    assert tilt_rad(harness.truth.q_lab_from_flu) < 0.02


def test_holds_its_place_in_a_wind() -> None:
    harness = Harness(profile="paper_40g", disturbance={"wind_lab_m_s2": (0.8, -0.5, 0.0)})
    harness.run(3.0)
    harness.command(400, 1.0)
    harness.command(22)
    harness.run(12.0)
    np.testing.assert_allclose(harness.truth.pos_lab_m, [0.0, 0.0, 2.5], atol=0.05)


def test_follows_attitude_targets_offboard() -> None:
    harness = Harness(profile="paper_40g")
    harness.fly_offboard(0.5)
    assert harness.truth.pos_lab_m[2] == pytest.approx(0.5, abs=0.05)
    tilted = np.array([np.cos(0.05), 0.0, np.sin(0.05), 0.0])
    hover = harness.config.true_vehicle().hover_thrust_norm
    harness.run(0.5, lambda b: target(b, hover, tilted))
    assert tilt_rad(harness.truth.q_lab_from_flu) == pytest.approx(0.1, abs=0.005)
    # Up leans to +x: the vehicle goes there, and says so.
    assert harness.truth.vel_lab_m_s[0] > 0.2
    np.testing.assert_allclose(harness.last(AttitudeQuaternion).q_lab_from_flu, tilted, atol=0.005)


def test_lands_by_the_stream_and_disarms() -> None:
    harness = Harness(profile="paper_40g")
    harness.fly_offboard(0.4)
    harness.run(1.5, hover_at(-0.1))
    assert harness.truth.on_ground
    harness.run(3.0, lambda b: target(b, 0.0))
    assert not harness.autopilot.armed
    assert harness.autopilot.mode in STREAM_MODES


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


def test_heartbeat_tells_mode_and_arming() -> None:
    harness = Harness()
    harness.run(3.0)
    beat = harness.last(Heartbeat)
    assert (beat.custom_mode, beat.base_mode, beat.system_status) == (4 << 16 | 3 << 24, 29, 3)
    harness.command(400, 1.0)
    harness.run(1.1)
    assert harness.last(Heartbeat).base_mode == 29 | 128
    assert harness.last(Heartbeat).system_status == 4
    assert [t for t, m in harness.heard if isinstance(m, Heartbeat)] == [k * S for k in range(5)]


def test_battery_sags_and_warns() -> None:
    harness = Harness(profile="paper_40g", vehicle={"battery": {"capacity_mah": 12.0, "hover_current_a": 4.0}})
    harness.run(2.5)
    full_v = harness.last(SysStatus).battery_v
    harness.command(400, 1.0)
    harness.command(22)
    harness.run(5.0)
    loaded = harness.last(Battery)
    assert full_v - sum(loaded.cell_v) > 0.1
    assert loaded.current_a == pytest.approx(4.0, rel=0.2)
    harness.run(6.5)
    assert "Low battery level" in harness.texts()
    assert "Critical battery level" in harness.texts()


def test_battery_action_lands() -> None:
    pack = {"battery": {"capacity_mah": 9.0, "hover_current_a": 4.0}}
    harness = Harness(profile="paper_40g", vehicle=pack, parameters={"COM_LOW_BAT_ACT": 2.0})
    harness.run(2.5)
    harness.command(400, 1.0)
    harness.command(22)
    harness.run(8.5)
    assert harness.autopilot.task is Task.LAND
    assert harness.last(Heartbeat).system_status == 5
