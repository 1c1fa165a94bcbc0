"""Which of the ground's setpoints the bridge passes on, and how; what it refuses is counted. No sockets."""

from typing import NamedTuple

from drone_agent.bounds import BEYOND, within_bounds
from drone_agent.failsafe import StreamFailsafe
from drone_agent.setpoint_gate import Refusal, SetpointGate
from drone_agent.stages import Stage
from formation.messages import Event
from wire.link_messages.address import BROADCAST
from wire.link_messages.message_id import MessageId
from wire.link_messages.setpoints import AttitudeSetpoint
from wire.mavlink.codec import Codec, MavlinkError, read_frame
from wire.mavlink.framing import Frame
from wire.refusals import Refusals

_GLOBAL_POSITION_TARGET = 86
SETPOINTS = frozenset({MessageId.SET_ATTITUDE_TARGET, MessageId.SET_POSITION_TARGET_LOCAL_NED, _GLOBAL_POSITION_TARGET})


class Taken(NamedTuple):
    """The bytes to pass on, None of a setpoint that is refused; the attitude target in them, where it is ours."""

    passed: bytes | None = None
    target: AttitudeSetpoint | None = None


def stamp_ms(frame: Frame) -> int:
    """`time_boot_ms`, the first field of every setpoint on the wire."""
    return int.from_bytes(frame.payload[:4], "little")


class BridgeSetpoints:
    """One drone's; `stream` says in which stage it is, and who owns it."""

    def __init__(self, sysid: int, t0_ns: int, stream: StreamFailsafe, without: frozenset[str]) -> None:
        self.gate = SetpointGate(without)
        self.pose_slides = False
        """Whether what they are made of is not so."""
        self.refusals = Refusals()
        self.bounded = Refusals("bounded")
        """Setpoints that asked for more than is passed on."""
        self._sysid = sysid
        self._t0_ns = t0_ns
        self._stream = stream
        self._without = without

    def told(self, now_ns: int) -> tuple[Event, ...]:
        """What there is to tell of setpoints that were not passed on, or not as they asked."""
        return (*self.refusals.due(now_ns), *self.bounded.due(now_ns))

    def take(self, frame: Frame, now_ns: int) -> Taken:
        """Judge one frame of SETPOINTS: byte for byte, or bounded in its sender's name, or not at all."""
        try:
            target = read_frame(frame).message
        except MavlinkError:
            return self._refuse(frame, Refusal.UNREADABLE, now_ns)
        attitude = target if isinstance(target, AttitudeSetpoint) else None
        if attitude is not None and attitude.target.system not in (BROADCAST, self._sysid):
            return Taken(frame.data)
        refusal = self._refusal(frame, now_ns)
        if refusal is not None:
            return self._refuse(frame, refusal, now_ns)
        if attitude is None or "setpoint-bounds" in self._without:
            return Taken(frame.data, attitude)
        bounded = within_bounds(attitude, None)
        if bounded is attitude:
            return Taken(frame.data, attitude)
        self.bounded.note(frame.source.words, BEYOND, now_ns)
        return Taken(Codec(frame.source).encode(bounded), bounded)

    def _refusal(self, frame: Frame, now_ns: int) -> Refusal | None:
        stream = self._stream
        if stream.stage in (Stage.LAND, Stage.DESCEND):
            return Refusal.LANDING
        if self.pose_slides and stream.stage in (Stage.FOLLOW, Stage.HOLD):
            return Refusal.SLIDING_POSE
        if stream.stage is not Stage.FOLLOW:
            self.gate.forget_order()
        if not stream.obeys(frame.source) and "foreign-setpoint" not in self._without:
            return Refusal.FOREIGN
        return self.gate.judge(frame.source, stamp_ms(frame), now_ns - self._t0_ns)

    def _refuse(self, frame: Frame, refusal: Refusal, now_ns: int) -> Taken:
        self.refusals.note(frame.source.words, refusal.value, now_ns)
        return Taken()
