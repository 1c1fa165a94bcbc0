"""ArduCopter 4.6: its modes' numbers, and the parameters that matter for guided flight on an external pose."""

from functools import partial
from types import MappingProxyType

from wire.autopilots.table import AutopilotTable, FlightMode, ModeNumber, by_name, real, whole
from wire.link_messages import MavAutopilot, ParamType

THRUST_AS_THRUST = 8
"""Bit of GUID_OPTIONS: SET_ATTITUDE_TARGET's thrust is thrust, not a climb rate."""


def _mode(number: int, name: str) -> ModeNumber:
    return ModeNumber(number, 0, name, name)


_MODES = {
    FlightMode.STABILIZED: _mode(0, "STABILIZE"),
    FlightMode.ACRO: _mode(1, "ACRO"),
    FlightMode.ALTITUDE: _mode(2, "ALT_HOLD"),
    FlightMode.MISSION: _mode(3, "AUTO"),
    FlightMode.OFFBOARD: _mode(4, "GUIDED"),
    FlightMode.HOLD: _mode(5, "LOITER"),
    FlightMode.RETURN: _mode(6, "RTL"),
    FlightMode.LAND: _mode(9, "LAND"),
    FlightMode.DESCEND: _mode(9, "LAND"),
    FlightMode.POSITION: _mode(16, "POSHOLD"),
    FlightMode.BRAKE: _mode(17, "BRAKE"),
    FlightMode.OFFBOARD_NO_POSITION: _mode(20, "GUIDED_NOGPS"),
}
_byte = partial(whole, kind=ParamType.INT8)
_short = partial(whole, kind=ParamType.INT16)
_long = partial(whole, kind=ParamType.INT32)

_PARAMETERS = (
    _byte("AHRS_EKF_TYPE", 3, 0, 11, "estimator: 3 EKF3"),
    _short("ANGLE_MAX", 3000, 1000, 8000, "tilt limit, cdeg"),
    _long("ARMING_CHECK", 1, 0, 1048575, "arming checks: 1 all"),
    _byte("ARMING_REQUIRE", 1, 0, 1, "arming required"),
    real("ATC_ACCEL_P_MAX", 110000.0, 0.0, 180000.0, "pitch acceleration, cdeg/s^2"),
    real("ATC_ACCEL_R_MAX", 110000.0, 0.0, 180000.0, "roll acceleration, cdeg/s^2"),
    real("ATC_ACCEL_Y_MAX", 27000.0, 0.0, 72000.0, "yaw acceleration, cdeg/s^2"),
    real("ATC_ANG_PIT_P", 4.5, 3.0, 12.0, "pitch gain, 1/s"),
    real("ATC_ANG_RLL_P", 4.5, 3.0, 12.0, "roll gain, 1/s"),
    real("ATC_ANG_YAW_P", 4.5, 3.0, 12.0, "yaw gain, 1/s"),
    real("ATC_INPUT_TC", 0.15, 0.0, 1.0, "input smoothing, s"),
    real("ATC_RAT_PIT_P", 0.135, 0.01, 0.5, "pitch rate gain"),
    real("ATC_RAT_RLL_P", 0.135, 0.01, 0.5, "roll rate gain"),
    real("ATC_RAT_YAW_P", 0.18, 0.1, 2.5, "yaw rate gain"),
    _long("BATT_CAPACITY", 3300, 0, 1000000, "mAh"),
    real("BATT_CRT_MAH", 0.0, 0.0, 1000000.0, "critical battery, mAh left; 0 off"),
    _byte("BATT_FS_CRT_ACT", 0, 0, 7, "critical battery: 0 none, 1 land, 2 RTL"),
    _byte("BATT_FS_LOW_ACT", 0, 0, 7, "low battery: 0 none, 1 land, 2 RTL"),
    real("BATT_LOW_MAH", 0.0, 0.0, 1000000.0, "low battery, mAh left; 0 off"),
    real("BATT_LOW_VOLT", 10.5, 0.0, 120.0, "low battery, V; 0 off"),
    _byte("BATT_MONITOR", 4, 0, 31, "battery monitor: 4 voltage and current"),
    _byte("COMPASS_ENABLE", 1, 0, 1, "compass"),
    _byte("COMPASS_USE", 1, 0, 1, "compass for heading"),
    _byte("DISARM_DELAY", 10, 0, 127, "disarm on the ground after, s; 0 off"),
    _byte("EK3_ENABLE", 1, 0, 1, "EKF3"),
    _byte("EK3_SRC1_POSXY", 3, 0, 6, "horizontal position: 3 GPS, 6 external"),
    _byte("EK3_SRC1_POSZ", 1, 0, 6, "height: 1 barometer, 3 GPS, 6 external"),
    _byte("EK3_SRC1_VELXY", 3, 0, 7, "horizontal velocity: 3 GPS, 6 external"),
    _byte("EK3_SRC1_VELZ", 3, 0, 7, "vertical velocity: 3 GPS, 6 external"),
    _byte("EK3_SRC1_YAW", 1, 0, 8, "heading: 1 compass, 6 external"),
    _byte("FENCE_ENABLE", 0, 0, 1, "fence"),
    _byte("FRAME_CLASS", 1, 0, 16, "frame: 1 quad"),
    _byte("FRAME_TYPE", 1, 0, 19, "frame: 1 X"),
    _byte("FS_EKF_ACTION", 1, 0, 3, "estimator lost: 1 land"),
    real("FS_EKF_THRESH", 0.8, 0.0, 1.0, "estimator variance limit"),
    _byte("FS_GCS_ENABLE", 0, 0, 7, "ground station lost: 0 none, 1 RTL, 5 land"),
    real("FS_GCS_TIMEOUT", 5.0, 2.0, 120.0, "ground station lost after, s"),
    _long("FS_OPTIONS", 16, 0, 255, "fail-safe options"),
    _byte("FS_THR_ENABLE", 1, 0, 7, "radio lost"),
    _byte("GPS1_TYPE", 1, 0, 26, "GPS driver: 0 none, 1 automatic"),
    _long("GUID_OPTIONS", 0, 0, 255, "guided: 8 SET_ATTITUDE_TARGET's thrust is thrust, else a climb rate"),
    real("GUID_TIMEOUT", 3.0, 0.1, 5.0, "guided: stop after this silence, s"),
    _short("LAND_ALT_LOW", 1000, 100, 10000, "slow down for landing below, cm"),
    _short("LAND_SPEED", 50, 30, 200, "landing, cm/s"),
    _byte("LOG_DISARMED", 0, 0, 3, "log while disarmed"),
    _byte("MOT_HOVER_LEARN", 2, 0, 2, "learn the hover thrust: 2 and save"),
    real("MOT_SPIN_ARM", 0.1, 0.0, 0.3, "motors armed on the ground"),
    real("MOT_SPIN_MAX", 0.95, 0.9, 1.0, "motors at full thrust"),
    real("MOT_SPIN_MIN", 0.15, 0.0, 0.3, "motors in flight at least"),
    real("MOT_THST_EXPO", 0.65, -1.0, 1.0, "thrust curve: 0 linear, 1 quadratic"),
    real("MOT_THST_HOVER", 0.35, 0.125, 0.6875, "hover thrust"),
    _short("PILOT_SPEED_UP", 250, 50, 500, "pilot's climb, cm/s"),
    real("PSC_POSXY_P", 1.0, 0.5, 2.0, "horizontal position gain, 1/s"),
    real("PSC_POSZ_P", 1.0, 0.5, 4.0, "vertical position gain, 1/s"),
    real("PSC_VELXY_P", 2.0, 0.1, 6.0, "horizontal velocity gain, 1/s"),
    real("PSC_VELZ_P", 5.0, 1.0, 10.0, "vertical velocity gain, 1/s"),
    _long("RTL_ALT", 1500, 30, 300000, "return height, cm"),
    _short("RTL_ALT_FINAL", 0, 0, 1000, "end of a return, cm; 0 lands"),
    real("RTL_CONE_SLOPE", 3.0, 0.5, 10.0, "slope of the return cone"),
    _short("SYSID_MYGCS", 255, 1, 255, "ground station's system"),
    _short("SYSID_THISMAV", 1, 1, 255, "MAVLink system"),
    _short("VISO_DELAY_MS", 10, 0, 250, "external pose delay, ms"),
    _byte("VISO_ORIENT", 0, 0, 40, "camera orientation"),
    real("VISO_POS_M_NSE", 0.2, 0.1, 10.0, "external position noise, m"),
    real("VISO_POS_X", 0.0, -5.0, 5.0, "marker forward of the body's origin, m"),
    real("VISO_POS_Y", 0.0, -5.0, 5.0, "marker right of the body's origin, m"),
    real("VISO_POS_Z", 0.0, -5.0, 5.0, "marker below the body's origin, m"),
    _byte("VISO_TYPE", 0, 0, 3, "external pose: 0 none, 1 MAVLink"),
    real("VISO_YAW_M_NSE", 0.2, 0.05, 1.0, "external heading noise, rad"),
    real("WPNAV_ACCEL", 250.0, 50.0, 500.0, "horizontal acceleration, cm/s^2"),
    real("WPNAV_SPEED", 1000.0, 10.0, 2000.0, "horizontal speed, cm/s"),
    real("WPNAV_SPEED_DN", 150.0, 10.0, 500.0, "descent, cm/s"),
    real("WPNAV_SPEED_UP", 250.0, 10.0, 1000.0, "climb, cm/s"),
)
# Set up for a lab: flown on motion capture alone (what ArduCopter was seen to need), by thrust, landing without
# its ground.
_INDOOR = {
    "GUID_OPTIONS": 8.0, "GUID_TIMEOUT": 0.2, "FS_GCS_ENABLE": 5.0,
    "VISO_TYPE": 1.0, "EK3_SRC1_POSXY": 6.0, "EK3_SRC1_POSZ": 6.0, "EK3_SRC1_VELXY": 0.0, "EK3_SRC1_VELZ": 0.0,
    "EK3_SRC1_YAW": 6.0, "GPS1_TYPE": 0.0, "COMPASS_ENABLE": 0.0, "COMPASS_USE": 0.0,
}  # fmt: skip

ARDUPILOT = AutopilotTable(
    autopilot=MavAutopilot.ARDUPILOT,
    name="ArduPilot",
    modes=MappingProxyType(_MODES),
    join=lambda main, _sub: main,
    split=lambda custom_mode: (custom_mode, 0),
    auto_main=None,
    parameters=MappingProxyType(by_name(_PARAMETERS)),
    indoor=MappingProxyType(_INDOOR),
    system_parameter="SYSID_THISMAV",
    hover_parameter="MOT_THST_HOVER",
    idle_disarm_parameter="DISARM_DELAY",
    read_at_boot=frozenset(
        {"BATT_MONITOR", "COMPASS_ENABLE", "EK3_ENABLE", "FRAME_CLASS", "FRAME_TYPE", "GPS1_TYPE", "VISO_TYPE"}
    ),
    needs_origin=True,
    inertial_delay_s=0.011,  # Butterworth low-pass, 2nd order, of 20 Hz: sqrt(2) / (2 pi 20 Hz) (INS_ACCEL_FILTER)
)
