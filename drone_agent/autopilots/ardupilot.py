"""ArduCopter 4.6 as its peers see it: after its GCS_MAVLink, its modes and arming checks, and SITL flights.

Its pilot's sticks are taken as centred: the manual modes level and hold the height.
"""

from collections.abc import Mapping
from math import isfinite, radians
from types import MappingProxyType

import numpy as np

from drone_agent.autopilots.model import (
    ATTITUDE_ONLY,
    POSITIONED,
    AttitudeFailure,
    AutopilotModel,
    Fusion,
    ModeRequest,
    Needs,
    StatusTexts,
    StreamLoss,
    Task,
    Timing,
    mode_rows,
)
from drone_agent.autopilots.parameters import Parameters
from formation.messages import Severity
from wire.autopilots.ardupilot import ARDUPILOT, THRUST_AS_THRUST
from wire.autopilots.table import FlightMode
from wire.link_messages import (
    AttitudeSetpoint,
    EstimatorFlag,
    Ignore,
    LinkMessage,
    MavState,
    MessageId,
    MocapPose,
    ModeFlag,
    Odometry,
    OdometryFrame,
    ProtocolCapability,
    Result,
    VisionPose,
)

_MANUAL_FLAGS = ModeFlag.CUSTOM_MODE_ENABLED | ModeFlag.MANUAL_INPUT_ENABLED | ModeFlag.STABILIZE_ENABLED
_GUIDED_FLAGS = _MANUAL_FLAGS | ModeFlag.GUIDED_ENABLED

MODES = mode_rows(
    ARDUPILOT,
    (
        (FlightMode.STABILIZED, _MANUAL_FLAGS, Task.LEVEL, Needs.NOTHING, True),
        (FlightMode.ACRO, _MANUAL_FLAGS, Task.LEVEL, Needs.NOTHING, True),
        (FlightMode.ALTITUDE, _MANUAL_FLAGS, Task.LEVEL, Needs.NOTHING, True),
        (FlightMode.MISSION, _GUIDED_FLAGS, Task.HOLD, Needs.POSITION | Needs.MISSION, True),
        (FlightMode.OFFBOARD, _GUIDED_FLAGS, Task.EXTERNAL, Needs.POSITION, True),
        (FlightMode.HOLD, _GUIDED_FLAGS, Task.HOLD, Needs.POSITION, True),
        (FlightMode.RETURN, _GUIDED_FLAGS, Task.RETURN, Needs.POSITION, False),
        (FlightMode.LAND, _GUIDED_FLAGS, Task.LAND, Needs.NOTHING, False),
        (FlightMode.DESCEND, _MANUAL_FLAGS, Task.DESCEND, Needs.NOTHING, False),
        (FlightMode.POSITION, _GUIDED_FLAGS, Task.HOLD, Needs.POSITION, True),
        (FlightMode.BRAKE, _GUIDED_FLAGS, Task.HOLD, Needs.POSITION, False),
        (FlightMode.OFFBOARD_NO_POSITION, _MANUAL_FLAGS, Task.EXTERNAL, Needs.NOTHING, True),
    ),
)
_LINK_LOSS = {1: FlightMode.RETURN, 3: FlightMode.RETURN, 4: FlightMode.RETURN, 5: FlightMode.LAND, 7: FlightMode.BRAKE}
_BATTERY_ACTION = {1: FlightMode.LAND, 2: FlightMode.RETURN, 3: FlightMode.RETURN, 4: FlightMode.RETURN}

# LOCAL_POSITION_NED, ATTITUDE_QUATERNION and the like come when asked for with SET_MESSAGE_INTERVAL.
RATES_HZ: Mapping[int, float] = MappingProxyType(
    {
        MessageId.HEARTBEAT: 1.0,
        MessageId.SYS_STATUS: 2.0,
        MessageId.ATTITUDE: 4.0,
        MessageId.ATTITUDE_QUATERNION: 0.0,
        MessageId.LOCAL_POSITION_NED: 0.0,
        MessageId.GLOBAL_POSITION_INT: 4.0,
        MessageId.ATTITUDE_TARGET: 0.0,
        MessageId.HIL_STATE_QUATERNION: 0.0,  # the true state, for who plays the mocap
        MessageId.TIMESYNC: 0.1,  # which it asks for every ten seconds
        MessageId.BATTERY_STATUS: 2.0,
        MessageId.EKF_STATUS_REPORT: 2.0,
        MessageId.HOME_POSITION: 0.0,
        MessageId.EXTENDED_SYS_STATE: 0.0,
    }
)

TEXTS = StatusTexts(
    boot=((Severity.INFO, "ArduCopter V4.6.0"), (Severity.INFO, "Frame: QUAD/X")),
    armed="Arming motors",
    disarmed="Disarming motors",
    arm_rejected=("Arm: {}",),
    disarm_rejected="",
    mode_rejected="Mode change to {} failed: {}",
    no_position="Need Position Estimate: {}",
    not_armable="{} mode not armable",
    takeoff="",
    landing="",
    landed="",
    stream_lost="",
    attitude_lost="Crash: Disarming",
    pose_lost="EKF Failsafe: changed to LAND Mode",
    battery_low="Battery 1 is low",
    battery_critical="Battery 1 is critical",
    ground_lost="GCS Failsafe",
    unknown_parameter="",
)


def _timing(p: Parameters) -> Timing:
    capacity = max(p["BATT_CAPACITY"], 1.0)
    return Timing(
        takeoff_height_m=0.0,
        climb_m_s=p["WPNAV_SPEED_UP"] * 0.01,
        land_m_s=p["LAND_SPEED"] * 0.01,
        disarm_landing_s=0.5,
        disarm_flown_s=p["DISARM_DELAY"] or -1.0,
        disarm_idle_s=p["DISARM_DELAY"] or -1.0,
        ground_loss_s=p["FS_GCS_TIMEOUT"],
        ground_loss=_LINK_LOSS.get(round(p["FS_GCS_ENABLE"])),
        battery_low=p["BATT_LOW_MAH"] / capacity,
        battery_critical=p["BATT_CRT_MAH"] / capacity,
        battery_action=_BATTERY_ACTION.get(round(p["BATT_FS_CRT_ACT"])),
        return_height_m=p["RTL_ALT"] * 0.01,
        return_slope=p["RTL_CONE_SLOPE"],
    )


def _mode_request(base_mode: int, main: int, _sub: int) -> ModeRequest:
    """Only custom modes: MAVLink's own say too little; a number that is no mode fails."""
    if not base_mode & ModeFlag.CUSTOM_MODE_ENABLED:
        return ModeRequest(None, Result.DENIED)
    return ModeRequest(ARDUPILOT.mode_at(main, 0), Result.FAILED)


def _climb_rate(p: Parameters, thrust: float) -> float | None:
    """SET_ATTITUDE_TARGET's thrust is a climb rate about 0.5 unless GUID_OPTIONS says that it is thrust."""
    if round(p["GUID_OPTIONS"]) & THRUST_AS_THRUST:
        return None
    half = min(max(thrust, 0.0), 1.0) - 0.5
    return 2.0 * half * 0.01 * (p["WPNAV_SPEED_UP"] if half > 0.0 else p["WPNAV_SPEED_DN"])


def _accepts_target(target: AttitudeSetpoint) -> bool:
    """Thrust must be given, and of the body rates all or none."""
    rates = target.ignore & Ignore.BODY_RATES
    return not target.ignore & Ignore.THRUST and rates in (Ignore.NONE, Ignore.BODY_RATES)


def _fuses_pose(p: Parameters, message: LinkMessage) -> bool:
    if round(p["VISO_TYPE"]) != 1 or round(p["EK3_SRC1_POSXY"]) != 6:
        return False
    if isinstance(message, Odometry):
        return message.frame is OdometryFrame.LOCAL_FRD and all(map(isfinite, message.vel_flu_m_s.tolist()))
    return isinstance(message, VisionPose | MocapPose)


def _fusion(p: Parameters) -> Fusion:
    """As EKF3: `EK3_POS_I_GATE` 500 and `EK3_YAW_I_GATE` 300, in hundredths, and `posRetryTimeNoVel_ms` 7000."""
    noise_and_limits = np.array([p["VISO_POS_M_NSE"], p["VISO_YAW_M_NSE"], 5.0, 3.0])
    return Fusion(noise_and_limits, 7.0, 7.0)


_CRASHED = AttitudeFailure(radians(30.0), 2.0)
"""ArduCopter's crash check (`CRASH_CHECK_ANGLE_DEVIATION_DEG`, `CRASH_CHECK_TRIGGER_SEC`), of the tilt itself."""


def _system_status(_armed: bool, landed: bool, failsafe: bool, _ready: bool) -> MavState:
    if failsafe:
        return MavState.CRITICAL
    return MavState.STANDBY if landed else MavState.ACTIVE


def _estimator_flags(valid: bool, ready: bool) -> EstimatorFlag:
    if valid:
        return POSITIONED
    return ATTITUDE_ONLY if ready else EstimatorFlag.CONST_POS_MODE | EstimatorFlag.EKF_UNINITIALIZED


ARDUPILOT_MODEL = AutopilotModel(
    name="ardupilot",
    table=ARDUPILOT,
    version=4 << 24 | 6 << 16 | 255,
    capabilities=ProtocolCapability.PARAM_FLOAT
    | ProtocolCapability.COMMAND_INT
    | ProtocolCapability.SET_ATTITUDE_TARGET
    | ProtocolCapability.FLIGHT_TERMINATION
    | ProtocolCapability.MAVLINK2
    | ProtocolCapability.PARAM_ENCODE_C_CAST,
    modes=MODES,
    boot_mode=FlightMode.STABILIZED,
    rejected=Result.FAILED,
    no_such_rate=Result.DENIED,
    no_such_message=Result.FAILED,
    set_mode_ack=MessageId.SET_MODE,
    force_arm=True,
    takeoff_in_own_mode=False,
    restores_mode=False,
    fence_parameter="FENCE_ENABLE",
    rates_hz=RATES_HZ,
    direct_rates_hz={},
    texts=TEXTS,
    timing=_timing,
    mode_request=_mode_request,
    stream_loss=lambda p: StreamLoss(p["GUID_TIMEOUT"], None, Task.LEVEL),
    accepts_target=_accepts_target,
    streams_positions=False,
    climb_rate_of=_climb_rate,
    fuses_pose=_fuses_pose,
    fusion=_fusion,
    attitude_failure=lambda _p: _CRASHED,
    system_status=_system_status,
    estimator_flags=_estimator_flags,
)
