"""One decoded packet, and everything that it may say."""

from typing import NamedTuple

from wire.link_messages.address import Address
from wire.link_messages.clocks import Ping, SystemTime, TimeSync
from wire.link_messages.commands import CommandAck, CommandInt, CommandLong, SetMode
from wire.link_messages.motion import (
    Attitude,
    AttitudeQuaternion,
    GlobalPosition,
    HomePosition,
    InertialSample,
    LocalPosition,
    MocapPose,
    Odometry,
    Origin,
    SetOrigin,
    SimTruth,
    VisionPose,
)
from wire.link_messages.parameters import ParamRequestList, ParamRequestRead, ParamSet, ParamValue
from wire.link_messages.setpoints import AttitudeSetpoint, AttitudeTargetReport, PositionSetpoint
from wire.link_messages.status import (
    AutopilotVersion,
    Battery,
    EkfStatus,
    ExtendedSysState,
    Heartbeat,
    MessageInterval,
    NamedValue,
    StatusText,
    SysStatus,
)
from wire.link_messages.storage import LogEntry, LogRequestList, MissionCount, MissionRequestList


class Unknown(NamedTuple):
    """A well-formed packet of a message id that nothing here reads; counted, never an error."""

    message_id: int


LinkMessage = (
    Heartbeat | AttitudeSetpoint | VisionPose | MocapPose | Odometry | Attitude | AttitudeQuaternion | LocalPosition
    | GlobalPosition | HomePosition | SysStatus | Battery | ExtendedSysState | EkfStatus | StatusText | CommandLong
    | CommandInt | CommandAck | SetMode | TimeSync | Ping | SystemTime | ParamValue | ParamSet | ParamRequestRead
    | ParamRequestList | AutopilotVersion | AttitudeTargetReport | SimTruth | NamedValue | PositionSetpoint | SetOrigin
    | Origin | MessageInterval | MissionRequestList | MissionCount | LogRequestList | LogEntry | InertialSample
    | Unknown
)  # fmt: skip


class Packet(NamedTuple):
    """One decoded packet: who sent it, its sequence number, and what it says."""

    source: Address
    seq: int
    message: LinkMessage
