"""Numbers and tables against pymavlink, which others wrote."""

from enum import IntEnum

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wire.autopilots.ardupilot import ARDUPILOT
from wire.autopilots.px4 import PX4
from wire.autopilots.table import AutopilotTable, FlightMode
from wire.link_messages import (
    EstimatorFlag,
    LandedState,
    MavAutopilot,
    MavCommand,
    MavFrame,
    MavState,
    MavType,
    MessageId,
    ModeFlag,
    ProtocolCapability,
    SensorFlag,
)

_NAMES = {
    MessageId: "MAVLINK_MSG_ID_{}",
    MavCommand: "MAV_CMD_{}",
    MavFrame: "MAV_FRAME_{}",
    MavAutopilot: "MAV_AUTOPILOT_{}",
    LandedState: "MAV_LANDED_STATE_{}",
    MavState: "MAV_STATE_{}",
    MavType: "MAV_TYPE_{}",
    ModeFlag: "MAV_MODE_FLAG_{}",
    ProtocolCapability: "MAV_PROTOCOL_CAPABILITY_{}",
    SensorFlag: "MAV_SYS_STATUS_SENSOR_{}",
    EstimatorFlag: "ESTIMATOR_{}",
}
_OTHERWISE = {
    SensorFlag.GYRO_3D: "MAV_SYS_STATUS_SENSOR_3D_GYRO",
    SensorFlag.ACCEL_3D: "MAV_SYS_STATUS_SENSOR_3D_ACCEL",
    SensorFlag.MAG_3D: "MAV_SYS_STATUS_SENSOR_3D_MAG",
    SensorFlag.GEOFENCE: "MAV_SYS_STATUS_GEOFENCE",
    SensorFlag.AHRS: "MAV_SYS_STATUS_AHRS",
    SensorFlag.PREARM_CHECK: "MAV_SYS_STATUS_PREARM_CHECK",
    MavAutopilot.ARDUPILOT: "MAV_AUTOPILOT_ARDUPILOTMEGA",
    EstimatorFlag.EKF_UNINITIALIZED: "EKF_UNINITIALIZED",
}


_NEWER: dict[IntEnum, int] = {MavCommand.REQUEST_OPERATOR_CONTROL: 32100}
"""Of development.xml, as MAVProxy has it; pymavlink's release does not know it yet."""


@pytest.mark.parametrize("kind", _NAMES, ids=lambda kind: kind.__name__)
def test_every_number_is_pymavlinks(kind: type[IntEnum]) -> None:
    for member in kind:
        name = next((n for m, n in _OTHERWISE.items() if m is member), _NAMES[kind].format(member.name))
        assert member == getattr(mavlink, name, _NEWER.get(member)), name


def test_ardupilots_modes_are_mavutils() -> None:
    for mode in ARDUPILOT.modes.values():
        assert mavutil.mode_mapping_acm[mode.main] == mode.name


def test_px4s_modes_are_mavutils() -> None:
    theirs = {"TAKEOFF": "TAKEOFF", "HOLD": "LOITER", "MISSION": "MISSION", "RETURN": "RTL", "LAND": "LAND"}
    for meaning, mode in PX4.modes.items():
        if meaning in (FlightMode.TERMINATION, FlightMode.DESCEND):
            continue
        _, main, sub = mavutil.px4_map[theirs.get(mode.name, mode.name)]
        assert (mode.main, mode.sub) == (main, sub), mode.name
        assert PX4.mode_of(main << 16 | sub << 24) is meaning


@pytest.mark.parametrize("table", [PX4, ARDUPILOT], ids=lambda table: table.name)
def test_the_tables_names_are_among_its_parameters(table: AutopilotTable) -> None:
    named = {table.system_parameter, table.hover_parameter, table.idle_disarm_parameter, *table.indoor}
    assert named <= set(table.parameters)
    assert all(table.parameters[name].low <= value <= table.parameters[name].high
               for name, value in table.indoor.items())  # fmt: skip


@pytest.mark.parametrize(
    ("table", "custom_mode", "name"),
    [
        (PX4, 6 << 16, "OFFBOARD"),
        (PX4, 3 << 16 | 1 << 24, "POSCTL"),
        (PX4, 4 << 16 | 9 << 24, "AUTO 9"),
        (PX4, 99 << 16, "MODE 99"),
        (ARDUPILOT, 9, "LAND"),
        (ARDUPILOT, 99, "MODE 99"),
    ],
)
def test_a_mode_is_named_as_ground_stations_show_it(table: AutopilotTable, custom_mode: int, name: str) -> None:
    assert table.mode_name(custom_mode) == name
