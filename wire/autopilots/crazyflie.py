"""A Crazyflie as its bridge presents it: MAVLink has no number for its firmware, so HEARTBEAT says a generic autopilot,
with custom modes that no other has.

Modes and the BRIDGE_ parameters are the bridge's, those of CF_ the firmware's, under names that MAVLink can hold.
"""

from math import nan
from types import MappingProxyType

from wire.autopilots.table import AutopilotTable, FlightMode, ModeNumber, by_name, real
from wire.link_messages import MavAutopilot

FIRMWARE_PARAMETERS = MappingProxyType(
    {
        "CF_ESTIMATOR": "stabilizer.estimator",
        "CF_CONTROLLER": "stabilizer.controller",
        "CF_POS_STD": "locSrv.extPosStdDev",
        "CF_ATT_STD": "locSrv.extQuatStdDev",
    }
)
"""By MAVLink name: group and name in the firmware."""
_FIRST_MODE = int.from_bytes(b"CF") << 16
_MODES = {
    mode: ModeNumber(number, 0, mode.name, mode.name.capitalize())
    for number, mode in enumerate(
        (
            FlightMode.HOLD,
            FlightMode.OFFBOARD,
            FlightMode.TAKEOFF,
            FlightMode.LAND,
            FlightMode.DESCEND,
            FlightMode.TERMINATION,
        )
    )
}
_PARAMETERS = (
    real("BRIDGE_SYSID", 1.0, 1.0, 250.0, "MAVLink system"),
    real("BRIDGE_HOVER", 0.5, 0.05, 0.95, "hover thrust of the bridge's own modes, normalised"),
    real("BRIDGE_IDLE_S", 10.0, -1.0, 30.0, "disarm if not taken off, s; <= 0 off"),
    real("CF_ESTIMATOR", nan, 0.0, 3.0, "stabilizer.estimator: 1 complementary, 2 Kalman"),
    real("CF_CONTROLLER", nan, 0.0, 5.0, "stabilizer.controller: 1 PID, 2 Mellinger"),
    real("CF_POS_STD", nan, 0.0, 1.0, "locSrv.extPosStdDev, m"),
    real("CF_ATT_STD", nan, 0.0, 1.0, "locSrv.extQuatStdDev"),
)

CRAZYFLIE = AutopilotTable(
    autopilot=MavAutopilot.GENERIC,
    name="Crazyflie",
    modes=MappingProxyType(_MODES),
    join=lambda main, _sub: _FIRST_MODE + main,
    split=lambda custom_mode: (custom_mode - _FIRST_MODE, 0),
    auto_main=None,
    parameters=MappingProxyType(by_name(_PARAMETERS)),
    indoor=MappingProxyType({"CF_ESTIMATOR": 2.0, "CF_CONTROLLER": 1.0, "CF_POS_STD": 0.01, "CF_ATT_STD": 0.0045}),
    system_parameter="BRIDGE_SYSID",
    hover_parameter="BRIDGE_HOVER",
    idle_disarm_parameter="BRIDGE_IDLE_S",
    read_at_boot=frozenset(),
    needs_origin=False,
    inertial_delay_s=0.0075,  # of its accelerometer's second-order filter of 30 Hz (sensors_bmi088_bmp3xx.c)
)
