"""PX4 v1.16 as its peers see it: after its Commander, its failsafe table, its MAVLink module and SITL flights."""

from math import tan
from types import MappingProxyType

from drone_agent.autopilots.parameters import Parameters
from drone_agent.autopilots.personality import (
    Mode,
    ModeRequest,
    ModeRow,
    Needs,
    Personality,
    StreamLoss,
    Task,
    Timing,
    Words,
)
from drone_agent.autopilots.px4_parameters import INDOOR, PARAMETERS
from formation.messages import Severity
from wire.link_messages.commands import Result
from wire.link_messages.motion import EstimatorType, Odometry, OdometryFrame, VisionPose
from wire.link_messages.packet import LinkMessage
from wire.link_messages.status import Autopilot

_STABILIZE, _GUIDED, _AUTO, _MANUAL_INPUT, _CUSTOM = 16, 8, 4, 64, 1
_MANUAL_FLAGS = _CUSTOM | _MANUAL_INPUT | _STABILIZE
_AUTO_FLAGS = _CUSTOM | _AUTO | _STABILIZE | _GUIDED
_MAIN_AUTO = 4


def _number(main: int, sub: int = 0) -> int:
    return main << 16 | sub << 24


def _manual(main: int, label: str, needs: Needs = Needs.PILOT, task: Task = Task.LEVEL) -> ModeRow:
    return ModeRow(_number(main), _MANUAL_FLAGS, task, needs, label)


def _auto(sub: int, label: str, task: Task, needs: Needs = Needs.POSITION, *, may_arm: bool = True) -> ModeRow:
    return ModeRow(_number(_MAIN_AUTO, sub), _AUTO_FLAGS, task, needs, label, may_arm)


MODES = MappingProxyType(
    {
        Mode.MANUAL: _manual(1, "Manual"),
        Mode.ALTITUDE: _manual(2, "Altitude"),
        Mode.POSITION: _manual(3, "Position", Needs.PILOT | Needs.POSITION, Task.HOLD),
        Mode.ACRO: _manual(5, "Acro"),
        Mode.STABILIZED: _manual(7, "Stabilized"),
        Mode.OFFBOARD: ModeRow(_number(6), _CUSTOM | _STABILIZE, Task.EXTERNAL, Needs.STREAM, "Offboard"),
        Mode.TAKEOFF: _auto(2, "Takeoff", Task.TAKEOFF),
        Mode.HOLD: _auto(3, "Hold", Task.HOLD, Needs.POSITION | Needs.GLOBE),
        Mode.MISSION: _auto(4, "Mission", Task.HOLD, Needs.POSITION | Needs.GLOBE | Needs.MISSION),
        Mode.RETURN: _auto(5, "Return", Task.RETURN, Needs.POSITION | Needs.GLOBE, may_arm=False),
        Mode.LAND: _auto(6, "Land", Task.LAND, may_arm=False),
        Mode.DESCEND: _auto(6, "Descend", Task.DESCEND, Needs.NOTHING, may_arm=False),
        Mode.TERMINATION: ModeRow(_number(1), _CUSTOM, Task.OFF, Needs.NOTHING, "Termination", False),
    }
)
_AUTO_MODES = {2: Mode.TAKEOFF, 3: Mode.HOLD, 4: Mode.MISSION, 5: Mode.RETURN, 6: Mode.LAND}
_MAIN_MODES = {
    1: Mode.MANUAL, 2: Mode.ALTITUDE, 3: Mode.POSITION, 5: Mode.ACRO, 6: Mode.OFFBOARD, 7: Mode.STABILIZED,
}  # fmt: skip
# COM_OBL_RC_ACT -> the mode shown and what is flown; without a pilot the manual ones come down.
_OFFBOARD_LOSS = {
    0: (Mode.POSITION, Task.LAND), 1: (Mode.ALTITUDE, Task.LAND), 2: (Mode.STABILIZED, Task.LAND),
    3: (Mode.RETURN, Task.RETURN), 4: (Mode.LAND, Task.LAND), 5: (Mode.HOLD, Task.HOLD),
    6: (Mode.TERMINATION, Task.OFF), 7: (Mode.TERMINATION, Task.OFF),
}  # fmt: skip
_LINK_LOSS = {1: Mode.HOLD, 2: Mode.RETURN, 3: Mode.LAND, 5: Mode.TERMINATION, 6: Mode.TERMINATION}
_BATTERY_ACTION = {2: Mode.LAND, 3: Mode.RETURN}

RATES_HZ = MappingProxyType(
    {
        0: 1.0,  # HEARTBEAT
        1: 1.0,  # SYS_STATUS
        30: 10.0,  # ATTITUDE: clients derive no Euler angles from the quaternion
        31: 50.0,  # ATTITUDE_QUATERNION
        32: 30.0,  # LOCAL_POSITION_NED
        33: 5.0,  # GLOBAL_POSITION_INT
        83: 0.0,  # ATTITUDE_TARGET
        115: 0.0,  # HIL_STATE_QUATERNION, the true state, for who plays the mocap
        111: 1.0,  # TIMESYNC
        147: 0.5,  # BATTERY_STATUS
        230: 1.0,  # ESTIMATOR_STATUS
        242: 0.5,  # HOME_POSITION
        245: 1.0,  # EXTENDED_SYS_STATE
    }
)

WORDS = Words(
    boot=((Severity.INFO, "[init] ready"),),
    armed="Armed by external command",
    disarmed="Disarmed by {}",
    arm_refused=("Preflight Fail: {}", "Arming denied: Resolve system health failures first"),
    disarm_refused="Disarming denied: not landed",
    mode_refused="Switching to mode '{}' is currently not possible: {}",
    no_position="No valid local position estimate: {}",
    not_armable="Mode {} does not allow arming",
    takeoff="Takeoff detected",
    landing="Landing at current position",
    landed="Landing detected",
    stream_lost="No offboard signal",
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
    if not base_mode & _CUSTOM:
        if base_mode & _AUTO:
            return ModeRequest(Mode.MISSION)
        return ModeRequest(Mode.MANUAL if base_mode & _MANUAL_INPUT else None, Result.ACCEPTED)
    if main == _MAIN_AUTO:
        return ModeRequest(_AUTO_MODES.get(sub or 4), Result.TEMPORARILY_REJECTED)
    # A main mode Commander has no name for changes nothing and is acknowledged all the same.
    return ModeRequest(_MAIN_MODES.get(main), Result.ACCEPTED)


def _takes_pose(p: Parameters, message: LinkMessage) -> bool:
    if not round(p["EKF2_EV_CTRL"]) & 1:
        return False
    if isinstance(message, Odometry):
        frames = (OdometryFrame.LOCAL_NED, OdometryFrame.LOCAL_FRD)
        return message.estimator in (EstimatorType.VISION, EstimatorType.VIO) and message.frame in frames
    return isinstance(message, VisionPose)


def _system_status(armed: bool, _landed: bool, failsafe: bool, ready: bool) -> int:
    if armed:
        return 5 if failsafe else 4
    return 3 if ready else 0


def _estimator_flags(valid: bool, ready: bool) -> int:
    attitude, horizontal = 1 | 4 | 32 | 64, 2 | 8 | 16 | 256 | 512
    return attitude | (horizontal if valid else 128) if ready or valid else attitude | 128


PX4 = Personality(
    name="px4",
    autopilot=Autopilot.PX4,
    vehicle_type=2,
    version=1 << 24 | 16 << 16 | 1 << 8 | 255,
    capabilities=8 | 16 | 64 | 8192,
    modes=MODES,
    boot_mode=Mode.HOLD,
    refused=Result.TEMPORARILY_REJECTED,
    no_such_rate=Result.FAILED,
    no_such_message=Result.DENIED,
    set_mode_ack=176,
    force_arm=False,
    takeoff_in_own_mode=True,
    parameters=PARAMETERS,
    system_parameter="MAV_SYS_ID",
    hover_parameter="MPC_THR_HOVER",
    rates_hz=RATES_HZ,
    words=WORDS,
    timing=_timing,
    mode_request=_mode_request,
    custom_parts=lambda custom: (custom >> 16 & 0xFF, custom >> 24 & 0xFF),
    stream_loss=_stream_loss,
    takes_target=lambda _target: True,
    streams_positions=True,
    climb_rate_of=lambda _p, _thrust: None,
    indoor=MappingProxyType(INDOOR),
    needs_origin=False,
    takes_pose=_takes_pose,
    system_status=_system_status,
    estimator_flags=_estimator_flags,
)
