"""Frames without a mocap: the poses that simulated autopilots report. Sans-IO, MAVLink in, frames out.

The age of a pose follows from its stamp and the clock offset (TIMESYNC on the same link). A pose without a stamp is as
old as the newest stamped message of that link. So a pose that waited in a queue never counts as fresh.

A simulator's true state (HIL_STATE_QUATERNION, SIM_STATE) replaces the local position estimate, which drifts by
decimetres. The true position is quantised to a centimetre. So it is extrapolated by the true velocity, and corrected
slowly: a step of the position moves it no faster than one step of the reported velocity.
"""

from dataclasses import dataclass, field
from math import exp

import numpy as np

from formation.config import LabConfig
from formation.maths.arrays import Quat, Vec3
from formation.maths.frames import IDENTITY
from formation.maths.geodesy import from_globe
from formation.messages import Datagram, LabFrame
from formation.safety.rules_table import BEHIND_HOLD_S
from wire.clock_offset import ClockOffset
from wire.link_messages import (
    DRONE_COMPONENT,
    GROUND,
    Address,
    AttitudeQuaternion,
    LinkMessage,
    LocalPosition,
    MessageId,
    SimTruth,
    TimeSync,
)
from wire.mavlink.codec import Codec

POS_STEP_M, SMOOTHING_MOST_S = 0.0111, 4.0  # 1e-7 degrees of latitude
AWAIT_TRUTH_NS = 3_000_000_000  # asked for once its heartbeat is heard, among much else
EXTRAPOLATED_PERIODS = 2.5
LOST_NS = 500_000_000
OLDEST_NS = round(BEHIND_HOLD_S * 1e9)
"""A pose that is older is not seen."""


def streams(config: LabConfig) -> tuple[tuple[int, float], ...]:
    """The messages to ask each drone for, id and rate, Hz: its accelerometer's if wanted, and poses without a mocap."""
    inertial = ((int(MessageId.HIGHRES_IMU), config.link.imu_rate_hz),) if config.link.imu_rate_hz > 0.0 else ()
    if config.mocap.source != "mavlink":
        return inertial
    rate_hz = config.mocap.rate_hz
    return (
        *inertial,
        (MessageId.LOCAL_POSITION_NED, rate_hz),
        (MessageId.ATTITUDE_QUATERNION, rate_hz),
        (MessageId.HIL_STATE_QUATERNION, rate_hz),
        (MessageId.SIM_STATE, rate_hz),
    )


@dataclass(slots=True)
class _Body:
    """One drone's reported pose: from its first true state on, or from AWAIT_TRUTH_NS on where none comes.

    truth_origin: latitude, longitude (degrees) and altitude (m) of its first true position, the spawn.
    age_ns: of the newest stamped message when it was read.
    """

    spawn_lab_m: Vec3
    clock: ClockOffset = field(default_factory=ClockOffset)
    age_ns: int = 0
    codec: Codec = field(default_factory=lambda: Codec(GROUND))
    pos_lab_m: Vec3 | None = None
    vel_lab_m_s: Vec3 = field(default_factory=lambda: np.zeros(3))
    pos_ns: int = 0
    q_lab_from_flu: Quat | None = None
    has_attitude: bool = False
    first_ns: int | None = None
    truth_origin: tuple[float, float, float] | None = None
    fresh: bool = False

    def receive(self, message: LinkMessage, now_ns: int) -> None:
        """Add one message of the drone. Setpoints refer to its own attitude; the true one is used without it."""
        self.first_ns = now_ns if self.first_ns is None else self.first_ns
        match message:
            case TimeSync() if message.tc1_ns and message.ts1_ns <= now_ns:
                self.clock.exchange(message.ts1_ns, message.tc1_ns, now_ns)
            case LocalPosition():
                made_ns = self._made_ns(message.t_boot_ms * 1_000_000, now_ns)
                if self.truth_origin is None and now_ns - self.first_ns >= AWAIT_TRUTH_NS:
                    self._move(self.spawn_lab_m + message.pos_lab_m, message.vel_lab_m_s, made_ns)
            case AttitudeQuaternion():
                self._made_ns(message.t_boot_ms * 1_000_000, now_ns)
                self.q_lab_from_flu, self.has_attitude = message.q_lab_from_flu, True
            case SimTruth():
                self._receive_truth(message, now_ns)

    def at(self, now_ns: int) -> Vec3:
        """Position in the lab, extrapolated from its message's time to `now_ns`."""
        pos_lab_m = np.zeros(3) if self.pos_lab_m is None else self.pos_lab_m
        ahead: Vec3 = pos_lab_m + (now_ns - self.pos_ns) * 1e-9 * self.vel_lab_m_s
        return ahead

    def _made_ns(self, stamp_ns: int, now_ns: int) -> int:
        """When a message with that stamp was made, our clock; not after now."""
        made_ns = self.clock.made_ns(stamp_ns, now_ns)
        self.age_ns = now_ns - made_ns
        return made_ns

    def _move(self, pos_lab_m: Vec3, vel_lab_m_s: Vec3, made_ns: int) -> None:
        self.pos_lab_m, self.vel_lab_m_s, self.pos_ns = pos_lab_m, np.nan_to_num(vel_lab_m_s), made_ns
        self.fresh = self.q_lab_from_flu is not None

    def _receive_truth(self, truth: SimTruth, now_ns: int) -> None:
        made_ns = self._made_ns(truth.t_us * 1000, now_ns) if truth.t_us else now_ns - self.age_ns
        if not self.has_attitude:
            self.q_lab_from_flu = truth.q_lab_from_flu
        if self.truth_origin is None:
            self.truth_origin = truth.lat_deg, truth.lon_deg, truth.alt_m
            self._move(self.spawn_lab_m, truth.vel_lab_m_s, made_ns)
            return
        passed_s = (made_ns - self.pos_ns) * 1e-9
        ahead = self.at(made_ns) + 0.5 * passed_s * (truth.vel_lab_m_s - self.vel_lab_m_s)
        smoothing_s = min(POS_STEP_M / max(truth.vel_step_m_s, 1e-9), SMOOTHING_MOST_S)
        share = 1.0 - exp(-max(passed_s, 0.0) / smoothing_s)
        self._move(ahead + share * (self._true_position(truth) - ahead), truth.vel_lab_m_s, made_ns)

    def _true_position(self, truth: SimTruth) -> Vec3:
        """The true position in the lab: metres north, west and up of its first position."""
        origin = self.truth_origin or (truth.lat_deg, truth.lon_deg, truth.alt_m)
        x_m, y_m = from_globe(origin, truth.lat_deg, truth.lon_deg)
        position: Vec3 = self.spawn_lab_m + np.array([x_m, y_m, truth.alt_m - origin[2]])
        return position


class AutopilotPoses:
    """Turns the drones' telemetry into frames of all bodies, one whenever every drone that speaks has spoken."""

    def __init__(self, config: LabConfig) -> None:
        self._names = tuple(v.body for v in config.vehicles)
        self._sysids = tuple(v.sysid for v in config.vehicles)
        self._bodies = {v.sysid: _Body(np.array(v.spawn_lab_m)) for v in config.vehicles if v.sysid is not None}
        self._delay_ns = round(config.mocap.delay_s * 1e9)
        self._longest_ns = round(1.5e9 / config.mocap.rate_hz)
        self._extrapolated_ns = round(EXTRAPOLATED_PERIODS * 1e9 / config.mocap.rate_hz)
        self._seq = 0
        self._frame_ns = 0

    def receive(self, datagram: Datagram, now_ns: int) -> LabFrame | None:
        """Receive one datagram; return the next frame if one is due."""
        body = self._bodies.get(datagram.sysid)
        if body is None:
            return None
        for packet in body.codec.receive(datagram.data):
            if packet.source == Address(datagram.sysid, DRONE_COMPONENT):
                body.receive(packet.message, now_ns)
        return self._frame(now_ns) if self._is_due(now_ns) else None

    def _is_due(self, now_ns: int) -> bool:
        alive = [b for b in self._bodies.values() if b.pos_lab_m is not None and now_ns - b.pos_ns < LOST_NS]
        fresh = [b.fresh for b in alive]
        return any(fresh) and (all(fresh) or now_ns - self._frame_ns >= self._longest_ns)

    def _frame(self, now_ns: int) -> LabFrame:
        """All poses at one time; a late one is extrapolated by its velocity for up to EXTRAPOLATED_PERIODS."""
        n = len(self._names)
        pos, q, seen = np.zeros((n, 3)), np.tile(IDENTITY, (n, 1)), np.zeros(n, np.bool_)
        made_ns = max(body.pos_ns for body in self._bodies.values() if body.fresh)
        for i, sysid in enumerate(self._sysids):
            body = None if sysid is None else self._bodies[sysid]
            if body is None or body.q_lab_from_flu is None or body.pos_lab_m is None:
                continue
            body.fresh = False
            if made_ns - body.pos_ns <= self._extrapolated_ns and now_ns - body.pos_ns <= OLDEST_NS:
                pos[i], q[i], seen[i] = body.at(made_ns), body.q_lab_from_flu, True
        self._seq, self._frame_ns = self._seq + 1, now_ns
        return LabFrame(self._seq, made_ns - self._delay_ns, self._names, pos, q, seen)
