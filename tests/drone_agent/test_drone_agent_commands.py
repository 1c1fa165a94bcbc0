"""Commands and modes: the MAV_RESULT of each, for either make, and the words that go with it."""

import numpy as np
import pytest
from agent_bench import Bench, hover_at, idle, target

from wire.autopilots.table import FlightMode
from wire.link_messages.address import Address
from wire.link_messages.clocks import Ping, TimeSync
from wire.link_messages.commands import CommandAck, CommandInt, CommandLong, Result, SetMode
from wire.link_messages.motion import Attitude, AttitudeQuaternion, GlobalPosition, HomePosition, LocalPosition
from wire.link_messages.status import AutopilotVersion, Heartbeat
from wire.link_messages.storage import LogEntry, LogRequestList, MissionCount, MissionRequestList

ARM, MODE, TAKEOFF, LAND, INTERVAL, REQUEST = 400, 176, 22, 21, 511, 512


def ready(autopilot: str = "px4", **config: object) -> Bench:
    bench = Bench(autopilot=autopilot, **config)
    bench.run(3.0)
    return bench


def test_arming_before_the_estimator_is_ready() -> None:
    for autopilot, result, words in [
        ("px4", Result.TEMPORARILY_REJECTED, "Arming denied: Resolve system health failures first"),
        ("ardupilot", Result.FAILED, "Arm: Need Position Estimate: waiting for estimator to initialize"),
    ]:
        bench = Bench(autopilot=autopilot)
        bench.run(0.5)
        bench.command(MODE, 1.0, 4.0, 3.0)
        assert bench.command(ARM, 1.0) is result
        assert words in bench.texts()


def test_px4_offboard_without_a_stream_is_taken_on_the_ground_but_does_not_arm() -> None:
    bench = ready()
    assert bench.command(MODE, 1.0, 6.0) is Result.ACCEPTED
    bench.run(1.1)
    assert (bench.last(Heartbeat).custom_mode, bench.last(Heartbeat).system_status) == (6 << 16, 0)
    assert bench.command(ARM, 1.0) is Result.TEMPORARILY_REJECTED
    assert "Preflight Fail: No offboard signal" in bench.texts()
    bench.run(1.1, idle)
    assert bench.last(Heartbeat).system_status == 3
    assert bench.command(ARM, 1.0) is Result.ACCEPTED


def test_px4_offboard_without_a_stream_is_refused_in_the_air() -> None:
    bench = ready()
    bench.command(ARM, 1.0)
    bench.command(TAKEOFF)
    bench.run(6.0)
    assert bench.command(MODE, 1.0, 6.0) is Result.TEMPORARILY_REJECTED
    assert bench.core.autopilot.mode is FlightMode.HOLD
    bench.run(0.5, hover_at(2.5))
    assert bench.command(MODE, 1.0, 6.0) is Result.ACCEPTED


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
    bench = ready()
    for main, sub in ((3.0, 0.0), (4.0, 6.0), (4.0, 4.0)):
        bench.command(MODE, 1.0, main, sub)
        assert bench.command(ARM, 1.0) is Result.TEMPORARILY_REJECTED


def test_ardupilot_takes_off_only_in_guided_and_armed() -> None:
    bench = ready("ardupilot")
    assert bench.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 1.5) is Result.FAILED
    assert bench.command(ARM, 1.0) is Result.ACCEPTED
    assert bench.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 1.5) is Result.FAILED
    assert bench.command(MODE, 1.0, 4.0) is Result.ACCEPTED
    assert bench.command(TAKEOFF, 0, 0, 0, 0, 0, 0, -1.0) is Result.FAILED
    assert bench.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 1.5) is Result.ACCEPTED
    bench.run(8.0)
    np.testing.assert_allclose(bench.truth.pos_lab_m, [0.0, 0.0, 1.5], atol=0.05)
    assert bench.core.autopilot.mode is FlightMode.OFFBOARD
    assert bench.command(ARM, 0.0) is Result.FAILED
    assert bench.command(LAND) is Result.ACCEPTED
    bench.run(8.0)
    assert not bench.core.autopilot.armed
    assert bench.command(ARM, 1.0) is Result.ACCEPTED


def test_ardupilot_reads_thrust_as_a_climb_rate_unless_told() -> None:
    bench = ready("ardupilot", parameters={"WPNAV_SPEED_UP": 100.0, "WPNAV_SPEED_DN": 50.0})
    bench.command(MODE, 1.0, 4.0)
    bench.command(ARM, 1.0)
    bench.run(3.0, lambda b: target(b, 0.5))
    assert bench.truth.on_ground
    bench.run(3.0, lambda b: target(b, 0.75))
    assert bench.truth.vel_lab_m_s[2] == pytest.approx(0.5, abs=0.05)
    bench.run(2.0, lambda b: target(b, 0.5))
    assert bench.truth.vel_lab_m_s[2] == pytest.approx(0.0, abs=0.03)
    bench.run(1.5, lambda b: target(b, 0.0))
    assert bench.truth.vel_lab_m_s[2] == pytest.approx(-0.5, abs=0.05)


def test_ardupilot_refuses_to_arm_in_land_mode_and_forces_where_asked() -> None:
    bench = ready("ardupilot")
    bench.command(MODE, 1.0, 9.0)
    assert bench.command(ARM, 1.0) is Result.FAILED
    assert "Arm: LAND mode not armable" in bench.texts()
    assert bench.command(ARM, 1.0, 2989.0) is Result.ACCEPTED


@pytest.mark.parametrize(("autopilot", "rate", "message"), [("px4", 4, 2), ("ardupilot", 2, 4)])
def test_unknown_things_are_refused_as_the_make_refuses_them(autopilot: str, rate: int, message: int) -> None:
    bench = ready(autopilot)
    assert bench.command(31999) is Result.UNSUPPORTED
    assert bench.command(INTERVAL, 9999.0, 10000.0) == rate
    assert bench.command(REQUEST, 9999.0) == message
    assert bench.command(ARM, 5.0) is Result.UNSUPPORTED


def test_a_message_comes_at_the_rate_asked() -> None:
    bench = ready("ardupilot")
    assert bench.command(INTERVAL, 31.0, 20000.0) is Result.ACCEPTED
    bench.heard.clear()
    bench.run(2.0)
    assert len(bench.of(AttitudeQuaternion)) == pytest.approx(100, abs=2)
    assert not bench.of(LocalPosition)
    bench.command(INTERVAL, 31.0, -1.0)
    bench.heard.clear()
    bench.run(1.0)
    assert not bench.of(AttitudeQuaternion)
    bench.command(INTERVAL, 30.0, 1e6 / 30.0)
    bench.heard.clear()
    bench.run(3.0)
    assert len(bench.of(Attitude)) == pytest.approx(90, abs=2)


def test_version_and_home_on_request() -> None:
    bench = ready(sysid=7)
    assert bench.command(REQUEST, 148.0) is Result.ACCEPTED
    version = bench.last(AutopilotVersion)
    assert version.flight_sw_version >> 8 == 1 << 16 | 16 << 8 | 1
    assert version.uid == 7
    assert bench.command(REQUEST, 242.0) is Result.ACCEPTED
    assert bench.last(HomePosition).lat_deg == pytest.approx(47.397742, abs=1e-6)


def test_the_acknowledgement_comes_before_what_was_asked_for_and_to_the_asker() -> None:
    bench = ready()
    bench.heard.clear()
    bench.command(REQUEST, 148.0)
    assert [type(m) for _, m in bench.heard][:2] == [CommandAck, AutopilotVersion]
    assert bench.last(CommandAck).target == Address(255, 190)


def test_messages_to_somebody_else_are_ignored() -> None:
    bench = ready()
    bench.heard.clear()
    params = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    bench.send(CommandLong(Address(2, 1), ARM, params), CommandLong(Address(1, 25), ARM, params))
    assert not bench.core.autopilot.armed
    assert not bench.of(CommandAck)
    bench.send(CommandLong(Address(1, 0), ARM, params))
    assert bench.core.autopilot.armed


def test_repositions_by_command_int() -> None:
    bench = ready(profile="px4_quad")
    bench.command(ARM, 1.0)
    bench.command(TAKEOFF)
    bench.run(5.0)
    here = bench.last(GlobalPosition)
    # One metre north is lab +x, one metre east lab -y.
    lat, lon = here.lat_deg + 1.0 / 111319.49, here.lon_deg + 1.0 / (111319.49 * np.cos(np.radians(here.lat_deg)))
    order = CommandInt(
        bench.target, 0, 192, (-1.0, 1.0, 0.0, np.nan), round(lat * 1e7), round(lon * 1e7), here.alt_m - 1.0
    )
    bench.send(order)
    assert bench.last(CommandAck).result is Result.ACCEPTED
    bench.run(6.0)
    np.testing.assert_allclose(bench.truth.pos_lab_m, [1.0, -1.0, 1.5], atol=0.08)


def test_set_mode_message() -> None:
    px4 = ready()
    px4.send(SetMode(1, 1, 4 << 16 | 2 << 24))
    assert (px4.core.autopilot.mode, px4.last(CommandAck).command) == (FlightMode.TAKEOFF, 176)
    copter = ready("ardupilot")
    copter.send(SetMode(1, 1, 4))
    assert (copter.core.autopilot.mode, copter.last(CommandAck).command) == (FlightMode.OFFBOARD, 11)


def test_timesync_and_ping_are_answered() -> None:
    bench = ready()
    bench.send(TimeSync(0, 123456789), Ping(42, 7, Address(0, 0)))
    assert bench.last(TimeSync) == TimeSync(bench.now_ns - bench.t0_ns, 123456789, Address(255, 190))
    assert bench.last(Ping) == Ping(42, 7, Address(255, 190))


def test_says_that_it_stores_no_missions_and_no_logs() -> None:
    bench = ready()
    bench.send(MissionRequestList(bench.target, 1), LogRequestList(bench.target, 0, 0xFFFF))
    assert bench.last(MissionCount) == MissionCount(Address(255, 190), 0, 1)
    assert bench.last(LogEntry).count == 0


def test_termination_stops_for_good() -> None:
    bench = ready()
    assert bench.command(185, 1.0) is Result.DENIED
    bench.command(ARM, 1.0)
    assert bench.command(185, 1.0) is Result.ACCEPTED
    assert not bench.core.autopilot.armed
    assert bench.command(MODE, 1.0, 4.0, 3.0) is Result.TEMPORARILY_REJECTED
