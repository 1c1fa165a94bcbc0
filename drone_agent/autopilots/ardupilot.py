"""ArduCopter 4.6 as its peers see it: after its GCS_MAVLink, its modes and arming checks, and SITL flights.

Its pilot's sticks are taken as centred: the manual modes level and hold the height.
"""

from math import isfinite
from types import MappingProxyType

from drone_agent.autopilots.ardupilot_parameters import INDOOR, PARAMETERS
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
from formation.messages import Severity
from wire.link_messages.commands import Result
from wire.link_messages.motion import MocapPose, Odometry, OdometryFrame, VisionPose
from wire.link_messages.packet import LinkMessage
from wire.link_messages.setpoints import AttitudeSetpoint, Ignore
from wire.link_messages.status import Autopilot

_CUSTOM, _GUIDED, _STABILIZE, _MANUAL_INPUT = 1, 8, 16, 64
_MANUAL_FLAGS = _CUSTOM | _STABILIZE | _MANUAL_INPUT
_GUIDED_FLAGS = _MANUAL_FLAGS | _GUIDED
_THRUST_AS_THRUST = 8


def _manual(number: int, label: str) -> ModeRow:
    return ModeRow(number, _MANUAL_FLAGS, Task.LEVEL, Needs.NOTHING, label)


def _auto(number: int, label: str, task: Task, needs: Needs = Needs.POSITION, *, may_arm: bool = True) -> ModeRow:
    return ModeRow(number, _GUIDED_FLAGS, task, needs, label, may_arm)


MODES = MappingProxyType(
    {
        Mode.STABILIZED: _manual(0, "STABILIZE"),
        Mode.ACRO: _manual(1, "ACRO"),
        Mode.ALTITUDE: _manual(2, "ALT_HOLD"),
        Mode.MISSION: _auto(3, "AUTO", Task.HOLD, Needs.POSITION | Needs.MISSION),
        Mode.OFFBOARD: _auto(4, "GUIDED", Task.EXTERNAL),
        Mode.HOLD: _auto(5, "LOITER", Task.HOLD),
        Mode.RETURN: _auto(6, "RTL", Task.RETURN, may_arm=False),
        Mode.LAND: ModeRow(9, _GUIDED_FLAGS, Task.LAND, Needs.NOTHING, "LAND", may_arm=False),
        Mode.DESCEND: ModeRow(9, _MANUAL_FLAGS, Task.DESCEND, Needs.NOTHING, "LAND", may_arm=False),
        Mode.POSITION: _auto(16, "POSHOLD", Task.HOLD),
        Mode.BRAKE: _auto(17, "BRAKE", Task.HOLD, may_arm=False),
        Mode.OFFBOARD_NO_POSITION: ModeRow(20, _MANUAL_FLAGS, Task.EXTERNAL, Needs.NOTHING, "GUIDED_NOGPS"),
    }
)
_BY_NUMBER = {row.custom_mode: mode for mode, row in MODES.items() if mode is not Mode.DESCEND}
_LINK_LOSS = {1: Mode.RETURN, 3: Mode.RETURN, 4: Mode.RETURN, 5: Mode.LAND, 7: Mode.BRAKE}
_BATTERY_ACTION = {1: Mode.LAND, 2: Mode.RETURN, 3: Mode.RETURN, 4: Mode.RETURN}

# LOCAL_POSITION_NED, ATTITUDE_QUATERNION and the like come when asked for with SET_MESSAGE_INTERVAL.
RATES_HZ = MappingProxyType(
    {
        0: 1.0,  # HEARTBEAT
        1: 2.0,  # SYS_STATUS
        30: 4.0,  # ATTITUDE
        31: 0.0,  # ATTITUDE_QUATERNION
        32: 0.0,  # LOCAL_POSITION_NED
        33: 4.0,  # GLOBAL_POSITION_INT
        83: 0.0,  # ATTITUDE_TARGET
        115: 0.0,  # HIL_STATE_QUATERNION, the true state, for who plays the mocap
        111: 0.1,  # TIMESYNC, which it asks for every ten seconds
        147: 2.0,  # BATTERY_STATUS
        193: 2.0,  # EKF_STATUS_REPORT
        242: 0.0,  # HOME_POSITION
        245: 0.0,  # EXTENDED_SYS_STATE
    }
)

WORDS = Words(
    boot=((Severity.INFO, "ArduCopter V4.6.0"), (Severity.INFO, "Frame: QUAD/X")),
    armed="Arming motors",
    disarmed="Disarming motors",
    arm_refused=("Arm: {}",),
    disarm_refused="",
    mode_refused="Mode change to {} failed: {}",
    no_position="Need Position Estimate: {}",
    not_armable="{} mode not armable",
    takeoff="",
    landing="",
    landed="",
    stream_lost="",
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
    if not base_mode & _CUSTOM:
        return ModeRequest(None, Result.DENIED)
    return ModeRequest(_BY_NUMBER.get(main), Result.FAILED)


def _climb_rate(p: Parameters, thrust: float) -> float | None:
    """SET_ATTITUDE_TARGET's thrust is a climb rate about 0.5 unless GUID_OPTIONS says that it is thrust."""
    if round(p["GUID_OPTIONS"]) & _THRUST_AS_THRUST:
        return None
    half = min(max(thrust, 0.0), 1.0) - 0.5
    return 2.0 * half * 0.01 * (p["WPNAV_SPEED_UP"] if half > 0.0 else p["WPNAV_SPEED_DN"])


def _takes_target(target: AttitudeSetpoint) -> bool:
    """Thrust must be given, and of the body rates all or none."""
    rates = target.ignore & Ignore.BODY_RATES
    return not target.ignore & Ignore.THRUST and rates in (Ignore.NONE, Ignore.BODY_RATES)


def _takes_pose(p: Parameters, message: LinkMessage) -> bool:
    if round(p["VISO_TYPE"]) != 1 or round(p["EK3_SRC1_POSXY"]) != 6:
        return False
    if isinstance(message, Odometry):
        return message.frame is OdometryFrame.LOCAL_FRD and all(map(isfinite, message.vel_flu_m_s.tolist()))
    return isinstance(message, VisionPose | MocapPose)


def _system_status(_armed: bool, landed: bool, failsafe: bool, _ready: bool) -> int:
    if failsafe:
        return 5
    return 3 if landed else 4


def _estimator_flags(valid: bool, ready: bool) -> int:
    attitude, horizontal, constant, uninitialised = 1 | 4 | 32 | 64, 2 | 8 | 16 | 256 | 512, 128, 1024
    if valid:
        return attitude | horizontal
    return attitude | constant if ready else constant | uninitialised


ARDUPILOT = Personality(
    name="ardupilot",
    autopilot=Autopilot.ARDUPILOT,
    vehicle_type=2,
    version=4 << 24 | 6 << 16 | 255,
    capabilities=2 | 8 | 64 | 2048 | 8192 | 131072,
    modes=MODES,
    boot_mode=Mode.STABILIZED,
    refused=Result.FAILED,
    no_such_rate=Result.DENIED,
    no_such_message=Result.FAILED,
    set_mode_ack=11,
    force_arm=True,
    takeoff_in_own_mode=False,
    parameters=PARAMETERS,
    system_parameter="SYSID_THISMAV",
    hover_parameter="MOT_THST_HOVER",
    rates_hz=RATES_HZ,
    words=WORDS,
    timing=_timing,
    mode_request=_mode_request,
    custom_parts=lambda custom: (custom, 0),
    stream_loss=lambda p: StreamLoss(p["GUID_TIMEOUT"], None, Task.LEVEL),
    takes_target=_takes_target,
    streams_positions=False,
    climb_rate_of=_climb_rate,
    indoor=MappingProxyType(INDOOR),
    needs_origin=True,
    takes_pose=_takes_pose,
    system_status=_system_status,
    estimator_flags=_estimator_flags,
)
