"""Which setpoints are fresh enough to be obeyed, within which bounds, and which the guard passes on. No sockets.

A setpoint's `time_boot_ms` says when, on its sender's clock, what it was computed from was seen. TIMESYNC with that
sender turns it into an age. A sender that does no TIMESYNC, or whose stamps are on a clock of their own (MAVSDK's
are), is judged by the order of its stamps alone; a stamp of zero is none, as MAVProxy sends it.
"""

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

import numpy as np

from drone_agent.guard.failsafe import StreamFailsafe
from drone_agent.guard.stages import Stage
from formation.maths.arrays import Quat
from formation.maths.frames import canonical, from_rotation_vector, from_yaw, multiply, yaw
from formation.messages import Event
from wire.clock_offset import ClockOffset
from wire.link_messages import BROADCAST, Address, AttitudeSetpoint, Ignore, MessageId
from wire.mavlink.codec import Codec, read_message
from wire.mavlink.framing import Frame, MavlinkError
from wire.rejections import RejectionLog

AGE_MAX_MS = 100.0
AHEAD_MAX_MS = 50.0
"""By which a stamp may seem to be of the future: half of what an exchange over a slow link may be off by."""
_OTHER_CLOCK_MS = 2000.0
_SENDERS = 8
ASK_NS = 200_000_000


class RejectReason(Enum):
    """Why a setpoint is rejected; the names of the monitors that reject are in drone_agent.guard.stages."""

    STALE = "setpoint older than 100 ms"
    OLD = "setpoint not newer than the last"
    FOREIGN = "setpoint of a ground that does not own the drone"
    UNREADABLE = "setpoint that is not finite"
    RATES = "setpoint beyond the vehicle's body rates"
    LANDING = "setpoint to a drone that lands by itself"
    POSE_FAULT = "setpoint while the pose is rejected"


@dataclass(slots=True)
class Sender:
    """One sender of setpoints: its clock, and the last stamp followed."""

    clock: ClockOffset = field(default_factory=ClockOffset)
    on_clock: bool = False
    """Whether its stamps have been on the clock of its TIMESYNC messages."""
    last_ms: int | None = None
    asked_ns: int | None = None
    reported: bool = False

    def is_age_unknown(self) -> bool:
        """Whether the age of its setpoints is unknown; true once."""
        if self.on_clock or self.reported:
            return False
        self.reported = True
        return True

    def asks(self, now_ns: int) -> bool:
        """Whether to ask it for its clock now: five times a second until it has answered."""
        if self.clock.offset_ns is not None or (self.asked_ns is not None and now_ns - self.asked_ns < ASK_NS):
            return False
        self.asked_ns = now_ns
        return True


class SetpointFilter:
    """Rejects setpoints by their stamps, for each sender."""

    def __init__(self, without: frozenset[str] = frozenset()) -> None:
        self._ages, self._orders = "stale-setpoint" not in without, "old-setpoint" not in without
        self._senders: dict[Address, Sender] = {}

    def judge(self, sender: Sender, stamp_ms: int, now_ns: int) -> RejectReason | None:
        """Why a setpoint is not to be followed, or None; now_ns: on the clock that TIMESYNC exchanges."""
        if stamp_ms == 0 and not sender.on_clock:
            return None
        age_ms = sender.clock.since_ms(stamp_ms, now_ns)
        if age_ms is not None and self._ages:
            fresh = -AHEAD_MAX_MS <= age_ms <= AGE_MAX_MS
            sender.on_clock = sender.on_clock or fresh
            if not fresh and (sender.on_clock or AGE_MAX_MS < age_ms < _OTHER_CLOCK_MS):
                return RejectReason.STALE
        if sender.last_ms is not None and self._orders:
            newer_ms = (stamp_ms - sender.last_ms + 2**31) % 2**32 - 2**31
            if newer_ms < 0 or (newer_ms == 0 and sender.on_clock):
                return RejectReason.OLD
        sender.last_ms = stamp_ms
        return None

    def reset_order(self) -> None:
        """Allow lower stamps after the stream broke off: a restarted sender may count from zero."""
        for sender in self._senders.values():
            if not sender.on_clock:
                sender.last_ms = None

    def sender(self, source: Address) -> Sender:
        """The state of a sender; of more than eight at a time one whose clock is not known is forgotten first."""
        known = self._senders.get(source)
        if known is None:
            if len(self._senders) >= _SENDERS:
                del self._senders[min(self._senders, key=lambda address: self._senders[address].on_clock)]
            known = self._senders[source] = Sender()
        return known


TILT_MAX_RAD = math.radians(50.0)
"""Half as much again as the ground's own limit asks for; PX4's MPC_TILTMAX_AIR is 45 degrees."""
BEYOND = "setpoint beyond tilt or thrust"
"""The report of limited setpoints."""
TILT_MAX_COS = math.cos(TILT_MAX_RAD)
_RATES = tuple(int(axis) for axis in (Ignore.ROLL_RATE, Ignore.PITCH_RATE, Ignore.YAW_RATE))


def within_bounds(target: AttitudeSetpoint) -> AttitudeSetpoint:
    """The setpoint itself where tilt and thrust (0..1) are within the bounds, else one that asks for just so much."""
    _, x, y, _ = target.q_lab_from_flu.tolist()
    tilted = 1.0 - 2.0 * (x * x + y * y) < TILT_MAX_COS
    if not (tilted or not 0.0 <= target.thrust_norm <= 1.0):
        return target
    return target._replace(
        q_lab_from_flu=_tilted_less(target.q_lab_from_flu) if tilted else target.q_lab_from_flu,
        thrust_norm=min(max(target.thrust_norm, 0.0), 1.0),
    )


def turns_too_fast(target: AttitudeSetpoint, rate_max_rad_s: float) -> bool:
    """Whether a body rate that the setpoint does not ignore is more than the vehicle can follow.

    Limited and passed on, as a tilt is, it would turn a drone over all the same that is sent no attitude beside it.
    """
    for axis, rate in zip(_RATES, target.rate_flu_rad_s.tolist(), strict=True):
        if not target.ignore & axis and not abs(rate) <= rate_max_rad_s:
            return True
    return False


def _tilted_less(q_lab_from_flu: Quat) -> Quat:
    """The same heading and direction of tilt, tilted by the bound; level where it is upside down."""
    w, x, y, z = q_lab_from_flu.tolist()
    up_x, up_y = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x)
    side = math.hypot(up_x, up_y)
    heading = from_yaw(np.array(yaw(q_lab_from_flu)))
    if side < 1e-6:
        return heading
    tilt = TILT_MAX_RAD * np.array([-up_y / side, up_x / side, 0.0])
    return canonical(multiply(from_rotation_vector(tilt), heading))


SETPOINTS = frozenset(
    {
        MessageId.SET_ATTITUDE_TARGET,
        MessageId.SET_POSITION_TARGET_LOCAL_NED,
        MessageId.SET_POSITION_TARGET_GLOBAL_INT,
    }
)


class FilteredSetpoint(NamedTuple):
    """The frame to pass on, None for a rejected setpoint; the attitude target in it, where it is ours."""

    passed: Frame | None = None
    target: AttitudeSetpoint | None = None


def stamp_ms(frame: Frame) -> int:
    """`time_boot_ms`, the first field of every setpoint on the wire."""
    return int.from_bytes(frame.payload[:4], "little")


class BodySetpoints:
    """One drone's; `stream` says in which stage it is, and who owns it."""

    def __init__(
        self, sysid: int, rate_max_rad_s: float, t0_ns: int, stream: StreamFailsafe, without: frozenset[str]
    ) -> None:
        self.setpoint_filter = SetpointFilter(without)
        self.pose_rejected = False
        """Whether the mocap poses are rejected: setpoints made from them are, too."""
        self.rejections = RejectionLog()
        self.bounded = RejectionLog("bounded")
        """Setpoints that asked for more than is passed on."""
        self._sysid, self._rate_max_rad_s = sysid, rate_max_rad_s
        self._t0_ns = t0_ns
        self._stream = stream
        self._without = without

    def due_events(self, now_ns: int) -> tuple[Event, ...]:
        """The due reports of rejected and limited setpoints."""
        if not (self.rejections.has_pending or self.bounded.has_pending):
            return ()
        return (*self.rejections.due(now_ns), *self.bounded.due(now_ns))

    def filter(self, frame: Frame, sender: Sender, now_ns: int) -> FilteredSetpoint:
        """Pass one frame of SETPOINTS unchanged, limit it in its sender's name, or reject it."""
        try:
            target = read_message(frame)
        except MavlinkError:
            return self._reject(frame, RejectReason.UNREADABLE, now_ns)
        attitude = target if isinstance(target, AttitudeSetpoint) else None
        if attitude is not None and attitude.target.system not in (BROADCAST, self._sysid):
            return FilteredSetpoint(frame)
        reject_reason = self._reject_reason(frame, sender, now_ns)
        if reject_reason is not None:
            return self._reject(frame, reject_reason, now_ns)
        if attitude is None or "setpoint-bounds" in self._without:
            return FilteredSetpoint(frame, attitude)
        if turns_too_fast(attitude, self._rate_max_rad_s):
            return self._reject(frame, RejectReason.RATES, now_ns)
        bounded = within_bounds(attitude)
        if bounded is attitude:
            return FilteredSetpoint(frame, attitude)
        self.bounded.note(frame.source.words, BEYOND, now_ns)
        return FilteredSetpoint(Codec(frame.source).frames(bounded)[0], bounded)

    def _reject_reason(self, frame: Frame, sender: Sender, now_ns: int) -> RejectReason | None:
        stream = self._stream
        if stream.stage in (Stage.LAND, Stage.DESCEND):
            return RejectReason.LANDING
        if self.pose_rejected and stream.stage in (Stage.FOLLOW, Stage.HOLD):
            return RejectReason.POSE_FAULT
        if stream.stage is not Stage.FOLLOW:
            self.setpoint_filter.reset_order()
        if not stream.obeys(frame.source) and "foreign-setpoint" not in self._without:
            return RejectReason.FOREIGN
        return self.setpoint_filter.judge(sender, stamp_ms(frame), now_ns - self._t0_ns)

    def _reject(self, frame: Frame, reject_reason: RejectReason, now_ns: int) -> FilteredSetpoint:
        self.rejections.note(frame.source.words, reject_reason.value, now_ns)
        return FilteredSetpoint()
