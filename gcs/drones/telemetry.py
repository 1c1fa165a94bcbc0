"""What the ground hears of a drone: the messages it reads, the newest of each, and the modes that are a pilot's."""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from formation.maths.arrays import Vec3
from wire.autopilots.table import FlightMode
from wire.link_messages.message_id import MessageId
from wire.link_messages.motion import FORCE_MOST_M_S2
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
READS_IF_ASKED = frozenset({MessageId.HIGHRES_IMU})
FORCES = 64
# A person flies it in these: the ground leaves it alone.
PILOTED = frozenset(
    {FlightMode.MANUAL, FlightMode.STABILIZED, FlightMode.ACRO, FlightMode.ALTITUDE, FlightMode.POSITION,
     FlightMode.HOLD}
)  # fmt: skip


def ground_heartbeat(epoch: int) -> Heartbeat:
    """A ground's own heartbeat; it tells its epoch."""
    return Heartbeat(MavAutopilot.INVALID, MavType.GCS, 0, epoch & 0xFFFFFFFF, MavState.ACTIVE)


class FeltForce:
    """The specific force that a drone's accelerometer told of lately: body FLU, m/s^2, on our clock."""

    def __init__(self) -> None:
        self.heard_ns = NEVER_NS
        """When it was told of last."""
        self._samples: deque[tuple[int, Vec3]] = deque(maxlen=FORCES)
        self._taken_ns = NEVER_NS

    def hear(self, t_ns: int, force_flu_m_s2: Vec3, now_ns: int) -> bool:
        """Take in what it felt until t_ns, for some milliseconds; not what no accelerometer can show."""
        possible = float(np.abs(force_flu_m_s2).max()) <= FORCE_MOST_M_S2
        if possible:
            self.heard_ns = now_ns
            self._samples.append((t_ns, force_flu_m_s2))
        return possible

    def take(self, to_ns: int) -> Vec3 | None:
        """The mean (3) of what it felt from the last call's time to this one's; None where that is not told of.

        What comes later than the frame it belongs to is lost: nobody knows any more how the body lay then.
        """
        total, count = np.zeros(3), 0
        while self._samples and self._samples[0][0] <= to_ns:
            t_ns, force_flu_m_s2 = self._samples.popleft()
            if t_ns > self._taken_ns:
                total, count = total + force_flu_m_s2, count + 1
        self._taken_ns = to_ns
        return total / count if count else None


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
    force: FeltForce = field(default_factory=FeltForce)
