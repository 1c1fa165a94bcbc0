"""Where the autopilot believes it is: dead reckoning put right by an external pose, or by its own simulated receiver.

The inertial sensors are ideal but for a constant bias, so the estimate is the true motion plus an offset, and
the filter is the offset's: bias drives it, accepted poses pull it back. The rules of acceptance are those an
EKF has: fresh, in order, finite, upright as the inertial sensors are, and near where the estimate says.
"""

import math
from typing import NamedTuple, Protocol

import numpy as np

from formation.maths.arrays import Quat, Vec3
from formation.model import Vec3Tuple
from formation.safety.attitude_innovation import Tilt, tilt
from formation.vehicle.profile import VehicleState

_AGE_MAX_NS = 500_000_000
_FRESH_NS = 300_000_000
_READY_AFTER_NS = 1_000_000_000
_VALID_NS = 1_000_000_000
_RESET_AFTER_NS = 1_000_000_000
_POS_INNOVATION_MAX_M = 0.3
_POS_INNOVATION_GROWTH_M_S = 0.3
_YAW_INNOVATION_MAX_RAD = 0.35
_TILT_INNOVATION_COS = math.cos(0.35)
_OWN_READY_NS = 2_000_000_000
# Fraction of a pose's innovation believed at once; the velocity gain that damps it critically.
_GAIN = 0.2
_GAIN_VEL = _GAIN * _GAIN / (2.0 - _GAIN)
_GAIN_YAW = 0.02


class ExternalPose(NamedTuple):
    """A pose from outside, its capture on this agent's own clock."""

    t_capture_ns: int
    pos_lab_m: Vec3
    q_lab_from_flu: Quat


class Offset(NamedTuple):
    """What the estimate is off by: turned by `yaw_rad` about lab z, then shifted."""

    pos_lab_m: Vec3Tuple = (0.0, 0.0, 0.0)
    vel_lab_m_s: Vec3Tuple = (0.0, 0.0, 0.0)
    yaw_rad: float = 0.0


class Belief(NamedTuple):
    """Where the autopilot thinks it is, in its own estimate's frame (`lab` if the external pose is right)."""

    pos_lab_m: Vec3Tuple
    vel_lab_m_s: Vec3Tuple
    yaw_rad: float


NO_OFFSET = Offset()


def believed(state: VehicleState, offset: Offset) -> Belief:
    """The truth as the estimate has it."""
    pos, vel = state.pos_lab_m.tolist(), state.vel_lab_m_s.tolist()
    yaw = heading(state.q_lab_from_flu.tolist())
    if offset is NO_OFFSET:
        return Belief(tuple(pos), tuple(vel), yaw)
    c, s = math.cos(offset.yaw_rad), math.sin(offset.yaw_rad)
    ox, oy, oz = offset.pos_lab_m
    ux, uy, uz = offset.vel_lab_m_s
    return Belief(
        (c * pos[0] - s * pos[1] + ox, s * pos[0] + c * pos[1] + oy, pos[2] + oz),
        (c * vel[0] - s * vel[1] + ux, s * vel[0] + c * vel[1] + uy, vel[2] + uz),
        math.remainder(yaw + offset.yaw_rad, math.tau),
    )


def turned(q_lab_from_flu: Quat, yaw_rad: float) -> Quat:
    """The attitude turned by `yaw_rad` about lab z."""
    if yaw_rad == 0.0:
        return q_lab_from_flu
    w, x, y, z = q_lab_from_flu.tolist()
    c, s = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    turn = (c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w)
    return np.array(turn if turn[0] >= 0.0 else tuple(-e for e in turn))


def heading(q: list[float]) -> float:
    """Heading of the body's forward axis about lab z, rad."""
    w, x, y, z = q
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


class Positioning(Protocol):
    """A source of position: what the estimate is off by, and whether to arm or fly on it."""

    def offset(self, now_ns: int) -> Offset:
        """What the estimate is off by."""
        ...

    @property
    def yaw_rad(self) -> float:
        """What the estimate's heading is off by."""
        ...

    def valid(self, now_ns: int) -> bool:
        """Whether a flight may go on with it."""
        ...

    def fault(self, now_ns: int) -> str | None:
        """Why one must not arm on it, or None."""
        ...

    def accept(self, pose: ExternalPose, now_ns: int, state: VehicleState, t_state_ns: int) -> bool:
        """Whether an external pose was used; `state` is the truth at `t_state_ns`, near the capture."""
        ...


class OwnPositioning:
    """An autopilot's simulated receiver: exact, ready a moment after boot; it ignores external poses."""

    def __init__(self, t0_ns: int) -> None:
        self._ready_ns = t0_ns + _OWN_READY_NS

    def offset(self, now_ns: int) -> Offset:  # noqa: ARG002
        """Nothing."""
        return NO_OFFSET

    @property
    def yaw_rad(self) -> float:
        """Nothing."""
        return 0.0

    def valid(self, now_ns: int) -> bool:
        """Once it has found itself."""
        return now_ns >= self._ready_ns

    def fault(self, now_ns: int) -> str | None:
        """Until it has found itself."""
        return None if self.valid(now_ns) else "waiting for estimator to initialize"

    def accept(self, pose: ExternalPose, now_ns: int, state: VehicleState, t_state_ns: int) -> bool:  # noqa: ARG002
        """Never."""
        return False


class ExternalPositioning:
    """The external pose alone: not ready without it, valid for a second after it."""

    def __init__(self, bias_lab_m_s2: Vec3Tuple) -> None:
        self._bias = bias_lab_m_s2
        self._pos = [0.0, 0.0, 0.0]
        self._vel = [0.0, 0.0, 0.0]
        self.yaw_rad = 0.0
        self._t_ns = 0
        self._capture_ns = -(2**62)
        self._good_ns: int | None = None  # receipt of the last accepted pose
        self._since_ns = 0  # start of the present unbroken run of accepted poses
        self._reject_reason = "no external pose"
        self.rejected = 0

    def offset(self, now_ns: int) -> Offset:
        """What the last pose left, and the drift since."""
        self._drift(now_ns)
        px, py, pz = self._pos
        vx, vy, vz = self._vel
        return Offset((px, py, pz), (vx, vy, vz), self.yaw_rad)

    def valid(self, now_ns: int) -> bool:
        """Dead reckoning is trusted for a second."""
        return self._good_ns is not None and now_ns - self._good_ns < _VALID_NS

    def fault(self, now_ns: int) -> str | None:
        """Stale, refused, or not steady for a second yet."""
        if self._good_ns is None or now_ns - self._good_ns > _FRESH_NS:
            return self._reject_reason
        return None if self._good_ns - self._since_ns >= _READY_AFTER_NS else "external pose not steady yet"

    def accept(self, pose: ExternalPose, now_ns: int, state: VehicleState, t_state_ns: int) -> bool:
        """Correct the estimate by a pose that passes every test; a refusal is counted and its reason kept."""
        q, true_q = pose.q_lab_from_flu.tolist(), state.q_lab_from_flu.tolist()
        yaw = math.remainder(heading(q) - heading(true_q), math.tau)
        self._drift(now_ns)
        lost = self._good_ns is None or now_ns - self._good_ns > _RESET_AFTER_NS
        predicted = believed(state, Offset(yaw_rad=yaw if lost else self.yaw_rad))
        dt_s = (pose.t_capture_ns - t_state_ns) * 1e-9
        motion = zip(pose.pos_lab_m.tolist(), predicted.pos_lab_m, predicted.vel_lab_m_s, strict=True)
        measured = [p - (t + v * dt_s) for p, t, v in motion]
        reject_reason = self._format_fault(pose.t_capture_ns, now_ns, measured, q)
        if reject_reason is None:
            reject_reason = self._attitude_fault(q, true_q)
        if reject_reason is None and not lost:
            reject_reason = self._jump_fault(measured, yaw, now_ns)
        if reject_reason is not None:
            self.rejected += 1
            self._reject_reason = reject_reason
            return False
        if lost:
            self._pos, self._vel, self.yaw_rad = measured, [0.0, 0.0, 0.0], yaw
            self._since_ns = now_ns
        else:
            self._correct(measured, yaw, (pose.t_capture_ns - self._capture_ns) * 1e-9)
            if now_ns - (self._good_ns or 0) > _FRESH_NS:
                self._since_ns = now_ns
        self._capture_ns, self._good_ns = pose.t_capture_ns, now_ns
        self._reject_reason = "external pose is stale"
        return True

    def _correct(self, measured: list[float], yaw_rad: float, dt_s: float) -> None:
        for axis in range(3):
            innovation = measured[axis] - self._pos[axis]
            self._pos[axis] += _GAIN * innovation
            self._vel[axis] += _GAIN_VEL / max(dt_s, 0.002) * innovation
        self.yaw_rad += _GAIN_YAW * math.remainder(yaw_rad - self.yaw_rad, math.tau)

    def _format_fault(self, t_capture_ns: int, now_ns: int, measured: list[float], q: list[float]) -> str | None:
        if not math.isfinite(sum(measured) + sum(q)):
            return "external pose is not finite"
        if not 0 <= now_ns - t_capture_ns <= _AGE_MAX_NS:
            return "external pose has a wrong time"
        if t_capture_ns <= self._capture_ns:
            return "external pose is out of order"
        return None

    def _attitude_fault(self, q: list[float], true_q: list[float]) -> str | None:
        """Why an attitude disagrees with the measured gravity direction."""
        upright = up_dot(q, tilt(q), true_q, tilt(true_q)) >= _TILT_INNOVATION_COS
        return None if upright else "external attitude disagrees with gravity"

    def _jump_fault(self, measured: list[float], yaw_rad: float, now_ns: int) -> str | None:
        """Why a pose cannot be where the vehicle is, by its inertial sensors."""
        limit_m = _POS_INNOVATION_MAX_M + _POS_INNOVATION_GROWTH_M_S * (now_ns - (self._good_ns or now_ns)) * 1e-9
        if math.dist(measured, self._pos) > limit_m:
            return "external position jumped"
        if abs(math.remainder(yaw_rad - self.yaw_rad, math.tau)) > _YAW_INNOVATION_MAX_RAD:
            return "external heading jumped"
        return None

    def _drift(self, now_ns: int) -> None:
        dt_s = (now_ns - self._t_ns) * 1e-9
        if self._good_ns is not None and dt_s > 0.0:
            for axis in range(3):
                self._pos[axis] += dt_s * (self._vel[axis] + 0.5 * dt_s * self._bias[axis])
                self._vel[axis] += dt_s * self._bias[axis]
        self._t_ns = max(now_ns, self._t_ns)


def up_cos(q_lab_from_flu: Quat) -> float:
    """Cosine of the tilt."""
    x, y = float(q_lab_from_flu[1]), float(q_lab_from_flu[2])
    return 1.0 - 2.0 * (x * x + y * y)


def up_dot(q: list[float], q_tilt: Tilt, p: list[float], p_tilt: Tilt) -> float:
    """Cosine of the angle between two attitudes' ideas of up, in the body's axes, which no heading changes."""
    up = (1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2])) * (1.0 - 2.0 * (p[1] * p[1] + p[2] * p[2]))
    return q_tilt[0] * p_tilt[0] + q_tilt[1] * p_tilt[1] + up
