"""PX4 v1.16 as its peers see it: after its Commander, its failsafe table, its MAVLink module and SITL flights."""

from collections.abc import Mapping
from math import radians, tan
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
from wire.autopilots.px4 import MAIN_AUTO, PX4
from wire.autopilots.table import FlightMode
from wire.link_messages import (
    EstimatorFlag,
    EstimatorType,
    LinkMessage,
    MavCommand,
    MavState,
    MessageId,
    ModeFlag,
    Odometry,
    OdometryFrame,
    ProtocolCapability,
    Result,
    VisionPose,
)

_MANUAL_FLAGS = ModeFlag.CUSTOM_MODE_ENABLED | ModeFlag.MANUAL_INPUT_ENABLED | ModeFlag.STABILIZE_ENABLED
_AUTO_FLAGS = (
    ModeFlag.CUSTOM_MODE_ENABLED | ModeFlag.AUTO_ENABLED | ModeFlag.STABILIZE_ENABLED | ModeFlag.GUIDED_ENABLED
)
_OFFBOARD_FLAGS = ModeFlag.CUSTOM_MODE_ENABLED | ModeFlag.STABILIZE_ENABLED
_ON_GLOBE = Needs.POSITION | Needs.GLOBE

MODES = mode_rows(
    PX4,
    (
        (FlightMode.MANUAL, _MANUAL_FLAGS, Task.LEVEL, Needs.PILOT, True),
        (FlightMode.ALTITUDE, _MANUAL_FLAGS, Task.LEVEL, Needs.PILOT, True),
        (FlightMode.POSITION, _MANUAL_FLAGS, Task.HOLD, Needs.PILOT | Needs.POSITION, True),
        (FlightMode.ACRO, _MANUAL_FLAGS, Task.LEVEL, Needs.PILOT, True),
        (FlightMode.STABILIZED, _MANUAL_FLAGS, Task.LEVEL, Needs.PILOT, True),
        (FlightMode.OFFBOARD, _OFFBOARD_FLAGS, Task.EXTERNAL, Needs.STREAM, True),
        (FlightMode.TAKEOFF, _AUTO_FLAGS, Task.TAKEOFF, Needs.POSITION, True),
        (FlightMode.HOLD, _AUTO_FLAGS, Task.HOLD, _ON_GLOBE, True),
        (FlightMode.MISSION, _AUTO_FLAGS, Task.HOLD, _ON_GLOBE | Needs.MISSION, True),
        (FlightMode.RETURN, _AUTO_FLAGS, Task.RETURN, _ON_GLOBE, False),
        (FlightMode.LAND, _AUTO_FLAGS, Task.LAND, Needs.POSITION, False),
        (FlightMode.DESCEND, _AUTO_FLAGS, Task.DESCEND, Needs.NOTHING, False),
        (FlightMode.TERMINATION, ModeFlag.CUSTOM_MODE_ENABLED, Task.OFF, Needs.NOTHING, False),
    ),
)
# COM_OBL_RC_ACT -> the mode shown and what is flown; without a pilot the manual ones come down.
_OFFBOARD_LOSS = {
    0: (FlightMode.POSITION, Task.LAND), 1: (FlightMode.ALTITUDE, Task.LAND), 2: (FlightMode.STABILIZED, Task.LAND),
    3: (FlightMode.RETURN, Task.RETURN), 4: (FlightMode.LAND, Task.LAND), 5: (FlightMode.HOLD, Task.HOLD),
    6: (FlightMode.TERMINATION, Task.OFF), 7: (FlightMode.TERMINATION, Task.OFF),
}  # fmt: skip
_LINK_LOSS = {
    1: FlightMode.HOLD,
    2: FlightMode.RETURN,
    3: FlightMode.LAND,
    5: FlightMode.TERMINATION,
    6: FlightMode.TERMINATION,
}
_BATTERY_ACTION = {2: FlightMode.LAND, 3: FlightMode.RETURN}

RATES_HZ: Mapping[int, float] = MappingProxyType(
    {
        MessageId.HEARTBEAT: 1.0,
        MessageId.SYS_STATUS: 1.0,
        MessageId.ATTITUDE: 10.0,  # clients derive no Euler angles from the quaternion
        MessageId.ATTITUDE_QUATERNION: 50.0,
        MessageId.LOCAL_POSITION_NED: 30.0,
        MessageId.GLOBAL_POSITION_INT: 5.0,
        MessageId.ATTITUDE_TARGET: 0.0,
        MessageId.HIGHRES_IMU: 0.0,  # PX4 sends 50 Hz on its off-board link by default
        MessageId.HIL_STATE_QUATERNION: 0.0,  # the true state, for who plays the mocap
        MessageId.TIMESYNC: 1.0,
        MessageId.BATTERY_STATUS: 0.5,
        MessageId.ESTIMATOR_STATUS: 1.0,
        MessageId.HOME_POSITION: 0.5,
        MessageId.EXTENDED_SYS_STATE: 1.0,
    }
)

# As PX4 v1.16.2 was seen to send unasked on its off-board link: 400 packets a second with those that are not simulated.
DIRECT_RATES_HZ: Mapping[int, float] = MappingProxyType(
    {
        MessageId.ATTITUDE: 100.0,
        MessageId.ATTITUDE_QUATERNION: 50.0,
        MessageId.GLOBAL_POSITION_INT: 50.0,
        MessageId.HIGHRES_IMU: 50.0,
        MessageId.LOCAL_POSITION_NED: 30.0,
        MessageId.ATTITUDE_TARGET: 10.0,
        MessageId.TIMESYNC: 10.0,
        MessageId.SYS_STATUS: 5.0,
        MessageId.EXTENDED_SYS_STATE: 5.0,
    }
)

TEXTS = StatusTexts(
    boot=((Severity.INFO, "[init] ready"),),
    armed="Armed by external command",
    disarmed="Disarmed by {}",
    arm_rejected=("Preflight Fail: {}", "Arming denied: Resolve system health failures first"),
    disarm_rejected="Disarming denied: not landed",
    mode_rejected="Switching to mode '{}' is currently not possible: {}",
    no_position="No valid local position estimate: {}",
    not_armable="Mode {} does not allow arming",
    takeoff="Takeoff detected",
    landing="Landing at current position",
    landed="Landing detected",
    stream_lost="No offboard signal",
    attitude_lost="Critical failure detected: terminate flight",
    pose_lost="Position estimate lost, descending",
    battery_low="Low battery level",
    battery_critical="Critical battery level",
    ground_lost="Connection to ground station lost",
    unknown_parameter="[pm] unknown param: {}",
)


def _timing(p: Parameters) -> Timing:
    return Timing(
        takeoff_height_m=p["MIS_TAKEOFF_ALT"],
        climb_m_s=p["MPC_TKO_SPEED"],
        land_m_s=p["MPC_LAND_SPEED"],
        disarm_landing_s=p["COM_DISARM_LAND"] or -1.0,
        disarm_flown_s=p["COM_DISARM_LAND"] or -1.0,
        disarm_idle_s=p["COM_DISARM_PRFLT"] or -1.0,
        ground_loss_s=p["COM_DL_LOSS_T"],
        ground_loss=_LINK_LOSS.get(round(p["NAV_DLL_ACT"])),
        battery_low=p["BAT_LOW_THR"],
        battery_critical=p["BAT_CRIT_THR"],
        battery_action=_BATTERY_ACTION.get(round(p["COM_LOW_BAT_ACT"])),
        return_height_m=p["RTL_RETURN_ALT"],
        return_slope=1.0 / max(tan(p["RTL_CONE_ANG"] / 57.29578), 1e-3),
    )


def _stream_loss(p: Parameters) -> StreamLoss:
    mode, task = _OFFBOARD_LOSS.get(round(p["COM_OBL_RC_ACT"]), _OFFBOARD_LOSS[0])
    return StreamLoss(p["COM_OF_LOSS_T"], mode, task)


def _mode_request(base_mode: int, main: int, sub: int) -> ModeRequest:
    """As Commander reads DO_SET_MODE; a mode it does not know is rejected for now, as it answers."""
    if not base_mode & ModeFlag.CUSTOM_MODE_ENABLED:
        if base_mode & ModeFlag.AUTO_ENABLED:
            return ModeRequest(FlightMode.MISSION)
        manual = base_mode & ModeFlag.MANUAL_INPUT_ENABLED
        return ModeRequest(FlightMode.MANUAL if manual else None, Result.ACCEPTED)
    if main == MAIN_AUTO:
        return ModeRequest(PX4.mode_at(main, sub) if sub else FlightMode.MISSION, Result.TEMPORARILY_REJECTED)
    # A main mode Commander has no name for changes nothing and is acknowledged all the same.
    return ModeRequest(PX4.mode_at(main, sub), Result.ACCEPTED)


def _fuses_pose(p: Parameters, message: LinkMessage) -> bool:
    if not round(p["EKF2_EV_CTRL"]) & 1:
        return False
    if isinstance(message, Odometry):
        frames = (OdometryFrame.LOCAL_NED, OdometryFrame.LOCAL_FRD)
        return message.estimator in (EstimatorType.VISION, EstimatorType.VIO) and message.frame in frames
    return isinstance(message, VisionPose)


def _fusion(p: Parameters) -> Fusion:
    """As EKF2: `EKF2_HDG_GATE` 2.6, and `no_aid_timeout_max` of a second until a rejected source is taken for true."""
    noise_and_limits = np.array([p["EKF2_EVP_NOISE"], p["EKF2_EVA_NOISE"], p["EKF2_EVP_GATE"], 2.6])
    return Fusion(noise_and_limits, 1.0, p["EKF2_NOAID_TOUT"] * 1e-6)


def _attitude_failure(p: Parameters) -> AttitudeFailure | None:
    """FD_FAIL_R and FD_FAIL_P, 60 degrees for 0.3 s, which terminate the flight only where CBRK_FLIGHTTERM is 0."""
    return None if round(p["CBRK_FLIGHTTERM"]) else AttitudeFailure(radians(60.0), 0.3)


def _system_status(armed: bool, _landed: bool, failsafe: bool, ready: bool) -> MavState:
    if armed:
        return MavState.CRITICAL if failsafe else MavState.ACTIVE
    return MavState.STANDBY if ready else MavState.UNINIT


def _estimator_flags(valid: bool, _ready: bool) -> EstimatorFlag:
    return POSITIONED if valid else ATTITUDE_ONLY


PX4_MODEL = AutopilotModel(
    name="px4",
    table=PX4,
    version=1 << 24 | 16 << 16 | 1 << 8 | 255,
    capabilities=ProtocolCapability.COMMAND_INT
    | ProtocolCapability.PARAM_ENCODE_BYTEWISE
    | ProtocolCapability.SET_ATTITUDE_TARGET
    | ProtocolCapability.MAVLINK2,
    modes=MODES,
    boot_mode=FlightMode.HOLD,
    rejected=Result.TEMPORARILY_REJECTED,
    no_such_rate=Result.FAILED,
    no_such_message=Result.DENIED,
    set_mode_ack=MavCommand.DO_SET_MODE,
    force_arm=False,
    takeoff_in_own_mode=True,
    restores_mode=True,
    fence_parameter=None,
    rates_hz=RATES_HZ,
    direct_rates_hz=DIRECT_RATES_HZ,
    texts=TEXTS,
    timing=_timing,
    mode_request=_mode_request,
    stream_loss=_stream_loss,
    accepts_target=lambda _target: True,
    streams_positions=True,
    climb_rate_of=lambda _p, _thrust: None,
    fuses_pose=_fuses_pose,
    fusion=_fusion,
    attitude_failure=_attitude_failure,
    system_status=_system_status,
    estimator_flags=_estimator_flags,
)
