"""Where the bridge's body is and how it moves: the guard's navigator, fed by the autopilot's messages and the mocap.

`BodyEstimate` is the navigator of one body, `BodyFeed` checks its mocap poses and passes them on to the autopilot,
`InertialStream` sees that the autopilot sends HIGHRES_IMU. Times are of our monotonic clock. No bytes.
"""

import math
from math import isfinite, nan
from operator import mul
from typing import NamedTuple

import numpy as np

from drone_agent.guard.integrity import SIGNATURES, Signature
from drone_agent.guard.navigator import SOURCES, Fault, Navigator
from drone_agent.guard.setpoints import TILT_MAX_COS
from formation.maths.arrays import Quat, Vec3
from formation.maths.quaternion import thrust_axis
from formation.messages import FROZEN_FRAMES, Innovation, LabFrame, Rejection
from formation.navigation.receive import Input, RejectReason
from formation.navigation.state import POS, SAMPLES, Airframe
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleProfile
from wire.clock_offset import TimeSyncClient
from wire.link_messages import (
    Address,
    AttitudeQuaternion,
    CommandAck,
    CommandLong,
    EkfStatus,
    EstimatorFlag,
    InertialSample,
    MavCommand,
    MessageId,
    Result,
    VisionPose,
    command_long,
)

_ONE = np.array([0])
_REASONS = tuple(RejectReason)
_INNOVATION_NS = 100_000_000
"""Between recorded innovations: ten a second show how a source behaves; what it did is in the log's own streams."""
_SCALE_LEAST, _SCALE_MOST = 0.4, 2.5
"""True over modelled thrust, as far as a profile may be another vehicle's: from 0.3 to 0.75 of full to hover."""
_LOSS_LASTS_NS, _LOSS_LEFT = 200_000_000, 0.875
"""Less of the thrust scale than half of the least loss in the table takes, so long after it was detected."""
_UPSET_RAD_S = 2.0
"""Half of what an autopilot turns with at most (MC_ROLLRATE_MAX 220 degrees/s); a formation turns with 1."""
_TUMBLES, _TUMBLES_NS = 1.5, 50_000_000
"""Times the largest rate that its autopilot commands: no command turns it so fast."""
_STRAYS_COS, _STRAYS_NS = math.cos(math.radians(30.0)), 200_000_000
"""The angle of ArduCopter's crash check; for so long in the air, where what swings may come to rest."""
_FLAGS = (
    EstimatorFlag.ATTITUDE
    | EstimatorFlag.VELOCITY_HORIZ
    | EstimatorFlag.VELOCITY_VERT
    | EstimatorFlag.POS_HORIZ_ABS
    | EstimatorFlag.POS_VERT_ABS
)


class Motion(NamedTuple):
    """Position and velocity in `lab`."""

    pos_lab_m: Vec3
    vel_lab_m_s: Vec3


class BodyEstimate:
    """One body."""

    def __init__(self, vehicle: VehicleProfile, sysid: int, signatures: tuple[Signature, ...] = SIGNATURES) -> None:
        """vehicle: what its thrust is modelled by; sysid: in what is recorded; signatures: the faults to detect."""
        frame = Airframe(
            np.array(vehicle.drag_n_s_m) / vehicle.mass_kg,
            round(vehicle.thrust_dead_time_s * 1e9),
            vehicle.thrust_lag_s,
        )
        self._vehicle, self._sysid = vehicle, sysid
        self._navigator = Navigator(1, frame, signatures=signatures)
        self._recorded_ns = 0
        self._flown = False
        self._rate_flu_rad_s = np.zeros(3)
        self._stands = True
        self.pose_fault = ""
        """The last detected fault of its poses; empty before the first."""
        self.faults: list[Fault] = []
        """Detected, until they are reported."""
        self._commanded_up: tuple[float, float, float] | None = None
        """Where the thrust is commanded to point; None: nobody knows."""
        self._tumbles_since_ns: int | None = None
        self._strays_since_ns: int | None = None
        self._loss: tuple[int, float] | None = None
        """When a loss of thrust was detected, and the thrust scale then."""

    def receive_imu(self, t_ns: int, sample: InertialSample) -> None:
        """A HIGHRES_IMU, the mean until t_ns; a rate that is not known counts as none."""
        rate = self._note_rate(t_ns, sample.rate_flu_rad_s)
        if self._navigator.receive_imu(_ONE, np.array([t_ns]), sample.specific_force_flu_m_s2[None], rate[None]):
            self._collect_faults()

    def receive_attitude(self, t_ns: int, attitude: AttitudeQuaternion) -> None:
        """An ATTITUDE_QUATERNION, of t_ns."""
        q, rate = attitude.q_lab_from_flu, attitude.rate_flu_rad_s
        self._note_rate(t_ns, rate)
        if self._navigator.receive_attitude(_ONE, np.array([t_ns]), q[None], rate[None]):
            self._collect_faults()
        self._note_tilt(t_ns, q)

    def receive_command(self, t_ns: int, thrust_norm: float, q_lab_from_flu: Quat | None = None) -> None:
        """Thrust and attitude that the autopilot is commanded from t_ns on.

        thrust_norm: NaN on the ground, or where nobody knows; q_lab_from_flu: None where nobody knows.

        Of a body that turns fast nobody knows: its mixer gives thrust away to turn it.

        The first of a flight is taken for the one that carries the body: the profile may be another vehicle's.
        """
        x_rad_s, y_rad_s, _ = self._rate_flu_rad_s.tolist()
        flown = math.isfinite(thrust_norm)
        self._commanded_up = None if q_lab_from_flu is None else thrust_axis(q_lab_from_flu)
        known = flown and math.hypot(x_rad_s, y_rad_s) < _UPSET_RAD_S
        if self._loss is not None and not known:
            self._loss = (t_ns, self._loss[1]) if flown else None  # what a turn hides is looked at after it
        thrust_m_s2 = self._vehicle.thrust_n_of(thrust_norm) / self._vehicle.mass_kg if known else math.nan
        if known and not self._flown:
            self._flown = True
            self._navigator.thrust_scale[0] = _bounded_scale(GRAVITY_M_S2 / max(thrust_m_s2, 0.1))
        self._navigator.receive_thrust(_ONE, np.array([t_ns]), np.array([thrust_m_s2]))

    def receive_pose(self, t_ns: int, pos_lab_m: Vec3, q_lab_from_flu: Quat, *, stands: bool) -> RejectReason:
        """A mocap pose captured at t_ns; why it is no observation, NONE where it is one.

        stands: on the floor, which disturbs the IMU, and where a pose may repeat: nothing is a fault there.
        """
        navigator, self._stands = self._navigator, stands
        if stands:
            navigator.reset_checks(0)
        counts = navigator.rejected[0, Input.POSE]
        before = counts.tolist()
        if navigator.receive_pose(_ONE, np.array([t_ns]), pos_lab_m[None], q_lab_from_flu[None]):
            self._collect_faults()
        after = counts.tolist()
        for reason in _REASONS:
            if after[reason] > before[reason]:
                return reason
        return RejectReason.NONE

    @property
    def rejects_poses(self) -> bool:
        """Whether poses are rejected at present by the detected `pose_fault`."""
        return bool(self._navigator.rejecting[0]) and not self._stands

    def is_thrust_lost(self, now_ns: int) -> bool:
        """Whether a detected loss of thrust has lasted: a mixer that saturates in a gust loses some for a moment."""
        if self._loss is None or self._stands:
            self._loss = None
            return False
        since_ns, before = self._loss
        if now_ns - since_ns < _LOSS_LASTS_NS:
            return False
        lost = float(self._navigator.thrust_scale[0]) < _LOSS_LEFT * before
        self._loss = self._loss if lost else None
        return lost

    def is_attitude_lost(self, now_ns: int) -> bool:
        """Whether it tumbles, or is tilted otherwise than commanded and spins or is past every tilt that is commanded.

        For too long for a recovery, of which there is none on the floor. Who only spins, as a heavy body does with a
        weak motor, is let down on what is left; who only tilts otherwise may swing, and comes to rest.
        """
        if self._stands:
            self._tumbles_since_ns = None  # it bounces
        tumbles = self._tumbles_since_ns is not None and now_ns - self._tumbles_since_ns >= _TUMBLES_NS
        lasts_ns = _TUMBLES_NS if self._stands else _STRAYS_NS
        return tumbles or (self._strays_since_ns is not None and now_ns - self._strays_since_ns >= lasts_ns)

    def _note_rate(self, t_ns: int, rate_flu_rad_s: Vec3) -> Vec3:
        """Notes the body rate, and since when it tumbles; the rate, zero along each axis that is not known."""
        x_rad_s, y_rad_s, z_rad_s = rate_flu_rad_s.tolist()
        if not isfinite(x_rad_s + y_rad_s + z_rad_s):
            rate_flu_rad_s = np.nan_to_num(rate_flu_rad_s)
            x_rad_s, y_rad_s, _ = rate_flu_rad_s.tolist()
        self._rate_flu_rad_s = rate_flu_rad_s
        tumbles = math.hypot(x_rad_s, y_rad_s) > _TUMBLES * self._vehicle.rate_max_rad_s
        if not tumbles:
            self._tumbles_since_ns = None
        elif self._tumbles_since_ns is None:
            self._tumbles_since_ns = t_ns
        return rate_flu_rad_s

    def _note_tilt(self, t_ns: int, q_lab_from_flu: Quat) -> None:
        wanted, up = self._commanded_up, thrust_axis(q_lab_from_flu)
        spins = abs(float(self._rate_flu_rad_s[2])) > _TUMBLES * self._vehicle.rate_yaw_max_rad_s
        past = spins or up[2] < TILT_MAX_COS
        strays = wanted is not None and past and sum(map(mul, wanted, up)) < _STRAYS_COS
        if not strays:
            self._strays_since_ns = None
        elif self._strays_since_ns is None:
            self._strays_since_ns = t_ns

    def _collect_faults(self) -> None:
        for fault in self._navigator.new_faults():
            self.faults.append(fault)
            if fault.signature.rolls_back:
                self.pose_fault = fault.signature.name
            elif fault.amplitude[0] < 0.0 and self._loss is None:
                self._loss = (fault.t_ns, float(self._navigator.thrust_scale[0]))

    @property
    def hover_thrust_norm(self) -> float:
        """The thrust that carries the body at rest."""
        scale = _bounded_scale(float(self._navigator.thrust_scale[0]))
        return self._vehicle.thrust_norm_of(self._vehicle.weight_n / scale)

    @property
    def measures_force(self) -> bool:
        """Whether an accelerometer shows the motion; else thrust and attitude alone do."""
        ring = self._navigator.bodies[0].inertial
        return bool(ring.count) and math.isfinite(ring.force_flu_m_s2[(ring.count - 1) % SAMPLES, 0])

    def motion(self, t_ns: int) -> Motion | None:
        """Where it is at t_ns; None before the first pose."""
        motion = self._navigator.motion(0, t_ns)
        return None if motion is None else Motion(*motion)

    def pop_innovations(self, now_ns: int) -> tuple[Innovation, ...]:
        """The newest of every source that was observed, ten times a second; else nothing."""
        if now_ns - self._recorded_ns < _INNOVATION_NS:
            return ()
        self._recorded_ns = now_ns
        newest = (self._navigator.innovation(0, source, self._sysid) for source in range(len(SOURCES)))
        return tuple(innovation for innovation in newest if innovation.t_ns)

    def status(self, now_ns: int) -> EkfStatus:
        """ESTIMATOR_STATUS of this estimate."""
        body = self._navigator.bodies[0]
        x, y, z = body.innovations.test_ratio[0].tolist()
        variance = np.diag(body.estimate.cov)[POS : POS + 3]
        return EkfStatus(
            int(_FLAGS) if body.status.begun else int(EstimatorFlag.EKF_UNINITIALIZED), False, now_ns // 1000,
            max(x, y), z, math.sqrt(variance[0] + variance[1]), math.sqrt(variance[2]),
        )  # fmt: skip


def _bounded_scale(scale: float) -> float:
    return min(max(scale, _SCALE_LEAST), _SCALE_MOST)


def warm_up() -> None:
    """Compile what `BodyEstimate` calls: nothing compiles in flight."""
    navigator = Navigator()
    force, zero, level = np.array([[0.0, 0.0, 9.8]]), np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]])
    for k in range(1, 4):
        t_ns = np.array([k * 10_000_000])
        navigator.receive_thrust(_ONE, t_ns, np.array([9.8]))
        navigator.receive_imu(_ONE, t_ns, force, zero)
        navigator.receive_attitude(_ONE, t_ns, level, zero)
        navigator.receive_pose(_ONE, t_ns, 1e-4 * k * np.ones((1, 3)), level)
    navigator.predicted(0, 40_000_000)


_POSE_NS = 20_000_000
_DEAD_RECKONING_NS = 500_000_000
"""Longest hold on the inertial sensors alone, unseen or with faulty poses: they drift by some centimetres."""
_LIFTED_M = 0.05
"""Height above its stand with motors off: below, the floor disturbs the IMU, and no pose moves the drone."""


class BodyFeed:
    """One body's poses: each goes to its estimate, and to the autopilot unless the poses are rejected."""

    def __init__(self, body: str, estimate: BodyEstimate, t0_ns: int) -> None:
        self._body, self._estimate = body, estimate
        self._index = 0
        """Where the body was in the last frame."""
        self._pose_due_ns = t0_ns
        self._seen_ns: int | None = None
        self.fault = ""
        """Why the poses are rejected, and the setpoints made from them, too; empty where they are not."""
        self._withholds = False
        """Whether the autopilot is shown no pose any more, until its motors are off."""
        self._same = 0
        """So many frames in a row have repeated the pose before them to the last bit, in the air."""
        self._floor_m = nan
        self.stands = True
        """Whether it was last seen within _LIFTED_M of where it stood with motors off."""

    @property
    def begun(self) -> bool:
        """Whether the body was ever seen."""
        return self._seen_ns is not None

    def fresh(self, now_ns: int) -> bool:
        """Whether it is known where the body is."""
        return self._seen_ns is not None and now_ns - self._seen_ns < _DEAD_RECKONING_NS

    def withhold(self) -> None:
        """It comes down without poses. Where they were rejected, the autopilot is shown none until its motors are off.

        Where the body is becomes uncertain enough meanwhile for a pose that drifts to seem right again.
        """
        self._withholds = bool(self.fault)

    def receive_frame(self, frame: LabFrame, now_ns: int, *, armed: bool) -> VisionPose | None:
        """Receive a frame; returns the pose for the autopilot, at most fifty a second."""
        bodies = frame.bodies
        if self._index >= len(bodies) or bodies[self._index] != self._body:
            if self._body not in bodies:
                return None
            self._index = bodies.index(self._body)
        index = self._index
        t_ns, pos, q = frame.t_capture_ns, frame.pos_lab_m[index], frame.q_lab_from_flu[index]
        position_m = pos.tolist()
        if not frame.seen[index] or not all(map(isfinite, position_m)) or not all(map(isfinite, q.tolist())):
            if frame.rejected[index] == Rejection.FREEZE and not self.stands:
                self._same = FROZEN_FRAMES
                self.check()
            return None
        if not armed:
            self._floor_m, self._withholds = position_m[2], False
        self.stands = not armed or (not self.fault and self._is_low(position_m[2], now_ns))
        reason = self._estimate.receive_pose(t_ns, pos, q, stands=self.stands)
        if reason is RejectReason.FROZEN:
            self._same += 1
        elif reason is RejectReason.NONE:
            self._same = 0
        self.check()
        if self.fault or reason is not RejectReason.NONE:
            return None
        self._seen_ns = now_ns
        if self._withholds or now_ns < self._pose_due_ns:
            return None
        self._pose_due_ns = max(self._pose_due_ns + _POSE_NS, now_ns)  # a steady 50 Hz out of frames that jitter
        return VisionPose(t_ns // 1000, pos, q)

    def _is_low(self, height_m: float, now_ns: int) -> bool:
        """Whether the pose and the estimate before it say so: a pose that comes late shows the floor in the air."""
        most_m = self._floor_m + _LIFTED_M
        motion = self._estimate.motion(now_ns) if height_m <= most_m else None
        return height_m <= most_m and (motion is None or float(motion.pos_lab_m[2]) <= most_m)

    def check(self) -> None:
        """Find the `fault` of the poses; after every input of the estimate."""
        estimate = self._estimate
        self.fault = estimate.pose_fault if estimate.pose_fault and estimate.rejects_poses else ""
        if not self.fault and self._same >= FROZEN_FRAMES:
            self.fault = "pose frozen"


_LISTEN_NS = 1_500_000_000  # before it is asked for: the autopilot may send it anyhow
_ASK_NS = 1_000_000_000
_SHARE = 0.4  # of the rate wanted: what comes more slowly is asked for
_LONGEST_NS = 20_000_000  # between samples that nobody asked for: beyond, some were lost
_PATIENCE_NS = 5_000_000_000  # of requests, before the report that the stream is missing
LACKS = "No HIGHRES_IMU: slow pose drift is not detected"


class InertialStream:
    """The IMU stream of one autopilot; each sample goes to `estimate` with its time on our clock.

    sync: the autopilot's clock.
    """

    def __init__(self, target: Address, rate_hz: float, estimate: BodyEstimate, t0_ns: int) -> None:
        """rate_hz: wanted; 0: none, and all passes as it comes."""
        self._unasked, self._wanted = True, False
        """Whether it came before anybody asked; whether the ground did."""
        self._target, self._rate_hz = target, rate_hz
        self._longest_ns = round(1e9 / rate_hz) if rate_hz > 0.0 else _LONGEST_NS
        self._made_ns = t0_ns
        self._estimate = estimate
        self.sync = TimeSyncClient(target)
        self.restarted(t0_ns)

    @property
    def passes(self) -> bool:
        """Whether the ground is to hear it."""
        return self._unasked or self._wanted

    def receive_sample(self, sample: InertialSample, now_ns: int) -> None:
        """A sample came."""
        self._count += 1
        made_ns = self.sync.clock.made_ns(sample.t_boot_us * 1000, now_ns)
        # The estimate takes a sample for the mean of the interval until its time: its middle is when that was so.
        interval_ns, self._made_ns = min(max(made_ns - self._made_ns, 0), self._longest_ns), made_ns
        self._estimate.receive_imu(made_ns - self._delay_ns + interval_ns // 2, sample)

    def receive_attitude(self, attitude: AttitudeQuaternion, now_ns: int) -> None:
        """An attitude came."""
        made_ns = self.sync.clock.made_ns(attitude.t_boot_ms * 1_000_000, now_ns)
        self._estimate.receive_attitude(made_ns, attitude)

    def restarted(self, now_ns: int, delay_s: float = 0.0) -> None:
        """The autopilot is new, or was: listen, then ask again. delay_s: its table's `inertial_delay_s`."""
        self._delay_ns = round(delay_s * 1e9)
        self.sync = TimeSyncClient(self._target)
        self._asks_ns, self._count, self._rejected = now_ns + _LISTEN_NS, 0, self._rate_hz <= 0.0
        self._lacks_ns: int | None = None
        self._reported = self._rejected

    def answered(self, ack: CommandAck) -> None:
        """The autopilot answered a command of ours: what it does not know is not asked for again."""
        if ack.command == MavCommand.SET_MESSAGE_INTERVAL and ack.result is not Result.ACCEPTED:
            self._rejected = True

    def due(self, now_ns: int) -> CommandLong | None:
        """The request to send now, where too little comes."""
        if self._rejected or now_ns < self._asks_ns:
            return None
        lacks = self._count < _SHARE * self._rate_hz * _ASK_NS * 1e-9
        self._asks_ns, self._count = now_ns + _ASK_NS, 0
        if not lacks:
            self._lacks_ns = None
            return None
        self._lacks_ns = self._lacks_ns or now_ns
        self._unasked = False
        interval_us = 1e6 / self._rate_hz
        return command_long(self._target, MavCommand.SET_MESSAGE_INTERVAL, float(MessageId.HIGHRES_IMU), interval_us)

    def is_missing_report_due(self, now_ns: int) -> bool:
        """Whether to report now, once, that the stream is missing."""
        lacks = self._rejected or (self._lacks_ns is not None and now_ns - self._lacks_ns >= _PATIENCE_NS)
        is_missing_report_due, self._reported = lacks and not self._reported, self._reported or lacks
        return is_missing_report_due

    def requested(self, command: CommandLong) -> bool:
        """The ground sets a message's interval; whether that is this message's and ends here, as good as done."""
        if command.command != MavCommand.SET_MESSAGE_INTERVAL or command.params[0] != MessageId.HIGHRES_IMU:
            return False
        interval_us = command.params[1]
        self._wanted = interval_us >= 0.0
        self._unasked = self._unasked and self._wanted
        return not self._rejected and not 0.0 < interval_us <= 1e6 / self._rate_hz
