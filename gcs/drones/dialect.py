"""What PX4 and ArduPilot differ in, as data: modes, parameters, streams, and which setpoint fields they read.

Built on their documentation; a drone's heartbeat says which applies. Everything else is one code for both.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from formation.maths.arrays import Quat, Vec3
from formation.vehicle.profile import VehicleProfile
from wire.link_messages.address import Address
from wire.link_messages.commands import Command
from wire.link_messages.motion import VisionPose
from wire.link_messages.packet import LinkMessage
from wire.link_messages.setpoints import Ignore
from wire.link_messages.status import Autopilot, EkfStatus, Heartbeat

ARM_DISARM, NAV_LAND, SET_MODE, SET_MESSAGE_INTERVAL = 400, 21, 176, 511
CUSTOM_MODE_FLAG = 1.0
IDLE_DISARM_LEAST_S = 8.0  # arming a swarm takes three seconds, a take-off three more, the operator what is left
FORCE = 21196.0  # the magic number that disarms in the air, in both autopilots


@dataclass(frozen=True, slots=True)
class ParameterRule:
    """What one parameter must be for our flight, and why; `set_to` is what `gcs doctor --fix` writes.

    vital: without it our setpoints would be misread or not die in time, so arming is refused.
    external_pose: applies only where this ground feeds the drone its pose.
    """

    name: str
    wanted: str
    holds: Callable[[float], bool]
    why: str
    set_to: float
    vital: bool = False
    external_pose: bool = False


@dataclass(frozen=True, slots=True)
class Dialect:
    """One autopilot's ways."""

    autopilot: Autopilot
    name: str
    offboard_mode: tuple[float, float]
    """MAV_CMD_DO_SET_MODE's custom mode and sub mode for following our setpoints."""
    is_offboard: Callable[[Heartbeat], bool]
    mode_name: Callable[[Heartbeat], str]
    ignore: Ignore
    """Body rates that it cannot take beside an attitude."""
    hover_parameter: str
    hover_default: float
    """Its value before anyone has measured it, which says nothing of the vehicle."""
    idle_disarm_parameter: str
    """After how many seconds it disarms when armed without a take-off; never where that is zero or less."""
    idle_disarm_default_s: float
    rules: tuple[ParameterRule, ...]
    streams: tuple[tuple[int, float], ...]
    """Messages to ask for: id and rate, Hz."""
    unread: tuple[int, ...]
    """Messages that it sends unasked and that nobody here reads: switched off on a link of our own."""
    needs_origin: bool
    """Whether it uses an external pose only once it was told where on the globe its local frame begins."""
    unready: Callable[[EkfStatus | None], str]
    """Why its estimator cannot carry a flight yet; empty when it can, or does not say."""

    def set_offboard(self, target: Address) -> Command:
        """Follow our setpoints."""
        return _command(target, SET_MODE, CUSTOM_MODE_FLAG, *self.offboard_mode)

    def setpoint_ignore(self, profile: VehicleProfile) -> Ignore:
        """The type mask of SET_ATTITUDE_TARGET: a vehicle known to feed all body rates forward is given them all."""
        return Ignore.NONE if profile.rate_feed_forward else self.ignore

    def pose(self, t_us: int, pos_lab_m: Vec3, q_lab_from_flu: Quat) -> LinkMessage:
        """Its external pose. VISION_POSITION_ESTIMATE is the one message that both fuse as they are documented."""
        return VisionPose(t_us, pos_lab_m, q_lab_from_flu)

    @property
    def parameters(self) -> tuple[str, ...]:
        """The names to read before arming."""
        return (*(rule.name for rule in self.rules), self.hover_parameter)


def arm(target: Address) -> Command:
    """Start the motors, if the autopilot agrees."""
    return _command(target, ARM_DISARM, 1.0)


def disarm(target: Address) -> Command:
    """Stop the motors of a landed drone."""
    return _command(target, ARM_DISARM, 0.0)


def cut(target: Address) -> Command:
    """Stop the motors now, wherever the drone is."""
    return _command(target, ARM_DISARM, 0.0, FORCE)


def land(target: Address) -> Command:
    """Land by itself, where it is."""
    return _command(target, NAV_LAND)


def stream(target: Address, message_id: int, rate_hz: float) -> Command:
    """Send us this message at this rate; not at all for zero."""
    return _command(target, SET_MESSAGE_INTERVAL, float(message_id), 1e6 / rate_hz if rate_hz > 0.0 else -1.0)


def _command(target: Address, number: int, *params: float) -> Command:
    p1, p2, p3, p4, p5, p6, p7 = (*params, *(0.0,) * (7 - len(params)))
    return Command(target, number, (p1, p2, p3, p4, p5, p6, p7))


_PX4_MAIN = {1: "MANUAL", 2: "ALTCTL", 3: "POSCTL", 4: "AUTO", 5: "ACRO", 6: "OFFBOARD", 7: "STABILIZED"}
_PX4_AUTO = {2: "TAKEOFF", 3: "HOLD", 4: "MISSION", 5: "RETURN", 6: "LAND"}
_COPTER = {0: "STABILIZE", 1: "ACRO", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 5: "LOITER", 6: "RTL", 9: "LAND",
           16: "POSHOLD", 17: "BRAKE", 20: "GUIDED_NOGPS"}  # fmt: skip


def _px4_main(heartbeat: Heartbeat) -> int:
    return heartbeat.custom_mode >> 16 & 0xFF


def _px4_mode(heartbeat: Heartbeat) -> str:
    main, sub = _px4_main(heartbeat), heartbeat.custom_mode >> 24
    name = _PX4_MAIN.get(main, f"MODE {main}")
    return _PX4_AUTO.get(sub, f"AUTO {sub}") if main == 4 else name


def _copter_mode(heartbeat: Heartbeat) -> str:
    return _COPTER.get(heartbeat.custom_mode, f"MODE {heartbeat.custom_mode}")


def _px4_unready(_status: EkfStatus | None) -> str:
    return ""  # PX4 refuses to arm in its own words


def _copter_unready(status: EkfStatus | None) -> str:
    positioned, uninitialised = 0x10, 0x400
    if status is None:
        return "no estimator report yet"
    return "" if status.flags & positioned and not status.flags & uninitialised else "estimator has no position yet"


def _is(value: float) -> Callable[[float], bool]:
    return lambda found: found == value


def _has(bits: int) -> Callable[[float], bool]:
    return lambda found: int(found) & bits == bits


def _lets_take_off(found: float) -> bool:
    return found <= 0.0 or found >= IDLE_DISARM_LEAST_S


def _idle_disarm_rule(name: str) -> ParameterRule:
    wanted = f"{IDLE_DISARM_LEAST_S:g} s or more, or 0 (never)"
    return ParameterRule(name, wanted, _lets_take_off, "disarms an armed drone before all can take off", 10.0)


def _between(low: float, high: float) -> Callable[[float], bool]:
    return lambda found: low <= found <= high


PX4 = Dialect(
    autopilot=Autopilot.PX4,
    name="PX4",
    offboard_mode=(6.0, 0.0),
    is_offboard=lambda heartbeat: _px4_main(heartbeat) == 6,
    mode_name=_px4_mode,
    # With both given, PX4 publishes a rate setpoint beside the attitude's own; it takes the yaw rate alone.
    ignore=Ignore.ROLL_RATE | Ignore.PITCH_RATE,
    hover_parameter="MPC_THR_HOVER",
    hover_default=0.5,
    idle_disarm_parameter="COM_DISARM_PRFLT",
    idle_disarm_default_s=10.0,
    rules=(
        _idle_disarm_rule("COM_DISARM_PRFLT"),
        ParameterRule(
            "COM_OF_LOSS_T", "0 to 2 s", _between(0.0, 2.0),
            "how long it flies on after our setpoints stop", 0.5, vital=True,
        ),
        ParameterRule(
            "COM_OBL_RC_ACT", "4 (land)", _is(4.0), "what it does when our setpoints stop", 4.0,
        ),
        ParameterRule(
            "EKF2_EV_CTRL", "position, height and yaw (11)", _has(11), "fuses the mocap pose", 11.0,
            external_pose=True,
        ),
        ParameterRule(
            "EKF2_HGT_REF", "3 (vision)", _is(3.0), "takes height from the mocap", 3.0, external_pose=True,
        ),
        ParameterRule(
            "EKF2_EVP_NOISE", "at most 0.02 m", _between(0.0, 0.02),
            "trusts the mocap: with 0.1 m its estimate wandered by decimetres", 0.01, external_pose=True,
        ),
        ParameterRule(
            "EKF2_GPS_CTRL", "0 (none)", _is(0.0), "GPS indoors pulls the estimate away", 0.0, external_pose=True,
        ),
        ParameterRule(
            "EKF2_MAG_TYPE", "5 (none)", _is(5.0), "iron indoors turns the heading", 5.0, external_pose=True,
        ),
        ParameterRule(
            "COM_RCL_EXCEPT", "off-board (bit 4)", _has(4), "no remote control is no failsafe in off-board", 4.0,
        ),
    ),
    streams=((31, 50.0), (245, 2.0), (147, 1.0)),
    # ATTITUDE, GLOBAL_POSITION_INT, ATTITUDE_TARGET, HIGHRES_IMU, ODOMETRY, ALTITUDE, VFR_HUD, SERVO_OUTPUT_RAW,
    # POSITION_TARGET_LOCAL_NED, DISTANCE_SENSOR, GPS_RAW_INT: nine tenths of PX4's off-board link.
    unread=(30, 33, 83, 105, 331, 141, 74, 36, 85, 132, 24),
    needs_origin=False,
    unready=_px4_unready,
)  # fmt: skip

ARDUPILOT = Dialect(
    autopilot=Autopilot.ARDUPILOT,
    name="ArduPilot",
    offboard_mode=(4.0, 0.0),
    is_offboard=lambda heartbeat: heartbeat.custom_mode == 4,
    mode_name=_copter_mode,
    ignore=Ignore.NONE,
    hover_parameter="MOT_THST_HOVER",
    hover_default=0.35,
    idle_disarm_parameter="DISARM_DELAY",
    idle_disarm_default_s=10.0,
    rules=(
        _idle_disarm_rule("DISARM_DELAY"),
        ParameterRule(
            "GUID_OPTIONS", "thrust (bit 8)", _has(8), "without it our thrust is read as a climb rate", 8.0, vital=True,
        ),
        ParameterRule(
            "GUID_TIMEOUT", "0.1 to 1 s", _between(0.1, 1.0),
            "how long it flies on after our setpoints stop", 0.5, vital=True,
        ),
        ParameterRule("FS_GCS_ENABLE", "5 (land)", _is(5.0), "what it does when the ground's heartbeat stops", 5.0),
        ParameterRule("VISO_TYPE", "1 (MAVLink)", _is(1.0), "takes the mocap pose", 1.0, external_pose=True),
        ParameterRule(
            "EK3_SRC1_POSXY", "6 (external)", _is(6.0), "takes position from the mocap", 6.0, external_pose=True,
        ),
        ParameterRule(
            "EK3_SRC1_POSZ", "6 (external)", _is(6.0), "takes height from the mocap", 6.0, external_pose=True,
        ),
        ParameterRule(
            "EK3_SRC1_VELXY", "0 (none)", _is(0.0), "a GPS that is not there keeps it from arming", 0.0,
            external_pose=True,
        ),
        ParameterRule(
            "EK3_SRC1_VELZ", "0 (none)", _is(0.0), "a GPS that is not there keeps it from arming", 0.0,
            external_pose=True,
        ),
        ParameterRule(
            "EK3_SRC1_YAW", "6 (external)", _is(6.0), "iron indoors turns the heading", 6.0, external_pose=True,
        ),
    ),
    streams=((31, 50.0), (32, 30.0), (245, 2.0), (147, 1.0), (193, 2.0), (1, 1.0)),
    unread=(),
    needs_origin=True,
    unready=_copter_unready,
)  # fmt: skip

DIALECTS: Mapping[Autopilot, Dialect] = MappingProxyType({d.autopilot: d for d in (PX4, ARDUPILOT)})
