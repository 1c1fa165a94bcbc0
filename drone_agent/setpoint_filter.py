"""Which setpoints are fresh enough to be obeyed, by the guard's rule. Pure.

A setpoint's `time_boot_ms` says when, on its sender's clock, what it was computed from was seen. TIMESYNC with that
sender turns it into an age. A sender that does no TIMESYNC, or whose stamps are on a clock of their own (MAVSDK's
are), is judged by the order of its stamps alone; a stamp of zero is none, as MAVProxy sends it.
"""

from dataclasses import dataclass, field
from enum import Enum

from wire.clock_offset import ClockOffset
from wire.link_messages.address import Address

AGE_MAX_MS = 100.0
AHEAD_MAX_MS = 50.0
"""By which a stamp may seem to be of the future: half of what an exchange over a slow link may be off by."""
_OTHER_CLOCK_MS = 2000.0
_SENDERS = 8
_HALF = 1 << 31
ASK_NS = 200_000_000


class RejectReason(Enum):
    """Why a setpoint is rejected; the names of the monitors that reject are in drone_agent.monitors."""

    STALE = "setpoint older than 100 ms"
    OLD = "setpoint not newer than the last"
    FOREIGN = "setpoint of a ground that does not own the drone"
    UNREADABLE = "setpoint that is not finite"
    LANDING = "setpoint to a drone that lands by itself"
    POSE_FAULT = "setpoint while the pose is rejected"


@dataclass(slots=True)
class _Sender:
    """One sender of setpoints: its clock, and the last stamp followed."""

    clock: ClockOffset = field(default_factory=ClockOffset)
    on_clock: bool = False
    """Whether its stamps have been on the clock of its TIMESYNC messages."""
    last_ms: int | None = None
    asked_ns: int | None = None
    reported: bool = False


class SetpointFilter:
    """Rejects setpoints by their stamps, for each sender."""

    def __init__(self, without: frozenset[str] = frozenset()) -> None:
        self._ages, self._orders = "stale-setpoint" not in without, "old-setpoint" not in without
        self._senders: dict[Address, _Sender] = {}

    def clock(self, source: Address) -> ClockOffset:
        """The clock of that sender against ours."""
        return self._sender(source).clock

    def age_ms(self, source: Address, stamp_ms: int, now_ns: int) -> float | None:
        """Age of a stamp; None where its sender's clock is not known."""
        return self._sender(source).clock.age_ms(stamp_ms, now_ns)

    def judge(self, source: Address, stamp_ms: int, now_ns: int) -> RejectReason | None:
        """Why a setpoint is not to be followed, or None; now_ns: on the clock that TIMESYNC exchanges."""
        sender = self._sender(source)
        if stamp_ms == 0 and not sender.on_clock:
            return None
        age_ms = sender.clock.since_ms(stamp_ms, now_ns)
        if age_ms is not None and self._ages:
            fresh = -AHEAD_MAX_MS <= age_ms <= AGE_MAX_MS
            sender.on_clock = sender.on_clock or fresh
            if not fresh and (sender.on_clock or AGE_MAX_MS < age_ms < _OTHER_CLOCK_MS):
                return RejectReason.STALE
        if sender.last_ms is not None and self._orders:
            newer_ms = (stamp_ms - sender.last_ms + _HALF) % (2 * _HALF) - _HALF
            if newer_ms < 0 or (newer_ms == 0 and sender.on_clock):
                return RejectReason.OLD
        sender.last_ms = stamp_ms
        return None

    def reset_order(self) -> None:
        """Allow lower stamps after the stream broke off: a restarted sender may count from zero."""
        for sender in self._senders.values():
            if not sender.on_clock:
                sender.last_ms = None

    def is_age_unknown(self, source: Address) -> bool:
        """Whether the age of this sender's setpoints is unknown; true once."""
        sender = self._sender(source)
        if sender.on_clock or sender.reported:
            return False
        sender.reported = True
        return True

    def asks(self, source: Address, now_ns: int) -> bool:
        """Whether to ask this sender for its clock now: five times a second until it has answered."""
        sender = self._sender(source)
        if sender.clock.offset_ns is not None or (sender.asked_ns is not None and now_ns - sender.asked_ns < ASK_NS):
            return False
        sender.asked_ns = now_ns
        return True

    def _sender(self, source: Address) -> _Sender:
        """What is known of a sender; of more than eight at a time one whose clock is not known is forgotten first."""
        known = self._senders.get(source)
        if known is None:
            if len(self._senders) >= _SENDERS:
                del self._senders[min(self._senders, key=lambda address: self._senders[address].on_clock)]
            known = self._senders[source] = _Sender()
        return known
