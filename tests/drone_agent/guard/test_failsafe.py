"""The fail-safes: what happens, and when, as the stream, the pose or the ground goes silent, by times and in flight."""

import numpy as np
import pytest

from drone_agent.autopilots.model import Task
from drone_agent.guard.failsafe import STEP_NS, StreamFailsafe, Takeover, Turn
from drone_agent.guard.stages import Stage, Trigger
from formation.maths.frames import rotate
from tests.drone_agent.agent_harness import MS, Harness, S, idle, target, tilt_rad
from wire.autopilots.table import FlightMode
from wire.link_messages import GROUND, CommandAck, Heartbeat, MavAutopilot, Result


def _streamed(failsafe: StreamFailsafe, period_ms: int = 10, last_ms: int = 1000) -> None:
    failsafe.pull(Trigger.ARM, 0)
    failsafe.pull(Trigger.STREAM, 0)
    for ms in range(0, last_ms + 1, period_ms):
        failsafe.follow(GROUND, ms * MS)


def test_holds_when_stale_then_lands() -> None:
    failsafe = StreamFailsafe(0.1, 1.0)
    _streamed(failsafe)
    assert failsafe.deadline_ns == 1100 * MS
    assert failsafe.advance(1100 * MS - 1) is None
    assert failsafe.advance(1100 * MS) is Stage.HOLD
    assert failsafe.deadline_ns == 2100 * MS
    assert failsafe.advance(2100 * MS) is Stage.LAND
    assert failsafe.deadline_ns is None
    assert not failsafe.follow(GROUND, 2110 * MS)
    assert failsafe.stage is Stage.LAND


def test_the_second_setpoint_in_time_ends_a_hold() -> None:
    failsafe = StreamFailsafe(0.1, 1.0)
    _streamed(failsafe)
    failsafe.advance(1200 * MS)
    assert not failsafe.follow(GROUND, 1300 * MS)
    assert failsafe.broken
    assert failsafe.follow(GROUND, 1400 * MS)
    assert failsafe.stage is Stage.FOLLOW
    assert not failsafe.broken
    assert not failsafe.follow(GROUND, 1410 * MS)


def test_a_stream_that_has_become_a_trickle_is_not_followed_again_and_landed_by() -> None:
    failsafe = StreamFailsafe(0.1, 1.0)
    _streamed(failsafe)
    assert failsafe.advance(1100 * MS) is Stage.HOLD
    for ms in range(1170, 2100, 170):
        assert not failsafe.follow(GROUND, ms * MS)
        assert failsafe.advance(ms * MS) is None
    assert failsafe.advance(2100 * MS) is Stage.LAND


def test_a_slow_stream_is_stale_after_three_of_its_periods() -> None:
    failsafe = StreamFailsafe(0.1, None)
    _streamed(failsafe, period_ms=200, last_ms=5000)
    assert failsafe.deadline_ns == 5600 * MS


def test_a_client_of_20_hz_that_misses_its_turn_and_catches_up_is_not_stale() -> None:
    """As MAVSDK's offboard plugin was seen to send beside two busy loops: 105 ms, then 21; it keeps to its raster."""
    failsafe = StreamFailsafe(0.1, 1.0)
    _streamed(failsafe, period_ms=50, last_ms=2000)
    for ms in (2105, 2126, 2150, 2238, 2242, 2300, 2350, 2400, 2505):
        assert failsafe.advance(ms * MS) is None
        assert not failsafe.follow(GROUND, ms * MS)
    assert failsafe.stage is Stage.FOLLOW
    assert failsafe.advance(2655 * MS) is Stage.HOLD


def test_a_fast_stream_that_loses_nine_in_ten_is_stale_as_soon_as_ever() -> None:
    failsafe, rng = StreamFailsafe(0.1, None), np.random.default_rng(4)
    _streamed(failsafe)
    for ms in range(1010, 120_000, 10):
        if rng.random() < 0.1:
            failsafe.follow(GROUND, ms * MS)
            assert failsafe.deadline_ns == (ms + 100) * MS


def test_without_a_pose_a_hold_lands_at_once() -> None:
    failsafe = StreamFailsafe(0.1, 1.0)
    _streamed(failsafe)
    assert failsafe.advance(1099 * MS, no_pose=True) is None
    assert [failsafe.advance(1100 * MS, no_pose=True) for _ in range(3)] == [Stage.HOLD, Stage.DESCEND, None]


def test_an_own_time_out_that_floats_round_up_is_still_the_autopilots() -> None:
    """0.3 s as a MAVLink float is 0.30000001192...: the deadline and the silence must mean the same nanosecond."""
    harness = Harness(parameters={"COM_OF_LOSS_T": 0.3})
    harness.fly_offboard(0.5)
    harness.run(0.5)
    assert "No offboard signal" in harness.texts()
    assert not any("stale" in text for text in harness.texts())


def _taken_over() -> Takeover:
    takeover = Takeover(0.1, 1.0)
    takeover.saw(0, armed=True, offboard=True)
    takeover.stream.follow(GROUND, 0)
    return takeover


def test_the_bridge_holds_lets_down_and_commands_a_landing_until_it_is_taken() -> None:
    takeover = _taken_over()
    assert takeover.due(100 * MS, fed=True, down=False) == Turn((Stage.HOLD,), Stage.HOLD, lands=False)
    assert takeover.deadline_ns() == 100 * MS + STEP_NS
    assert takeover.due(1100 * MS, fed=True, down=False) == Turn((Stage.LAND,), Stage.LAND, lands=False)
    assert takeover.due(2000 * MS, fed=True, down=True) == Turn((), Stage.LAND, lands=True)
    assert takeover.due(2010 * MS, fed=True, down=True) == Turn((), Stage.LAND, lands=False)
    assert takeover.due(2300 * MS, fed=True, down=True) == Turn((), Stage.LAND, lands=True)
    takeover.acknowledged(CommandAck(GROUND, 21, Result.ACCEPTED))
    assert takeover.deadline_ns() is None


def test_the_bridge_without_a_pose_commands_a_landing_at_once() -> None:
    turn = _taken_over().due(100 * MS, fed=False, down=False)
    assert turn == Turn((Stage.HOLD, Stage.DESCEND), Stage.DESCEND, lands=True)


def test_the_bridge_leaves_an_autopilot_alone_whose_mode_it_does_not_know() -> None:
    takeover = _taken_over()
    takeover.mode_unknown()
    assert takeover.deadline_ns() is None
    takeover.saw(500 * MS, armed=True, offboard=False)
    assert takeover.deadline_ns() is None


LEAN = np.array([np.cos(0.1), 0.0, np.sin(0.1), 0.0])
GROUND_BEAT = Heartbeat(MavAutopilot.INVALID, 6, 0, 0, 4)


def leaning(harness: Harness) -> object:
    return target(harness, harness.config.true_vehicle().hover_thrust_norm, LEAN)


def silent_since(harness: Harness) -> int:
    return harness.autopilot.stream.last_ns or 0


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_brakes_within_a_fifth_of_a_second_of_the_last_setpoint(autopilot: str) -> None:
    options = {"GUID_OPTIONS": 8.0} if autopilot == "ardupilot" else {}
    harness = Harness(pose="mocap", autopilot=autopilot, parameters=options)
    harness.fly_offboard(1.0)
    harness.run(0.4, leaning)
    assert tilt_rad(harness.truth.q_lab_from_flu) > 0.15
    last_ns, place = harness.stream.monitor.last_ns or 0, harness.truth.pos_lab_m
    harness.run(0.08)
    assert harness.stream.stage is Stage.FOLLOW
    harness.run_to(last_ns + 101 * MS)
    assert harness.stream.stage is Stage.HOLD
    harness.run(0.1)
    up_lab = rotate(harness.truth.q_lab_from_flu, np.array([0.0, 0.0, 1.0]))
    assert up_lab[0] < 0.03  # it pushes on no more
    harness.run(0.8)
    assert np.linalg.norm(harness.truth.vel_lab_m_s) < 0.15
    assert np.linalg.norm(harness.truth.pos_lab_m - place) < 0.6
    assert "Setpoints are stale: level and hold" in harness.texts()


def test_lands_when_stream_and_mocap_stop_together() -> None:
    harness = Harness(pose="mocap")
    harness.fly_offboard(0.5)
    at = harness.truth.pos_lab_m.copy()
    harness.run(8.0, mocap=False)
    assert harness.truth.on_ground
    assert not harness.autopilot.armed
    # Blind for four seconds on a biased accelerometer: near, but not exactly, below.
    assert np.hypot(*(harness.truth.pos_lab_m - at)[:2]) < 0.5


def test_px4_by_itself_fails_safe_after_its_own_time_out() -> None:
    harness = Harness(parameters={"COM_OF_LOSS_T": 1.0})
    harness.fly_offboard(0.5)
    last_ns = silent_since(harness)
    harness.run_to(last_ns + 990 * MS)
    assert harness.autopilot.task is Task.EXTERNAL
    harness.run_to(last_ns + 1001 * MS)
    assert (harness.autopilot.mode, harness.autopilot.task) == (FlightMode.POSITION, Task.LAND)
    harness.run(1.0)
    beat = harness.last(Heartbeat)
    assert (beat.custom_mode, beat.system_status) == (3 << 16, 5)
    harness.run(7.0, idle)
    assert not harness.autopilot.armed


@pytest.mark.parametrize(("action", "mode"), [(4.0, FlightMode.LAND), (5.0, FlightMode.HOLD), (3.0, FlightMode.RETURN)])
def test_px4_offboard_loss_actions(action: float, mode: FlightMode) -> None:
    harness = Harness(parameters={"COM_OBL_RC_ACT": action, "COM_OF_LOSS_T": 0.5})
    harness.fly_offboard(0.5)
    harness.run(0.6)
    assert harness.autopilot.mode is mode


def test_ardupilot_by_itself_levels_for_ever_and_takes_the_stream_back() -> None:
    options = {"GUID_OPTIONS": 8.0, "GUID_TIMEOUT": 1.0}
    harness = Harness(autopilot="ardupilot", parameters=options)
    harness.fly_offboard(0.8)
    harness.run(0.3, leaning)
    last_ns = silent_since(harness)
    harness.run_to(last_ns + 990 * MS)
    assert harness.autopilot.task is Task.EXTERNAL
    harness.run(20.0)
    assert (harness.autopilot.mode, harness.autopilot.task) == (FlightMode.OFFBOARD, Task.LEVEL)
    assert tilt_rad(harness.truth.q_lab_from_flu) < 0.01
    assert abs(harness.truth.vel_lab_m_s[2]) < 0.02
    harness.run(0.3, leaning)
    assert harness.autopilot.task is Task.EXTERNAL
    assert tilt_rad(harness.truth.q_lab_from_flu) > 0.15


def test_a_lost_ground_station_is_acted_on_where_asked() -> None:
    harness = Harness(parameters={"NAV_DLL_ACT": 3.0, "COM_DL_LOSS_T": 5.0})
    harness.run(3.0)
    harness.send(GROUND_BEAT)
    harness.command(400, 1.0)
    harness.command(22)
    harness.run(4.9)
    assert harness.autopilot.mode is FlightMode.HOLD
    harness.run(0.3)
    assert harness.autopilot.mode is FlightMode.LAND
    assert "Connection to ground station lost" in harness.texts()


def test_a_process_that_slept_acts_on_the_time_that_passed() -> None:
    harness = Harness(pose="mocap")
    harness.fly_offboard(0.5)
    harness.now_ns += 10 * S
    harness.tick()
    assert not harness.autopilot.armed
    assert harness.truth.on_ground
    assert harness.command(400, 1.0) is Result.TEMPORARILY_REJECTED
