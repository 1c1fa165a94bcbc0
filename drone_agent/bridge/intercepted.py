"""Which messages the bridge looks at; all others pass, but what comes by a network only where the allow-list has it."""

from drone_agent.guard import allow_list
from wire.link_messages.commands import MavCommand
from wire.link_messages.message_id import MessageId
from wire.mavlink.framing import Frame

POSES = frozenset({MessageId.VISION_POSITION_ESTIMATE, MessageId.ATT_POS_MOCAP, MessageId.ODOMETRY})
"""Of a ground: those of the bridge take their place."""
READS = frozenset(
    {
        MessageId.HEARTBEAT,
        MessageId.SET_MODE,
        MessageId.GPS_GLOBAL_ORIGIN,
        MessageId.COMMAND_LONG,
        MessageId.COMMAND_INT,
        MessageId.COMMAND_ACK,
        MessageId.TIMESYNC,
        MessageId.HIGHRES_IMU,
        MessageId.ATTITUDE_QUATERNION,
    }
)
"""Read by the bridge beside setpoints and poses."""
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


def list_reject_reason(frame: Frame, sysid: int, *, armed: bool) -> str:
    """Why the allow-list ends a frame of the ground of drone `sysid` here; empty where it passes."""
    version = 2 if frame.data[0] == 0xFD else 1
    return allow_list.reject_reason(version, frame.number, frame.payload, sysid, armed=armed)
