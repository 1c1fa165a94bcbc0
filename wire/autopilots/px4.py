"""PX4 v1.16: its modes' numbers, and the parameters that matter for off-board flight on an external pose."""

from types import MappingProxyType

from wire.autopilots.table import AutopilotTable, FlightMode, ModeNumber, by_name, real, whole
from wire.link_messages import MavAutopilot

MAIN_AUTO = 4


def _join(main: int, sub: int) -> int:
    return main << 16 | sub << 24


def _split(custom_mode: int) -> tuple[int, int]:
    return custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF


_MODES = {
    FlightMode.MANUAL: ModeNumber(1, 0, "MANUAL", "Manual"),
    FlightMode.ALTITUDE: ModeNumber(2, 0, "ALTCTL", "Altitude"),
    FlightMode.POSITION: ModeNumber(3, 0, "POSCTL", "Position"),
    FlightMode.ACRO: ModeNumber(5, 0, "ACRO", "Acro"),
    FlightMode.OFFBOARD: ModeNumber(6, 0, "OFFBOARD", "Offboard"),
    FlightMode.STABILIZED: ModeNumber(7, 0, "STABILIZED", "Stabilized"),
    FlightMode.TAKEOFF: ModeNumber(MAIN_AUTO, 2, "TAKEOFF", "Takeoff"),
    FlightMode.HOLD: ModeNumber(MAIN_AUTO, 3, "HOLD", "Hold"),
    FlightMode.MISSION: ModeNumber(MAIN_AUTO, 4, "MISSION", "Mission"),
    FlightMode.RETURN: ModeNumber(MAIN_AUTO, 5, "RETURN", "Return"),
    FlightMode.LAND: ModeNumber(MAIN_AUTO, 6, "LAND", "Land"),
    FlightMode.DESCEND: ModeNumber(MAIN_AUTO, 6, "LAND", "Descend"),
    FlightMode.TERMINATION: ModeNumber(1, 0, "MANUAL", "Termination"),
}
_PARAMETERS = (
    whole("BAT1_N_CELLS", 1, 0, 16, "cells in series"),
    real("BAT1_CAPACITY", -1.0, -1.0, 100000.0, "mAh; -1 unknown"),
    real("BAT1_V_CHARGED", 4.05, 0.0, 5.0, "full cell, V"),
    real("BAT1_V_EMPTY", 3.6, 0.0, 5.0, "empty cell, V"),
    real("BAT_CRIT_THR", 0.07, 0.05, 0.5, "critical battery, fraction"),
    real("BAT_EMERGEN_THR", 0.05, 0.03, 0.5, "emergency battery, fraction"),
    real("BAT_LOW_THR", 0.15, 0.12, 0.5, "low battery, fraction"),
    whole("CBRK_SUPPLY_CHK", 0, 0, 894281, "circuit breaker, power supply check"),
    whole("COM_ARM_WO_GPS", 1, 0, 2, "arming without GNSS: 0 denied, 1 warning, 2 allowed"),
    whole("CBRK_FLIGHTTERM", 121212, 0, 121212, "termination of the flight: 121212 off, 0 on"),
    real("COM_DISARM_LAND", 2.0, -1.0, 20.0, "disarm after landing, s; <= 0 off"),
    real("COM_DISARM_PRFLT", 10.0, -1.0, 30.0, "disarm if not taken off, s; <= 0 off"),
    whole("COM_DL_LOSS_T", 10, 5, 300, "ground station lost after, s"),
    real("COM_FAIL_ACT_T", 5.0, 0.0, 25.0, "hold before a fail-safe's action, s"),
    whole("COM_HOME_EN", 1, 0, 1, "home position enabled"),
    whole("COM_LOW_BAT_ACT", 0, 0, 3, "battery action: 0 warn, 2 land, 3 return at critical and land at emergency"),
    whole("COM_OBL_RC_ACT", 0, 0, 7, "off-board loss: 0 position, 1 altitude, 2 stabilized, 3 return, 4 land, 5 hold"),
    real("COM_OF_LOSS_T", 1.0, 0.0, 60.0, "off-board lost after, s"),
    real("COM_POS_FS_EPH", 5.0, -1.0, 400.0, "horizontal position error limit, m"),
    whole("COM_RC_IN_MODE", 3, 0, 4, "manual control input"),
    whole("COM_RCL_EXCEPT", 0, 0, 31, "modes in which manual control loss is ignored"),
    whole("COM_TAKEOFF_ACT", 0, 0, 1, "after take-off: 0 hold, 1 mission"),
    whole("EKF2_BARO_CTRL", 1, 0, 1, "barometer fusion"),
    whole("EKF2_EV_CTRL", 0, 0, 15, "external vision fusion: 1 horizontal, 2 vertical, 4 velocity, 8 yaw"),
    real("EKF2_EV_DELAY", 0.0, 0.0, 300.0, "external vision delay, ms"),
    whole("EKF2_EV_NOISE_MD", 0, 0, 1, "external vision noise: 0 from the message, 1 from parameters"),
    real("EKF2_EV_POS_X", 0.0, -100.0, 100.0, "marker forward of the body's origin, m"),
    real("EKF2_EV_POS_Y", 0.0, -100.0, 100.0, "marker right of the body's origin, m"),
    real("EKF2_EV_POS_Z", 0.0, -100.0, 100.0, "marker below the body's origin, m"),
    real("EKF2_EVA_NOISE", 0.1, 0.05, 1.0, "external attitude noise, rad"),
    real("EKF2_EVP_GATE", 5.0, 1.0, 10.0, "external position innovation limit, standard deviations"),
    real("EKF2_EVP_NOISE", 0.1, 0.01, 10.0, "external position noise, m"),
    whole("EKF2_GPS_CTRL", 7, 0, 15, "GNSS fusion"),
    whole("EKF2_HGT_REF", 1, 0, 3, "height: 0 barometer, 1 GNSS, 2 range, 3 vision"),
    whole("EKF2_MAG_TYPE", 0, 0, 6, "magnetometer fusion: 0 automatic, 5 none"),
    whole("EKF2_NOAID_TOUT", 5000000, 500000, 10000000, "dead reckoning limit, us"),
    whole("GF_ACTION", 2, 0, 5, "fence violation action"),
    real("GF_MAX_HOR_DIST", 0.0, 0.0, 10000.0, "fence radius, m; 0 off"),
    real("GF_MAX_VER_DIST", 0.0, 0.0, 10000.0, "fence height, m; 0 off"),
    real("LNDMC_XY_VEL_MAX", 1.5, 0.0, 30.0, "landed: horizontal speed below, m/s"),
    real("LNDMC_Z_VEL_MAX", 0.25, 0.0, 30.0, "landed: vertical speed below, m/s"),
    whole("MAV_COMP_ID", 1, 1, 250, "MAVLink component"),
    whole("MAV_PROTO_VER", 0, 0, 2, "MAVLink version; 0 automatic"),
    whole("MAV_SYS_ID", 1, 1, 250, "MAVLink system"),
    whole("MAV_TYPE", 2, 0, 22, "MAV_TYPE"),
    whole("MC_AIRMODE", 0, 0, 2, "air mode"),
    real("MC_PITCHRATE_MAX", 220.0, 0.0, 1800.0, "deg/s"),
    real("MC_PITCHRATE_P", 0.15, 0.01, 0.6, "pitch rate gain"),
    real("MC_PITCH_P", 6.5, 0.0, 12.0, "pitch gain, 1/s"),
    real("MC_ROLLRATE_MAX", 220.0, 0.0, 1800.0, "deg/s"),
    real("MC_ROLLRATE_P", 0.15, 0.01, 0.5, "roll rate gain"),
    real("MC_ROLL_P", 6.5, 0.0, 12.0, "roll gain, 1/s"),
    real("MC_YAWRATE_MAX", 200.0, 0.0, 1800.0, "deg/s"),
    real("MC_YAWRATE_P", 0.2, 0.0, 0.6, "yaw rate gain"),
    real("MC_YAW_P", 2.8, 0.0, 5.0, "yaw gain, 1/s"),
    real("MIS_TAKEOFF_ALT", 2.5, 0.0, 80.0, "take-off height, m"),
    real("MPC_LAND_ALT1", 10.0, 0.0, 122.0, "slow down for landing below, m"),
    real("MPC_LAND_ALT2", 5.0, 0.0, 122.0, "landing speed below, m"),
    real("MPC_LAND_CRWL", 0.3, 0.1, 1.0, "last metre's speed, m/s"),
    real("MPC_LAND_SPEED", 0.7, 0.6, 2.0, "landing speed, m/s"),
    real("MPC_THR_HOVER", 0.5, 0.1, 0.8, "hover thrust, normalised"),
    real("MPC_THR_MAX", 1.0, 0.0, 1.0, "largest thrust, normalised"),
    real("MPC_THR_MIN", 0.12, 0.05, 0.5, "smallest thrust, normalised"),
    real("MPC_TILTMAX_AIR", 45.0, 20.0, 89.0, "tilt in the air, deg"),
    real("MPC_TILTMAX_LND", 12.0, 10.0, 89.0, "tilt while landing, deg"),
    real("MPC_TKO_RAMP_T", 3.0, 0.0, 5.0, "take-off ramp, s"),
    real("MPC_TKO_SPEED", 1.5, 1.0, 5.0, "take-off speed, m/s"),
    whole("MPC_USE_HTE", 1, 0, 1, "hover thrust estimator"),
    real("MPC_XY_CRUISE", 5.0, 3.0, 20.0, "cruise speed, m/s"),
    real("MPC_XY_P", 0.95, 0.0, 2.0, "horizontal position gain, 1/s"),
    real("MPC_XY_VEL_MAX", 12.0, 0.0, 20.0, "horizontal speed, m/s"),
    real("MPC_Z_P", 1.0, 0.1, 1.5, "vertical position gain, 1/s"),
    real("MPC_Z_VEL_MAX_DN", 1.5, 0.5, 4.0, "descent, m/s"),
    real("MPC_Z_VEL_MAX_UP", 3.0, 0.5, 8.0, "climb, m/s"),
    whole("NAV_DLL_ACT", 0, 0, 6, "ground station loss: 0 none, 1 hold, 2 return, 3 land"),
    whole("NAV_RCL_ACT", 2, 1, 6, "manual control loss: 1 hold, 2 return, 3 land"),
    whole("RTL_CONE_ANG", 45, 0, 90, "half angle of the return cone, deg"),
    real("RTL_DESCEND_ALT", 30.0, 0.0, 1000.0, "loiter height of a return, m"),
    real("RTL_RETURN_ALT", 60.0, 0.0, 1000.0, "return height, m"),
    whole("SYS_AUTOSTART", 10040, 0, 9999999, "airframe"),
    whole("SYS_HAS_GPS", 1, 0, 1, "GNSS receiver present"),
    whole("SYS_HAS_MAG", 1, 0, 6, "magnetometers present"),
    real("THR_MDL_FAC", 0.0, 0.0, 1.0, "thrust curve: 0 linear, 1 quadratic"),
)
# Set up for a lab: flown on motion capture alone (what PX4 v1.16.1 was seen to need), landing when the stream ends.
_INDOOR = {
    "CBRK_FLIGHTTERM": 0.0, "COM_OBL_RC_ACT": 4.0, "COM_OF_LOSS_T": 0.2, "COM_RCL_EXCEPT": 4.0,
    "EKF2_EV_CTRL": 11.0, "EKF2_GPS_CTRL": 0.0, "EKF2_HGT_REF": 3.0, "EKF2_BARO_CTRL": 0.0, "EKF2_MAG_TYPE": 5.0,
    "EKF2_EV_DELAY": 20.0, "EKF2_EVP_NOISE": 0.01, "SYS_HAS_MAG": 0.0, "SYS_HAS_GPS": 0.0,
}  # fmt: skip

PX4 = AutopilotTable(
    autopilot=MavAutopilot.PX4,
    name="PX4",
    modes=MappingProxyType(_MODES),
    join=_join,
    split=_split,
    auto_main=MAIN_AUTO,
    parameters=MappingProxyType(by_name(_PARAMETERS)),
    indoor=MappingProxyType(_INDOOR),
    system_parameter="MAV_SYS_ID",
    hover_parameter="MPC_THR_HOVER",
    idle_disarm_parameter="COM_DISARM_PRFLT",
    read_at_boot=frozenset(
        {"COM_HOME_EN", "EKF2_HGT_REF", "MAV_COMP_ID", "MAV_SYS_ID", "SYS_AUTOSTART", "SYS_HAS_GPS", "SYS_HAS_MAG"}
    ),
    needs_origin=False,
    inertial_delay_s=0.0025,  # half of what it is the mean of: IMU_INTEG_RATE's interval (streams/HIGHRES_IMU.hpp)
)
