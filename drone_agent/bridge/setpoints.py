"""Which of the ground's setpoints the bridge passes on, and how; what it refuses is counted. No sockets."""

from typing import NamedTuple

from drone_agent.bounds import BEYOND, within_bounds
from drone_agent.failsafe import StreamFailsafe
from drone_agent.setpoint_filter import RejectReason, SetpointFilter
from drone_agent.stages import Stage
from formation.messages import Event
from wire.link_messages.address import BROADCAST
from wire.link_messages.message_id import MessageId
from wire.link_messages.setpoints import AttitudeSetpoint
from wire.mavlink.codec import Codec, MavlinkError, read_frame
from wire.mavlink.framing import Frame
from wire.rejections import RejectionLog

_GLOBAL_POSITION_TARGET = 86
SETPOINTS = frozenset({MessageId.SET_ATTITUDE_TARGET, MessageId.SET_POSITION_TARGET_LOCAL_NED, _GLOBAL_POSITION_TARGET})


class FilteredSetpoint(NamedTuple):
    """The bytes to pass on, None for a rejected setpoint; the attitude target in them, where it is ours."""

    passed: bytes | None = None
    target: AttitudeSetpoint | None = None


def stamp_ms(frame: Frame) -> int:
    """`time_boot_ms`, the first field of every setpoint on the wire."""
    return int.from_bytes(frame.payload[:4], "little")


class BridgeSetpoints:
    """One drone's; `stream` says in which stage it is, and who owns it."""

    def __init__(self, sysid: int, t0_ns: int, stream: StreamFailsafe, without: frozenset[str]) -> None:
        self.setpoint_filter = SetpointFilter(without)
        self.pose_rejected = False
        """Whether the mocap poses are rejected: setpoints made from them are, too."""
        self.rejections = RejectionLog()
        self.bounded = RejectionLog("bounded")
        """Setpoints that asked for more than is passed on."""
        self._sysid = sysid
        self._t0_ns = t0_ns
        self._stream = stream
        self._without = without

    def due_events(self, now_ns: int) -> tuple[Event, ...]:
        """The due reports of rejected and limited setpoints."""
        if not (self.rejections.has_pending or self.bounded.has_pending):
            return ()
        return (*self.rejections.due(now_ns), *self.bounded.due(now_ns))

    def filter(self, frame: Frame, now_ns: int) -> FilteredSetpoint:
        """Pass one frame of SETPOINTS unchanged, limit it in its sender's name, or reject it."""
        try:
            target = read_frame(frame).message
        except MavlinkError:
            return self._reject(frame, RejectReason.UNREADABLE, now_ns)
        attitude = target if isinstance(target, AttitudeSetpoint) else None
        if attitude is not None and attitude.target.system not in (BROADCAST, self._sysid):
            return FilteredSetpoint(frame.data)
        reject_reason = self._reject_reason(frame, now_ns)
        if reject_reason is not None:
            return self._reject(frame, reject_reason, now_ns)
        if attitude is None or "setpoint-bounds" in self._without:
            return FilteredSetpoint(frame.data, attitude)
        bounded = within_bounds(attitude, None)
        if bounded is attitude:
            return FilteredSetpoint(frame.data, attitude)
        self.bounded.note(frame.source.words, BEYOND, now_ns)
        return FilteredSetpoint(Codec(frame.source).encode(bounded), bounded)

    def _reject_reason(self, frame: Frame, now_ns: int) -> RejectReason | None:
        stream = self._stream
        if stream.stage in (Stage.LAND, Stage.DESCEND):
            return RejectReason.LANDING
        if self.pose_rejected and stream.stage in (Stage.FOLLOW, Stage.HOLD):
            return RejectReason.POSE_FAULT
        if stream.stage is not Stage.FOLLOW:
            self.setpoint_filter.reset_order()
        if not stream.obeys(frame.source) and "foreign-setpoint" not in self._without:
            return RejectReason.FOREIGN
        return self.setpoint_filter.judge(frame.source, stamp_ms(frame), now_ns - self._t0_ns)

    def _reject(self, frame: Frame, reject_reason: RejectReason, now_ns: int) -> FilteredSetpoint:
        self.rejections.note(frame.source.words, reject_reason.value, now_ns)
        return FilteredSetpoint()
