"""Commands and modes: the MAV_RESULT of each, for either make, and the words that go with it."""

import numpy as np
import pytest

from tests.drone_agent.agent_harness import Harness, hover_at, idle
from wire.autopilots.table import FlightMode
from wire.link_messages import (
    Address,
    AutopilotVersion,
    CommandAck,
    CommandInt,
    GlobalPosition,
    Heartbeat,
    LogEntry,
    LogRequestList,
    MissionCount,
    MissionRequestList,
    Ping,
    Result,
    SysStatus,
    TimeSync,
)

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


def test_requests_are_acknowledged_first_and_answered_to_who_asks() -> None:
    harness, asker = ready(sysid=7), Address(255, 190)
    harness.heard.clear()
    assert harness.command(REQUEST, 148.0) is Result.ACCEPTED
    assert [type(m) for _, m in harness.heard] == [CommandAck, AutopilotVersion]
    assert harness.last(CommandAck).target == asker
    harness.send(TimeSync(0, 123456789), Ping(42, 7, Address(0, 0)))
    assert harness.last(TimeSync) == TimeSync(harness.now_ns, 123456789, asker)
    assert harness.last(Ping) == Ping(42, 7, asker)
    harness.send(MissionRequestList(harness.target, 1), LogRequestList(harness.target, 0, 0xFFFF))
    assert harness.last(MissionCount) == MissionCount(asker, 0, 1)
    assert harness.last(LogEntry).count == 0


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


def test_termination_stops_for_good() -> None:
    harness = ready()
    assert harness.command(185, 1.0) is Result.DENIED
    harness.command(ARM, 1.0)
    assert harness.command(185, 1.0) is Result.ACCEPTED
    assert not harness.autopilot.armed
    assert harness.command(MODE, 1.0, 4.0, 3.0) is Result.TEMPORARILY_REJECTED


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("interval_us", [np.inf, np.nan, 2.0**31, -3e38])
def test_an_interval_that_is_none_is_refused_and_changes_nothing(autopilot: str, interval_us: float) -> None:
    harness = Harness(autopilot=autopilot)
    harness.run(0.2)
    before = harness.core._schedule.period_ns(32)
    assert harness.command(INTERVAL, 32.0, interval_us) is harness.autopilot.model.no_such_rate
    assert harness.command(510, 32.0) is Result.ACCEPTED
    assert harness.core._schedule.period_ns(32) == before


NIGHTLY = [pytest.param(n, marks=pytest.mark.nightly) for n in (20, 21, 176, 185, 300, 400, 410, 510, 512, 520, 32100)]


@pytest.mark.parametrize("command", [22, 192, 511, 65535, *NIGHTLY])
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
