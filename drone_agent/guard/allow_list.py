"""The messages that a ground may send a drone over a network, by message and field; all others end at the bridge.

Numbers are MAVLink's (common.xml, 11 of ardupilotmega the same); a packet is judged by its version, its id and the
fields of its payload. Nothing here knows keys: signatures are verified before.
"""

from dataclasses import dataclass
from enum import StrEnum

from wire.link_messages import MavCommand, MessageId
from wire.mavlink.framing import Frame


class MotorState(StrEnum):
    """In which state of the motors a packet passes."""

    ALWAYS = "always"
    DISARMED = "disarmed"


@dataclass(frozen=True, slots=True)
class AllowedMessage:
    """One row: a message id, its name, and when it passes.

    target_at: the byte of the payload that has the target system, which must be the drone's; None: not looked at.
    """

    number: int
    name: str
    when: MotorState = MotorState.ALWAYS
    target_at: int | None = None


@dataclass(frozen=True, slots=True)
class AllowedCommand:
    """One row: a command of COMMAND_LONG and COMMAND_INT, its name, and when it passes."""

    number: int
    name: str
    when: MotorState = MotorState.ALWAYS


ALLOWED = (
    AllowedMessage(0, "HEARTBEAT"),
    AllowedMessage(2, "SYSTEM_TIME"),
    AllowedMessage(4, "PING"),
    AllowedMessage(11, "SET_MODE", target_at=4),
    AllowedMessage(20, "PARAM_REQUEST_READ", target_at=2),
    AllowedMessage(21, "PARAM_REQUEST_LIST", target_at=0),
    AllowedMessage(48, "SET_GPS_GLOBAL_ORIGIN", MotorState.DISARMED, target_at=12),
    AllowedMessage(75, "COMMAND_INT", target_at=30),
    AllowedMessage(76, "COMMAND_LONG", target_at=30),
    AllowedMessage(77, "COMMAND_ACK"),
    AllowedMessage(82, "SET_ATTITUDE_TARGET", target_at=36),
    AllowedMessage(84, "SET_POSITION_TARGET_LOCAL_NED", target_at=50),
    AllowedMessage(102, "VISION_POSITION_ESTIMATE"),
    AllowedMessage(111, "TIMESYNC"),
    AllowedMessage(117, "LOG_REQUEST_LIST", MotorState.DISARMED, target_at=4),
    AllowedMessage(119, "LOG_REQUEST_DATA", MotorState.DISARMED, target_at=10),
    AllowedMessage(122, "LOG_REQUEST_END", target_at=0),
    AllowedMessage(138, "ATT_POS_MOCAP"),
    AllowedMessage(331, "ODOMETRY"),
)
ALLOWED_COMMANDS = (
    AllowedCommand(20, "NAV_RETURN_TO_LAUNCH"),
    AllowedCommand(21, "NAV_LAND"),
    AllowedCommand(22, "NAV_TAKEOFF"),
    AllowedCommand(176, "DO_SET_MODE"),
    AllowedCommand(185, "DO_FLIGHTTERMINATION"),
    AllowedCommand(246, "PREFLIGHT_REBOOT_SHUTDOWN", MotorState.DISARMED),
    AllowedCommand(400, "COMPONENT_ARM_DISARM, arming past the checks excepted"),
    AllowedCommand(410, "GET_HOME_POSITION"),
    AllowedCommand(510, "GET_MESSAGE_INTERVAL"),
    AllowedCommand(511, "SET_MESSAGE_INTERVAL"),
    AllowedCommand(512, "REQUEST_MESSAGE"),
    AllowedCommand(520, "REQUEST_AUTOPILOT_CAPABILITIES"),
    AllowedCommand(32100, "REQUEST_OPERATOR_CONTROL"),
)
VERSION_1 = "MAVLink 1 packet, which the allow-list never passes"
UNLISTED = "message that is not on the allow-list"
UNLISTED_COMMAND = "command that is not on the allow-list"
ARMED = "message that passes only while the motors are off"
OTHER_SYSTEM = "message to another system, or to every system"
PAST_CHECKS = "arming past the autopilot's checks"

POSES = frozenset({MessageId.VISION_POSITION_ESTIMATE, MessageId.ATT_POS_MOCAP, MessageId.ODOMETRY})
"""Poses that a ground sends: those of the bridge take their place."""
SETS_MODE = frozenset(
    {
        MavCommand.NAV_RETURN_TO_LAUNCH,
        MavCommand.NAV_LAND,
        MavCommand.NAV_TAKEOFF,
        MavCommand.DO_SET_MODE,
        MavCommand.DO_FLIGHTTERMINATION,
        MavCommand.DO_REPOSITION,
        MavCommand.COMPONENT_ARM_DISARM,
    }
)
"""Commands that may change the mode, or arm."""

_ROWS = {row.number: row for row in ALLOWED}
_COMMANDS = {row.number: row for row in ALLOWED_COMMANDS}
_COMMAND_AT, _ACTION, _FORCE = slice(28, 30), slice(0, 4), slice(4, 8)
"""Of a command's payload: its number; of an arming what to do, and the number that forces it."""
_LONGEST = 255


def reject_reason(version: int, number: int, payload: bytes, sysid: int, *, armed: bool) -> str:
    """Why a packet from the network does not reach the autopilot of drone `sysid`; empty where it may.

    payload: as it is on the wire, trailing zeros cut.
    """
    if version != 2:
        return VERSION_1
    row = _ROWS.get(number)
    if row is None:
        return UNLISTED
    if armed and row.when is MotorState.DISARMED:
        return ARMED
    if row.target_at is None:
        return ""
    whole = payload.ljust(_LONGEST, b"\0")
    if whole[row.target_at] != sysid:
        return OTHER_SYSTEM
    return (
        _command_reject_reason(whole, armed=armed) if number in (MessageId.COMMAND_INT, MessageId.COMMAND_LONG) else ""
    )


def _command_reject_reason(payload: bytes, *, armed: bool) -> str:
    command = int.from_bytes(payload[_COMMAND_AT], "little")
    row = _COMMANDS.get(command)
    if row is None:
        return UNLISTED_COMMAND
    if armed and row.when is MotorState.DISARMED:
        return ARMED
    forces_arming = any(payload[_ACTION]) and any(payload[_FORCE])
    return PAST_CHECKS if command == MavCommand.COMPONENT_ARM_DISARM and forces_arming else ""


def list_reject_reason(frame: Frame, sysid: int, *, armed: bool) -> str:
    """Why the allow-list ends a frame of the ground of drone `sysid` here; empty where it passes."""
    version = 2 if frame.data[0] == 0xFD else 1
    return reject_reason(version, frame.number, frame.payload, sysid, armed=armed)


def allow_list_markdown() -> str:
    """The table as Markdown."""
    rows = [(row.name, str(row.number), row.when.value) for row in ALLOWED]
    rows += [(f"command {row.name}", str(row.number), row.when.value) for row in ALLOWED_COMMANDS]
    head = ("message or command", "number", "passes")
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, ("---",) * len(head), *rows))
