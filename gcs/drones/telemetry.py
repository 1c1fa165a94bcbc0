"""The ground's view of its drones: packets, the newest of each message, their own estimates.

*Packets.* Losses by sequence number, and two senders under one identity, whatever the packets say.
*Messages.* Those that are read, and the modes that are a pilot's.
*Own estimate.* What a drone's own estimator says of it: an independent estimate, beside the mocap, before motors are
cut by rule.
"""

import math
from collections import deque
from dataclasses import dataclass, field, replace
from math import exp

import numpy as np

from formation.maths.arrays import Quat, Vec3
from formation.messages import FORCE_MOST_M_S2, Event, Severity
from formation.model import Vec3Tuple
from wire.autopilots.table import FlightMode
from wire.link_messages import (
    EkfStatus,
    Heartbeat,
    LandedState,
    MavAutopilot,
    MavState,
    MavType,
    MessageId,
)
from wire.rejections import RejectionLog

MODULO = 256
FORWARD = MODULO // 2  # a step this long or longer is a step back: a packet overtaken on the way
NEAR = 4  # a stream is recognised by a step this short
CAME_MASK = (1 << NEAR + 1) - 1
STREAM_TIMEOUT_NS = 500_000_000
MEMORY_S = 1.0
TURNS, TURNS_SHARE = 4.0, 0.15
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
FORCE_NS, STEP_MOST_NS = 5_000_000, 100_000_000  # of so long HIGHRES_IMU is the mean (PX4); the longest mean of ours
# A person flies it in these: the ground leaves it alone.
PILOTED = frozenset(
    {FlightMode.MANUAL, FlightMode.STABILIZED, FlightMode.ACRO, FlightMode.ALTITUDE, FlightMode.POSITION,
     FlightMode.HOLD}
)  # fmt: skip
FRESH_NS = 300_000_000
WORDS_A_SECOND = 20
NOWHERE: Vec3Tuple = (math.nan, math.nan, math.nan)


@dataclass(slots=True)
class _Stream:
    """A counter that goes on: its newest number, and which of those just behind it came (bit k: k before it)."""

    seq: int
    received_ns: int
    came: int = 1

    def advance(self, step: int, now_ns: int) -> None:
        """Go on to the number `step` further."""
        self.seq = (self.seq + step) % MODULO
        self.received_ns = now_ns
        self.came = (self.came << step | 1) & CAME_MASK

    def repeats(self, behind: int) -> bool:
        """Whether the number that far behind the newest had come before; it has now."""
        before = self.came
        self.came |= 1 << behind
        return self.came == before


@dataclass(slots=True)
class SequenceMonitor:
    """One sender's sequence numbers (0..255, one more each packet).

    Two senders that use the same address show as two interleaved counters: each packet continues one of two streams,
    and the stream changes again and again; where the counters are close, numbers come twice. A lone sender never
    returns to a counter it has left, and what a network delays on the way fills a gap, once.
    """

    received: int = 0
    lost: int = 0
    superseded: int = 0
    """Packets that its link dropped unread, for newer ones."""
    _skipped: int = 0
    _misaddressed: int = 0
    _stream: _Stream | None = None
    _other: _Stream | None = None
    _turns: float = 0.0
    _packets: float = 0.0
    _noted_ns: int = 0

    @property
    def loss(self) -> float:
        """The part of the packets that never came, 0..1."""
        sent = self.received + self.lost
        return self.lost / sent if sent else 0.0

    def duplicate(self, now_ns: int) -> bool:
        """Whether two senders were heard in turns in about the last second."""
        if self._turns < TURNS or self._turns < TURNS_SHARE * self._packets:
            return False
        return self._turns * exp(-(now_ns - self._noted_ns) * 1e-9 / MEMORY_S) >= TURNS

    def skip(self, superseded: int) -> None:
        """So many packets were dropped unread since the last."""
        self.superseded += superseded
        self._skipped += superseded

    def note(self, seq: int, now_ns: int, misaddressed: int = 0) -> None:
        """A packet with this number came; misaddressed: how many came so far that were for others."""
        self.received += 1
        self._skipped += misaddressed - self._misaddressed
        self._misaddressed = misaddressed
        if self._stream is None:
            self._stream, self._noted_ns = _Stream(seq, now_ns), now_ns
            return
        self._count(self._turn(self._stream, seq, now_ns), now_ns)

    def _turn(self, stream: _Stream, seq: int, now_ns: int) -> bool:
        """Place the number on a stream; whether a lone sender would not have sent it now."""
        step = (seq - stream.seq) % MODULO
        behind = -step % MODULO
        if behind <= NEAR:
            return self._receive_late(stream, behind)
        if step > NEAR and self._other is not None and self._goes_on(self._other, seq, now_ns):
            self._stream, self._other = self._other, stream
            return True
        if step >= FORWARD:  # too far back to be overtaken on the way: the counter is another one
            self._stream, self._other = _Stream(seq, now_ns), stream
            return False
        if step > NEAR:
            self._other = replace(stream)
        stream.advance(step, now_ns)
        explained = min(self._skipped, step - 1)
        self._skipped -= explained
        self.lost += step - 1 - explained
        return False

    def _receive_late(self, stream: _Stream, behind: int) -> bool:
        if stream.repeats(behind):
            return True
        self.lost = max(self.lost - 1, 0)  # late, not lost
        return False

    def _goes_on(self, other: _Stream, seq: int, now_ns: int) -> bool:
        step = (seq - other.seq) % MODULO
        if now_ns - other.received_ns >= STREAM_TIMEOUT_NS or not 0 < step <= NEAR:
            return False
        other.advance(step, now_ns)
        return True

    def _count(self, turned: bool, now_ns: int) -> None:
        fade = exp(-(now_ns - self._noted_ns) * 1e-9 / MEMORY_S)
        self._noted_ns = now_ns
        self._turns = self._turns * fade + turned
        self._packets = self._packets * fade + 1.0


@dataclass(slots=True)
class Reports:
    """Events about one drone: its texts, and ours of it; beyond WORDS_A_SECOND they are counted only."""

    name: str
    events: list[Event] = field(default_factory=list)
    texts: deque[str] = field(default_factory=lambda: deque(maxlen=4))
    """Its own newest, since they were last cleared."""
    rejections: RejectionLog = field(default_factory=RejectionLog)
    _second_ns: int = NEVER_NS
    _count: int = 0

    def add(self, severity: Severity, text: str, now_ns: int) -> None:
        """Add an event of this drone."""
        if now_ns - self._second_ns >= 1_000_000_000:
            self._second_ns, self._count = now_ns, 0
        self._count += 1
        if self._count > WORDS_A_SECOND:
            self.rejections.note(self.name, f"texts beyond {WORDS_A_SECOND} a second", now_ns)
        else:
            self.events.append(Event(severity, self.name, text))

    def pop(self, now_ns: int) -> list[Event]:
        """The events since the last call."""
        events, self.events = [*self.events, *self.rejections.due(now_ns)], []
        return events


def ground_heartbeat(session: int) -> Heartbeat:
    """A ground's own heartbeat; its custom_mode holds the ground session."""
    return Heartbeat(MavAutopilot.INVALID, MavType.GCS, 0, session & 0xFFFFFFFF, MavState.ACTIVE)


class SpecificForce:
    """The specific force that a drone's accelerometer measured lately: body FLU, m/s^2, on our clock."""

    def __init__(self) -> None:
        self.received_ns = self.asked_ns = NEVER_NS
        """When the last measurement came, and when the stream was last asked for."""
        self.is_missing = False
        """Whether it was reported that none comes."""
        self._samples: deque[tuple[int, Vec3]] = deque(maxlen=64)
        self._before_ns, self._mean_until_ns = NEVER_NS, NEVER_NS

    def receive(self, t_ns: int, force_flu_m_s2: Vec3, now_ns: int) -> bool:
        """Receive a measurement of t_ns; False, rejected, beyond FORCE_MOST_M_S2."""
        possible = float(np.abs(force_flu_m_s2).max()) <= FORCE_MOST_M_S2
        if possible:
            self.received_ns = now_ns
            self._samples.append((t_ns, force_flu_m_s2))
        return possible

    def pop_mean(self, to_ns: int) -> Vec3 | None:
        """The mean measurement (3) over the time since the last call; None without one of that time.

        Each counts by its share of that time: of a vibration, which successive measurements show with opposite signs,
        little is left, however they lie between the frames. Where the newest ends before to_ns, the mean is over as
        long a time that ends with it. What comes after its frame is discarded: the attitude of that time is no longer
        known.
        """
        step_ns, self._mean_until_ns = min(to_ns - self._mean_until_ns, STEP_MOST_NS), to_ns
        samples = self._samples
        end_ns = min(samples[-1][0], to_ns) if samples else NEVER_NS
        if end_ns <= to_ns - step_ns:
            return None
        start_ns = end_ns - step_ns
        while samples[0][0] <= start_ns:
            self._before_ns = samples.popleft()[0]
        total, span_ns, before_ns = np.zeros(3), 0, self._before_ns
        for t_ns, force_flu_m_s2 in samples:
            part_ns = min(t_ns, end_ns) - max(before_ns, start_ns, t_ns - FORCE_NS)
            if part_ns > 0:
                total, span_ns = total + part_ns * force_flu_m_s2, span_ns + part_ns
            before_ns = max(t_ns, before_ns)
        return total / span_ns if span_ns else None


@dataclass(slots=True)
class Telemetry:
    """The newest of each thing the drone reported, and when; battery 0..1, NaN where unknown.

    received_ns: of anything valid. behind_s: how old the newest stamped message was when it was read. mode: by its last
    heartbeat. other_ground_ns: of its last answer to another ground. foreign_sysid: of another drone on its link.
    """

    heartbeat: Heartbeat | None = None
    heartbeat_ns: int = NEVER_NS
    received_ns: int = NEVER_NS
    mode: FlightMode | None = None
    behind_s: float = math.nan
    behind_ns: int = NEVER_NS
    other_ground_ns: int = NEVER_NS
    foreign_sysid: int | None = None
    guard_text: str = ""
    """The first of its guard's warnings that go on, and when the newest of them came."""
    guard_ns: int = NEVER_NS
    landed: LandedState = LandedState.UNDEFINED
    battery: float = math.nan
    battery_v: float = math.nan
    drop_rate: float = 0.0
    """Share of packets lost on its own links, as a bridge's radio; NaN where it does not know."""
    setpoint_age_s: float = math.nan
    setpoint_age_ns: int = NEVER_NS
    estimator: EkfStatus | None = None
    sensors_unhealthy: int = 0
    """Sensors that SYS_STATUS has as switched on and not healthy (SensorFlag)."""
    origin: bool = False
    force: SpecificForce = field(default_factory=SpecificForce)


@dataclass(slots=True)
class OwnEstimate:
    """Its newest attitude and position, each of the time t_ns at which the drone made it, our clock.

    What is older than 0.3 s is not said any more, however lately it arrived.
    Its local frame need not be the lab's: where it begins is settled by a mocap pose while both are trusted.
    """

    attitudes: deque[tuple[int, Quat]] = field(default_factory=lambda: deque(maxlen=8))
    """Its attitudes since they were last cleared: times, ns, on our clock, and q_lab_from_flu."""
    _tilt_rad: float = math.nan
    _attitude_ns: int = NEVER_NS
    _position_m: Vec3Tuple = NOWHERE
    _position_ns: int = NEVER_NS
    _origin_lab_m: Vec3Tuple = NOWHERE
    _pos_lab_m: Vec3Tuple = NOWHERE

    def receive_attitude(self, q_lab_from_flu: Quat, t_ns: int) -> None:
        """ATTITUDE_QUATERNION came; t_ns: NEVER_NS where its time is not known."""
        if t_ns != NEVER_NS:
            self.attitudes.append((t_ns, q_lab_from_flu))
        _, x, y, _ = q_lab_from_flu.tolist()
        self._tilt_rad, self._attitude_ns = math.acos(min(max(1.0 - 2.0 * (x * x + y * y), -1.0), 1.0)), t_ns

    def receive_position(self, pos_m: Vec3, t_ns: int) -> None:
        """LOCAL_POSITION_NED came; along the lab's axes, from wherever it counts."""
        x, y, z = pos_m.tolist()
        self._position_m, self._position_ns = (x, y, z), t_ns
        self._update_position()

    def settle(self, pos_lab_m: Vec3, now_ns: int) -> None:
        """It is here, says the mocap, and nothing is in doubt."""
        if now_ns - self._position_ns <= FRESH_NS:
            x, y, z = (float(here - own) for here, own in zip(pos_lab_m.tolist(), self._position_m, strict=True))
            self._origin_lab_m = (x, y, z)
            self._update_position()

    def at(self, now_ns: int) -> tuple[float, Vec3Tuple]:
        """The angle of its own vertical to the lab's, and where it believes itself.

        NaN where it does not say; the position, too, where its origin was never settled.
        """
        tilt_rad = self._tilt_rad if now_ns - self._attitude_ns <= FRESH_NS else math.nan
        return tilt_rad, self._pos_lab_m if now_ns - self._position_ns <= FRESH_NS else NOWHERE

    def _update_position(self) -> None:
        (x, y, z), (x0, y0, z0) = self._position_m, self._origin_lab_m
        self._pos_lab_m = (x + x0, y + y0, z + z0)


@dataclass(slots=True)
class ArmedClock:
    """A heartbeat reports arming late; the acknowledgement of our command gives the time. The result is never too late.

    since_ns: None while disarmed. lasted_s: for how long it was armed the last time.
    """

    since_ns: int | None = None
    lasted_s: float = 0.0
    _disarmed_ns: int | None = None
    _accepted_ns: int | None = None

    def accept(self, now_ns: int) -> None:
        """The drone has accepted a command to arm, or to disarm."""
        if self.since_ns is None and self._accepted_ns is None:
            self._accepted_ns = now_ns

    def receive_heartbeat(self, armed: bool, now_ns: int) -> None:
        """Receive a heartbeat."""
        if armed and self.since_ns is None:
            known = [t_ns for t_ns in (self._disarmed_ns, self._accepted_ns) if t_ns is not None]
            self.since_ns = max(known, default=now_ns)
        if not armed:
            if self.since_ns is not None:
                self.lasted_s = (now_ns - self.since_ns) * 1e-9
            self.since_ns, self._accepted_ns, self._disarmed_ns = None, None, now_ns
