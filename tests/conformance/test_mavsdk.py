"""MAVSDK 4 (blocking API) against the agent as a process over UDP: what a lab's own scripts would do."""

import json
import math
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from mavsdk.plugins.action.action import ActionError, ActionResult
from mavsdk.plugins.mavlink_direct.mavlink_direct import MavlinkMessage
from mavsdk.plugins.mocap.mocap import (
    AngleBody,
    AttitudePositionMocap,
    Covariance,
    PositionBody,
    Quaternion,
    VisionPositionEstimate,
)
from mavsdk.plugins.offboard.offboard import Attitude, PositionNedYaw
from mavsdk.plugins.param.param import ParamError
from mavsdk.plugins.telemetry.telemetry import FlightMode, LandedState

from tests.conformance.agent import agent
from tests.conformance.mavsdk_client import Client, client, wait_for_text

pytestmark = pytest.mark.processes


@pytest.fixture
def drone(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Client]:
    keys = getattr(request, "param", "profile = 'px4_quad'")
    with agent(tmp_path, keys) as running, client(running) as connected:
        yield connected


def fly_to(drone: Client, height_m: float) -> None:
    drone.be_ready()
    drone.action.set_takeoff_altitude(height_m)
    drone.action.arm()
    drone.action.takeoff()
    drone.first("flight_mode", lambda mode: mode == FlightMode.HOLD)


def test_arms_takes_off_holds_lands_and_disarms_and_telemetry_says_the_same_in_every_form(drone: Client) -> None:
    with drone.stream("status_text") as texts:
        fly_to(drone, 1.3)
        wait_for_text(texts, "Armed by external command")
    assert drone.action.get_takeoff_altitude() == pytest.approx(1.3)
    there = drone.first("position_velocity_ned", lambda p: abs(p.velocity.down_m_s) < 0.02)
    assert -there.position.down_m == pytest.approx(1.3, abs=0.1)
    assert drone.first("landed_state") == LandedState.IN_AIR
    assert drone.first("in_air")
    assert drone.first("position").relative_altitude_m == pytest.approx(1.3, abs=0.1)
    assert drone.first("position").latitude_deg == pytest.approx(47.397742, abs=1e-5)
    assert drone.first("home").latitude_deg == pytest.approx(47.397742, abs=1e-5)
    assert drone.first("attitude_quaternion").w == pytest.approx(1.0, abs=1e-3)
    assert abs(drone.first("attitude_euler").yaw_deg) < 1.0
    pack = drone.first("battery", lambda battery: battery.current_battery_a > 1.0)
    assert 12.0 < pack.voltage_v < 16.9
    assert 50.0 < pack.remaining_percent <= 100.0
    drone.action.hold()
    with pytest.raises(ActionError, match=ActionResult.COMMAND_DENIED.name):
        drone.action.disarm()
    drone.action.land()
    drone.first("flight_mode", lambda mode: mode == FlightMode.LAND)
    drone.first("landed_state", lambda state: state == LandedState.ON_GROUND)
    drone.first("armed", lambda armed: not armed)


def test_flies_offboard_by_the_offboard_plugin_by_attitude_and_by_position(drone: Client) -> None:
    fly_to(drone, 1.5)
    drone.offboard.set_attitude(Attitude(0.0, 0.0, 0.0, 0.49))
    drone.offboard.start()
    drone.first("flight_mode", lambda mode: mode == FlightMode.OFFBOARD)
    drone.offboard.set_attitude(Attitude(5.0, 0.0, 0.0, 0.49))
    # Right side down: it goes right, which is east for a drone that faces north.
    drone.first("attitude_euler", lambda euler: euler.roll_deg == pytest.approx(5.0, abs=0.5))
    drone.first("velocity_ned", lambda v: v.east_m_s > 0.2)
    drone.offboard.stop()
    drone.first("flight_mode", lambda mode: mode == FlightMode.HOLD)
    drone.offboard.set_position_ned(PositionNedYaw(0.8, 0.5, -1.2, 90.0))
    drone.offboard.start()
    there = drone.first(
        "position_velocity_ned", lambda p: math.hypot(p.position.north_m - 0.8, p.position.east_m - 0.5) < 0.1
    )
    assert there.position.down_m == pytest.approx(-1.2, abs=0.2)
    drone.first("attitude_euler", lambda euler: euler.yaw_deg == pytest.approx(90.0, abs=3.0))


def test_flies_offboard_by_a_stream_of_our_own(drone: Client) -> None:
    fly_to(drone, 1.5)
    stop, steady = threading.Event(), threading.Event()

    def stream() -> None:
        start = time.monotonic()
        while not stop.wait(0.02):
            if time.monotonic() - start > 1.0:
                steady.set()
            fields = {
                "time_boot_ms": round((time.monotonic() - start) * 1e3),
                "target_system": 1,
                "target_component": 1,
                "type_mask": 7,
                # Nose down six degrees: it goes forward, north.
                "q": [math.cos(math.radians(3.0)), 0.0, -math.sin(math.radians(3.0)), 0.0],
                "body_roll_rate": 0.0,
                "body_pitch_rate": 0.0,
                "body_yaw_rate": 0.0,
                "thrust": 0.49,
                "thrust_body": [0.0, 0.0, 0.0],
            }
            drone.direct.send_message(MavlinkMessage("SET_ATTITUDE_TARGET", 245, 190, 1, 1, json.dumps(fields)))

    sender = threading.Thread(target=stream)
    sender.start()
    try:
        assert steady.wait(10.0)
        set_mode(drone, 6.0)
        drone.first("flight_mode", lambda mode: mode == FlightMode.OFFBOARD)
        drone.first("velocity_ned", lambda v: v.north_m_s > 0.3)
    finally:
        stop.set()
        sender.join(5.0)
    # Nobody streams any more: PX4's fail-safe takes it down.
    drone.first("armed", lambda armed: not armed)


def set_mode(drone: Client, main: float) -> None:
    fields = {"target_system": 1, "target_component": 1, "command": 176, "confirmation": 0, "param1": 1.0,
              "param2": main, "param3": 0.0, "param4": 0.0, "param5": 0.0, "param6": 0.0, "param7": 0.0}  # fmt: skip
    drone.direct.send_message(MavlinkMessage("COMMAND_LONG", 245, 190, 1, 1, json.dumps(fields)))


def test_tells_who_it_is_its_health_and_parameters_and_telemetry_at_the_rate_asked(drone: Client) -> None:
    version = drone.info.get_version()
    assert (version.flight_sw_major, version.flight_sw_minor) == (1, 16)
    assert drone.info.get_identification().legacy_uid == 1
    everything = drone.param.get_all_params()
    integers = {p.name: p.value for p in everything.int_params}
    reals = {p.name: p.value for p in everything.float_params}
    assert integers["MAV_SYS_ID"] == 1
    assert reals["COM_OF_LOSS_T"] == 1.0
    drone.param.set_param_int("COM_OBL_RC_ACT", 4)
    assert drone.param.get_param_int("COM_OBL_RC_ACT") == 4
    drone.param.set_param_float("MPC_LAND_SPEED", 0.65)
    assert drone.param.get_param_float("MPC_LAND_SPEED") == pytest.approx(0.65)
    with pytest.raises(ParamError):
        drone.param.get_param_int("NO_SUCH_PARAM")
    drone.be_ready()
    assert drone.first("health_all_ok", lambda ok: ok)
    for name, rate_hz in (("attitude_euler", 40.0), ("position_velocity_ned", 20.0), ("attitude_quaternion", 10.0)):
        getattr(drone.telemetry, f"set_rate_{name}")(rate_hz)
        with drone.stream(name) as values:
            values.get(timeout=5.0)
            start = time.monotonic()
            for _ in range(round(5.0 * rate_hz)):
                values.get(timeout=5.0)
            found_hz = 5.0 * rate_hz / (time.monotonic() - start)
        assert found_hz == pytest.approx(rate_hz, rel=0.2)  # a stall of a second is not made up for


@pytest.mark.parametrize("drone", ["pose = 'mocap'"], indirect=True)
def test_flies_on_a_mocap_pose_and_not_without(drone: Client) -> None:
    assert not drone.first("health").is_armable
    with drone.stream("status_text") as texts:
        with pytest.raises(ActionError) as denied:
            drone.action.arm()
        assert denied.value.result == ActionResult.COMMAND_DENIED
        wait_for_text(texts, "no external pose")
    # PX4 does not fuse ATT_POS_MOCAP.
    for _ in range(10):
        pose = AttitudePositionMocap(
            0, Quaternion(1.0, 0.0, 0.0, 0.0), PositionBody(0.0, 0.0, 0.0), Covariance([math.nan])
        )
        drone.mocap.set_attitude_position_mocap(pose)
    assert not drone.first("health").is_local_position_ok
    stop = threading.Event()

    def stream() -> None:
        while not stop.wait(0.02):
            pose = VisionPositionEstimate(
                0, PositionBody(0.5, 0.25, 0.0), AngleBody(0.0, 0.0, 0.0), Covariance([math.nan]), 0
            )
            drone.mocap.set_vision_position_estimate(pose)

    sender = threading.Thread(target=stream)
    sender.start()
    try:
        health = drone.first("health", lambda health: health.is_armable)
        assert health.is_local_position_ok
        assert not health.is_global_position_ok
        here = drone.first("position_velocity_ned").position
        assert (here.north_m, here.east_m) == pytest.approx((0.5, 0.25), abs=0.02)
        drone.action.arm()
        drone.first("armed", lambda armed: armed)
    finally:
        stop.set()
        sender.join(5.0)
