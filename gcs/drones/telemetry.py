"""What the ground hears of a drone: the messages it reads, the newest of each, and the modes that are a pilot's."""

import math
from dataclasses import dataclass

from wire.autopilots.table import FlightMode
from wire.link_messages.message_id import MessageId
from wire.link_messages.status import EkfStatus, Heartbeat, LandedState, MavAutopilot, MavState, MavType

NEVER_NS = -(10**18)
# What is acted on by gcs.drones.link_state. The rest, much of what a drone sends, is not even decoded.
READS = frozenset(
    {
        MessageId.HEARTBEAT,
        MessageId.SYS_STATUS,
        MessageId.PARAM_VALUE,
        MessageId.ATTITUDE_QUATERNION,
        MessageId.LOCAL_POSITION_NED,
        MessageId.GPS_GLOBAL_ORIGIN,
        MessageId.COMMAND_ACK,
        MessageId.TIMESYNC,
        MessageId.BATTERY_STATUS,
        MessageId.EKF_STATUS_REPORT,
        MessageId.ESTIMATOR_STATUS,
        MessageId.EXTENDED_SYS_STATE,
        MessageId.NAMED_VALUE_FLOAT,
        MessageId.STATUSTEXT,
    }
)
# A person flies it in these: the ground leaves it alone.
PILOTED = frozenset(
    {FlightMode.MANUAL, FlightMode.STABILIZED, FlightMode.ACRO, FlightMode.ALTITUDE, FlightMode.POSITION,
     FlightMode.HOLD}
)  # fmt: skip


def ground_heartbeat(epoch: int) -> Heartbeat:
    """A ground's own heartbeat; it tells its epoch."""
    return Heartbeat(MavAutopilot.INVALID, MavType.GCS, 0, epoch & 0xFFFFFFFF, MavState.ACTIVE)


@dataclass(slots=True)
class Telemetry:
    """The newest of each thing the drone reported; battery 0..1, NaN where unknown."""

    heartbeat: Heartbeat | None = None
    landed: LandedState = LandedState.UNDEFINED
    battery: float = math.nan
    battery_v: float = math.nan
    setpoint_age_s: float = math.nan
    setpoint_age_ns: int = NEVER_NS
    estimator: EkfStatus | None = None
    origin: bool = False
