"""Commands and modes: the MAV_RESULT of each, for either make, and the words that go with it."""

import numpy as np
import pytest

from tests.drone_agent.agent_harness import Harness, hover_at, idle, target
from wire.autopilots.table import FlightMode
from wire.link_messages.address import Address
from wire.link_messages.clocks import Ping, TimeSync
from wire.link_messages.commands import CommandAck, CommandInt, CommandLong, Result, SetMode
from wire.link_messages.motion import Attitude, AttitudeQuaternion, GlobalPosition, HomePosition, LocalPosition
from wire.link_messages.status import AutopilotVersion, Heartbeat, SysStatus
from wire.link_messages.storage import LogEntry, LogRequestList, MissionCount, MissionRequestList

ARM, MODE, TAKEOFF, LAND, INTERVAL, REQUEST = 400, 176, 22, 21, 511, 512


def ready(autopilot: str = "px4", **config: object) -> Harness:
    harness = Harness(autopilot=autopilot, **config)
    harness.run(3.0)
    return harness


def test_arming_before_the_estimator_is_ready() -> None:
    for autopilot, result, words in [
        ("px4", Result.TEMPORARILY_REJECTED, "Arming denied: Resolve system health failures first"),
        ("ardupilot", Result.FAILED, "Arm: Need Position Estimate: waiting for estimator to initialize"),
    ]:
        harness = Harness(autopilot=autopilot)
        harness.run(0.5)
        harness.command(MODE, 1.0, 4.0, 3.0)
        assert harness.command(ARM, 1.0) is result
        assert words in harness.texts()


def test_px4_offboard_without_a_stream_is_taken_on_the_ground_but_does_not_arm() -> None:
    harness = ready()
    assert harness.command(MODE, 1.0, 6.0) is Result.ACCEPTED
    harness.run(1.1)
    assert (harness.last(Heartbeat).custom_mode, harness.last(Heartbeat).system_status) == (6 << 16, 0)
    assert harness.command(ARM, 1.0) is Result.TEMPORARILY_REJECTED
    assert "Preflight Fail: No offboard signal" in harness.texts()
    harness.run(1.1, idle)
    assert harness.last(Heartbeat).system_status == 3
    assert harness.command(ARM, 1.0) is Result.ACCEPTED


def test_px4_offboard_without_a_stream_is_refused_in_the_air() -> None:
    harness = ready()
    harness.command(ARM, 1.0)
    harness.command(TAKEOFF)
    harness.run(6.0)
    assert harness.command(MODE, 1.0, 6.0) is Result.TEMPORARILY_REJECTED
    assert harness.autopilot.mode is FlightMode.HOLD
    harness.run(0.5, hover_at(2.5))
    assert harness.command(MODE, 1.0, 6.0) is Result.ACCEPTED


@pytest.mark.parametrize(
    ("autopilot", "params", "result"),
    [
        ("px4", (1.0, 4.0, 99.0), Result.TEMPORARILY_REJECTED),
        ("px4", (1.0, 3.0), Result.ACCEPTED),
        ("ardupilot", (1.0, 77.0), Result.FAILED),
        ("ardupilot", (0.0, 4.0), Result.DENIED),
        ("ardupilot", (1.0, 5.0), Result.ACCEPTED),
    ],
)
def test_mode_requests(autopilot: str, params: tuple[float, ...], result: Result) -> None:
    assert ready(autopilot).command(MODE, *params) is result


def test_px4_does_not_arm_in_a_mode_that_needs_a_pilot_or_lands() -> None:
    harness = ready()
    for main, sub in ((3.0, 0.0), (4.0, 6.0), (4.0, 4.0)):
        harness.command(MODE, 1.0, main, sub)
        assert harness.command(ARM, 1.0) is Result.TEMPORARILY_REJECTED


def test_ardupilot_takes_off_only_in_guided_and_armed() -> None:
    harness = ready("ardupilot")
    assert harness.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 1.5) is Result.FAILED
    assert harness.command(ARM, 1.0) is Result.ACCEPTED
    assert harness.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 1.5) is Result.FAILED
    assert harness.command(MODE, 1.0, 4.0) is Result.ACCEPTED
    assert harness.command(TAKEOFF, 0, 0, 0, 0, 0, 0, -1.0) is Result.FAILED
    assert harness.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 1.5) is Result.ACCEPTED
    harness.run(8.0)
    np.testing.assert_allclose(harness.truth.pos_lab_m, [0.0, 0.0, 1.5], atol=0.05)
    assert harness.autopilot.mode is FlightMode.OFFBOARD
    assert harness.command(ARM, 0.0) is Result.FAILED
    assert harness.command(LAND) is Result.ACCEPTED
    harness.run(8.0)
    assert not harness.autopilot.armed


@pytest.mark.parametrize(("autopilot", "mode"), [("ardupilot", FlightMode.LAND), ("px4", FlightMode.HOLD)])
def test_the_mode_after_a_landing_is_the_makes_own(autopilot: str, mode: FlightMode) -> None:
    """ArduCopter's disarm leaves the mode alone, and its LAND does not arm; PX4 goes back to the one before."""
    harness = ready(autopilot, profile="px4_quad")
    if autopilot == "ardupilot":
        harness.command(MODE, 1.0, 4.0)
    harness.command(ARM, 1.0)
    harness.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 1.0)
    harness.run(6.0)
    harness.command(LAND)
    harness.run(10.0)
    assert not harness.autopilot.armed
    assert harness.autopilot.mode is mode
    if autopilot == "ardupilot":
        assert harness.command(ARM, 1.0) is Result.FAILED
        assert harness.command(MODE, 1.0, 4.0) is Result.ACCEPTED
    assert harness.command(ARM, 1.0) is Result.ACCEPTED


@pytest.mark.parametrize(
    ("autopilot", "on", "told"),
    [("px4", {}, (0, 0, 0)), ("ardupilot", {}, (1, 0, 1)), ("ardupilot", {"FENCE_ENABLE": 1.0}, (1, 1, 1))],
)
def test_the_fence_is_told_of_as_the_make_does(autopilot: str, on: dict, told: tuple[int, int, int]) -> None:
    """MAVProxy calls a fence that is not healthy breached: ArduCopter says that it is, PX4 says nothing of one."""
    status = ready(autopilot, parameters=on).last(SysStatus)
    flags = (status.sensors_present, status.sensors_enabled, status.sensors_healthy)
    assert tuple(flag >> 20 & 1 for flag in flags) == told


def test_ardupilot_reads_thrust_as_a_climb_rate_unless_told() -> None:
    harness = ready("ardupilot", parameters={"WPNAV_SPEED_UP": 100.0, "WPNAV_SPEED_DN": 50.0})
    harness.command(MODE, 1.0, 4.0)
    harness.command(ARM, 1.0)
    harness.run(3.0, lambda b: target(b, 0.5))
    assert harness.truth.on_ground
    harness.run(3.0, lambda b: target(b, 0.75))
    assert harness.truth.vel_lab_m_s[2] == pytest.approx(0.5, abs=0.05)
    harness.run(2.0, lambda b: target(b, 0.5))
    assert harness.truth.vel_lab_m_s[2] == pytest.approx(0.0, abs=0.03)
    harness.run(1.5, lambda b: target(b, 0.0))
    assert harness.truth.vel_lab_m_s[2] == pytest.approx(-0.5, abs=0.05)


def test_ardupilot_refuses_to_arm_in_land_mode_and_forces_where_asked() -> None:
    harness = ready("ardupilot")
    harness.command(MODE, 1.0, 9.0)
    assert harness.command(ARM, 1.0) is Result.FAILED
    assert "Arm: LAND mode not armable" in harness.texts()
    assert harness.command(ARM, 1.0, 2989.0) is Result.ACCEPTED


@pytest.mark.parametrize(("autopilot", "rate", "message"), [("px4", 4, 2), ("ardupilot", 2, 4)])
def test_unknown_things_are_refused_as_the_make_refuses_them(autopilot: str, rate: int, message: int) -> None:
    harness = ready(autopilot)
    assert harness.command(31999) is Result.UNSUPPORTED
    assert harness.command(INTERVAL, 9999.0, 10000.0) == rate
    assert harness.command(REQUEST, 9999.0) == message
    assert harness.command(ARM, 5.0) is Result.UNSUPPORTED


def test_a_message_comes_at_the_rate_asked() -> None:
    harness = ready("ardupilot")
    assert harness.command(INTERVAL, 31.0, 20000.0) is Result.ACCEPTED
    harness.heard.clear()
    harness.run(2.0)
    assert len(harness.of(AttitudeQuaternion)) == pytest.approx(100, abs=2)
    assert not harness.of(LocalPosition)
    harness.command(INTERVAL, 31.0, -1.0)
    harness.heard.clear()
    harness.run(1.0)
    assert not harness.of(AttitudeQuaternion)
    harness.command(INTERVAL, 30.0, 1e6 / 30.0)
    harness.heard.clear()
    harness.run(3.0)
    assert len(harness.of(Attitude)) == pytest.approx(90, abs=2)


def test_version_and_home_on_request() -> None:
    harness = ready(sysid=7)
    assert harness.command(REQUEST, 148.0) is Result.ACCEPTED
    version = harness.last(AutopilotVersion)
    assert version.flight_sw_version >> 8 == 1 << 16 | 16 << 8 | 1
    assert version.uid == 7
    assert harness.command(REQUEST, 242.0) is Result.ACCEPTED
    assert harness.last(HomePosition).lat_deg == pytest.approx(47.397742, abs=1e-6)


def test_the_acknowledgement_comes_before_what_was_asked_for_and_to_the_asker() -> None:
    harness = ready()
    harness.heard.clear()
    harness.command(REQUEST, 148.0)
    assert [type(m) for _, m in harness.heard][:2] == [CommandAck, AutopilotVersion]
    assert harness.last(CommandAck).target == Address(255, 190)


def test_messages_to_somebody_else_are_ignored() -> None:
    harness = ready()
    harness.heard.clear()
    params = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    harness.send(CommandLong(Address(2, 1), ARM, params), CommandLong(Address(1, 25), ARM, params))
    assert not harness.autopilot.armed
    assert not harness.of(CommandAck)
    harness.send(CommandLong(Address(1, 0), ARM, params))
    assert harness.autopilot.armed


def test_repositions_by_command_int() -> None:
    harness = ready(profile="px4_quad")
    harness.command(ARM, 1.0)
    harness.command(TAKEOFF)
    harness.run(5.0)
    here = harness.last(GlobalPosition)
    # One metre north is lab +x, one metre east lab -y.
    lat, lon = here.lat_deg + 1.0 / 111319.49, here.lon_deg + 1.0 / (111319.49 * np.cos(np.radians(here.lat_deg)))
    order = CommandInt(
        harness.target, 0, 192, (-1.0, 1.0, 0.0, np.nan), round(lat * 1e7), round(lon * 1e7), here.alt_m - 1.0
    )
    harness.send(order)
    assert harness.last(CommandAck).result is Result.ACCEPTED
    harness.run(6.0)
    np.testing.assert_allclose(harness.truth.pos_lab_m, [1.0, -1.0, 1.5], atol=0.08)


def test_set_mode_message() -> None:
    px4 = ready()
    px4.send(SetMode(1, 1, 4 << 16 | 2 << 24))
    assert (px4.autopilot.mode, px4.last(CommandAck).command) == (FlightMode.TAKEOFF, 176)
    copter = ready("ardupilot")
    copter.send(SetMode(1, 1, 4))
    assert (copter.autopilot.mode, copter.last(CommandAck).command) == (FlightMode.OFFBOARD, 11)


def test_timesync_and_ping_are_answered() -> None:
    harness = ready()
    harness.send(TimeSync(0, 123456789), Ping(42, 7, Address(0, 0)))
    assert harness.last(TimeSync) == TimeSync(harness.now_ns - harness.t0_ns, 123456789, Address(255, 190))
    assert harness.last(Ping) == Ping(42, 7, Address(255, 190))


def test_says_that_it_stores_no_missions_and_no_logs() -> None:
    harness = ready()
    harness.send(MissionRequestList(harness.target, 1), LogRequestList(harness.target, 0, 0xFFFF))
    assert harness.last(MissionCount) == MissionCount(Address(255, 190), 0, 1)
    assert harness.last(LogEntry).count == 0


def test_termination_stops_for_good() -> None:
    harness = ready()
    assert harness.command(185, 1.0) is Result.DENIED
    harness.command(ARM, 1.0)
    assert harness.command(185, 1.0) is Result.ACCEPTED
    assert not harness.autopilot.armed
    assert harness.command(MODE, 1.0, 4.0, 3.0) is Result.TEMPORARILY_REJECTED


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("interval_us", [np.inf, -np.inf, np.nan, 5e15, 2.0**31, 3e38, -3e38])
def test_an_interval_that_is_none_is_refused_and_changes_nothing(autopilot: str, interval_us: float) -> None:
    harness = Harness(autopilot=autopilot)
    harness.run(0.2)
    before = harness.core._schedule.period_ns(32)
    assert harness.command(INTERVAL, 32.0, interval_us) is harness.autopilot.model.no_such_rate
    assert harness.command(510, 32.0) is Result.ACCEPTED
    assert harness.core._schedule.period_ns(32) == before


@pytest.mark.parametrize("command", [20, 21, 22, 176, 185, 192, 300, 400, 410, 510, 511, 512, 520, 32100, 65535])
def test_no_number_of_a_command_ends_the_agent(command: int) -> None:
    """Each is answered, and the drone flies on."""
    harness = ready()
    harness.command(MODE, 1.0, 4.0, 2.0)
    harness.command(ARM, 1.0)
    harness.command(TAKEOFF)
    harness.run(2.0)
    for value in (np.nan, np.inf, -np.inf, 3e38, -3e38, 1e30, 1e10, -1.0, 1e-45):
        for index in range(7):
            params = [0.0] * 7
            params[index] = value
            assert isinstance(harness.command(command, *params), Result)
        assert isinstance(harness.command(command, *[value] * 7), Result)
        harness.run(0.1)
    harness.run(1.0)
    assert np.isfinite(harness.truth.pos_lab_m).all()
