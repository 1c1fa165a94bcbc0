"""pymavlink's mavutil against both makes of agent over UDP: the way most scripts in labs are written."""

import math
import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.conformance.agent import START_S, Agent, agent

pytestmark = pytest.mark.processes
MAKES = ["px4", "ardupilot"]
WAIT_S = 30.0


class Script:
    """What a lab's script does with mavutil, each wait bounded."""

    def __init__(self, running: Agent) -> None:
        self.link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{running.ground_port}", source_system=255)
        assert self.link.wait_heartbeat(timeout=START_S) is not None, "no heartbeat"

    def first(self, kind: str, wanted: Callable[[Any], bool] = lambda message: True) -> Any:
        end = time.monotonic() + WAIT_S
        message = None
        while (left_s := end - time.monotonic()) > 0.0:
            message = self.link.recv_match(type=kind, blocking=True, timeout=left_s)
            if message is not None and wanted(message):
                return message
        raise AssertionError(f"no {kind} as wanted; the last was {message}")

    def command(self, number: int, *params: float) -> int:
        filled = (*params, *(0.0,) * (7 - len(params)))
        self.link.mav.command_long_send(self.link.target_system, 1, number, 0, *filled)
        return int(self.first("COMMAND_ACK", lambda ack: ack.command == number).result)

    def be_ready(self) -> None:
        prearm = mavlink.MAV_SYS_STATUS_PREARM_CHECK
        self.first("SYS_STATUS", lambda status: status.onboard_control_sensors_health & prearm)

    def ask_for(self, message: int, rate_hz: float) -> None:
        assert self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message, 1e6 / rate_hz) == 0

    def wait_disarmed(self) -> None:
        self.first("HEARTBEAT", lambda beat: not beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)


@pytest.fixture
def script(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Script]:
    with agent(tmp_path, f"profile = 'px4_quad'\nautopilot = '{request.param}'", sysid=3) as running:
        opened = Script(running)
        yield opened
        opened.link.close()


def both(function: Callable[..., None]) -> Callable[..., None]:
    return pytest.mark.parametrize("script", MAKES, indirect=True)(function)


@both
def test_is_recognised_and_lists_and_sets_parameters(script: Script) -> None:
    assert script.link.target_system == 3
    assert script.first("HEARTBEAT").get_srcComponent() == 1
    assert {"OFFBOARD", "GUIDED"} & set(script.link.mode_mapping())
    script.link.param_fetch_all()
    count = script.first("PARAM_VALUE").param_count
    names = {script.first("PARAM_VALUE").param_id for _ in range(count - 1)}
    assert len(names) == count - 1
    name = "MIS_TAKEOFF_ALT" if "MIS_TAKEOFF_ALT" in names else "GUID_TIMEOUT"
    script.link.mav.param_set_send(3, 1, name.encode(), 1.25, mavlink.MAV_PARAM_TYPE_REAL32)
    assert script.first("PARAM_VALUE", lambda value: value.param_id == name).param_value == 1.25
    if name == "MIS_TAKEOFF_ALT":  # PX4's integers ride bytewise
        script.link.param_fetch_one("MAV_SYS_ID")
        value = script.first("PARAM_VALUE", lambda value: value.param_id == "MAV_SYS_ID").param_value
        assert struct.unpack("<i", struct.pack("<f", value))[0] == 3


@pytest.mark.parametrize("script", ["px4"], indirect=True)
def test_px4_flies_by_its_modes(script: Script) -> None:
    script.be_ready()
    script.link.arducopter_arm()
    assert script.first("COMMAND_ACK").result == 0
    script.link.set_mode("TAKEOFF")
    script.first("LOCAL_POSITION_NED", lambda p: p.z < -2.3)
    script.link.set_mode("LAND")
    script.wait_disarmed()


@pytest.mark.parametrize("script", ["ardupilot"], indirect=True)
def test_ardupilot_flies_guided(script: Script) -> None:
    script.first("EKF_STATUS_REPORT", lambda report: report.flags & 0x10 and not report.flags & 0x400)
    script.link.set_mode("GUIDED")
    script.first("HEARTBEAT", lambda beat: beat.custom_mode == 4)
    script.link.arducopter_arm()
    script.link.motors_armed_wait()
    script.ask_for(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 20.0)
    assert script.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 1.5) == 0
    script.first("LOCAL_POSITION_NED", lambda p: p.z < -1.4)
    script.link.set_mode("LAND")
    script.wait_disarmed()


@pytest.mark.parametrize("script", ["ardupilot"], indirect=True)
def test_ardupilot_follows_attitude_targets_by_climb_rate_and_by_thrust(script: Script) -> None:
    script.first("EKF_STATUS_REPORT", lambda report: report.flags & 0x10)
    script.link.set_mode("GUIDED")
    script.first("HEARTBEAT", lambda beat: beat.custom_mode == 4)
    script.ask_for(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 20.0)
    script.link.arducopter_arm()
    script.link.motors_armed_wait()
    stream_until(script, 0.7, 0.0, lambda p: p.z < -1.0 and p.vz < -0.6)
    stream_until(script, 0.5, 0.0, lambda p: abs(p.vz) < 0.05)
    script.link.mav.param_set_send(3, 1, b"GUID_OPTIONS", 8.0, mavlink.MAV_PARAM_TYPE_INT32)
    script.first("PARAM_VALUE", lambda value: value.param_id == "GUID_OPTIONS" and value.param_value == 8.0)
    stream_until(script, 0.49, -0.1, lambda p: p.vx > 0.4)
    script.link.set_mode("LAND")
    script.wait_disarmed()


def stream_until(script: Script, thrust: float, pitch_rad: float, wanted: Callable[[Any], bool]) -> None:
    """One attitude target for each position heard, until the position is as wanted."""
    q = [math.cos(0.5 * pitch_rad), 0.0, math.sin(0.5 * pitch_rad), 0.0]

    def answer(position: Any) -> bool:
        script.link.mav.set_attitude_target_send(position.time_boot_ms, 3, 1, 7, q, 0.0, 0.0, 0.0, thrust)
        return wanted(position)

    script.first("LOCAL_POSITION_NED", answer)


@both
def test_hears_only_its_own_number_and_says_no_in_the_words_of_its_make(script: Script) -> None:
    script.be_ready()
    script.link.mav.command_long_send(4, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
    script.link.mav.command_long_send(3, 25, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
    # What follows is answered, what came before was not.
    script.link.mav.command_long_send(3, 1, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, 148, 0, 0, 0, 0, 0, 0)
    assert script.first("COMMAND_ACK").command == mavlink.MAV_CMD_REQUEST_MESSAGE
    assert not script.first("HEARTBEAT").base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    px4 = "OFFBOARD" in script.link.mode_mapping()
    assert script.command(31999) == mavlink.MAV_RESULT_UNSUPPORTED
    script.link.set_mode("LAND" if px4 else "RTL")
    result = script.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
    assert result == (mavlink.MAV_RESULT_TEMPORARILY_REJECTED if px4 else mavlink.MAV_RESULT_FAILED)
    words = "Mode Land does not allow arming" if px4 else "RTL mode not armable"
    script.first("STATUSTEXT", lambda text: words in text.text)
