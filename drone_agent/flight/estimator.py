"""Where the autopilot believes it is, by its inertial samples and the positions and headings that come to it.

The filter is drone_agent.flight.ekf. What is here are the times: of a pose, of a source that was rejected for so
long that the estimate is set to it, of the last one fused. The sources are mocap poses, or a simulated GNSS receiver
with a compass.
"""

import math

import numpy as np

from drone_agent.autopilots.model import Fusion
from drone_agent.flight import ekf
from drone_agent.flight.vehicle import ExternalPose, ImuSample
from drone_agent.guard.position import Belief
from formation.maths.arrays import Float, Quat, Vec3
from formation.maths.quaternion import heading_of

_AGE_MAX_NS = 500_000_000
_FRESH_NS = 300_000_000
_UNSTEADY = "external pose not steady yet"
_FIX = Fusion(np.array([0.001, 0.01, 5.0, 5.0]), 1.0, 5.0)
"""Of the simulated receiver and compass, which are exact."""
PLANE, HEIGHT, HEADING = 0, 1, 2
_AXES = ((0, 2), (2, 3))
_REASONS = ("external position jumped", "external height jumped", "external heading jumped")


class Estimator:
    """Of one autopilot, which boots at t0_ns, standing level."""

    def __init__(self, t0_ns: int, ready_after_ns: int = 1_000_000_000, waits: str = _UNSTEADY) -> None:
        """ready_after_ns: how long poses must have come without a gap before one may arm on them; waits: said until."""
        self._x, self._cov = np.empty(16), np.empty((ekf.ERRORS, ekf.ERRORS))
        self._history = np.full((ekf.HISTORY, 5), -math.inf)
        self._row = 0
        self._climbed = np.zeros(1)
        self._ratios = np.zeros(3)
        ekf.begin(self._x, self._cov, np.zeros(3), 0.0)
        self._history[0] = 0.0
        self.t_ns = self._t0_ns = t0_ns
        self.rate_flu_rad_s: Vec3 = np.zeros(3)
        """At the newest inertial sample; overwritten by the next."""
        self._ready_after_ns, self._waits = ready_after_ns, waits
        self._capture_ns = -(2**62)
        self._fused_ns: list[int | None] = [None, None, None]
        self._was_ready = False
        self._since_ns = 0  # start of the present unbroken run of fused poses
        # Of the position while rejected; then it is fused no more (EKF2's `_nb_ev_pos_reset_available`).
        self._resets = 5
        self._valid_ns = 0
        self._reject_reason = "no external pose"

    @property
    def q_lab_from_flu(self) -> Quat:
        """The attitude at the newest inertial sample; a view."""
        return self._x[0:4]

    @property
    def pos_lab_m(self) -> Vec3:
        """The position then; a view."""
        return self._x[ekf.POS : ekf.POS + 3]

    @property
    def vel_lab_m_s(self) -> Vec3:
        """The velocity then; a view."""
        return self._x[ekf.VEL : ekf.VEL + 3]

    @property
    def climbed_m_s(self) -> float:
        """The climb since boot by the inertial samples alone: its differences are what no pose can feign."""
        return float(self._climbed[0])

    def belief(self) -> Belief:
        """The estimate at the newest inertial sample."""
        _, _, _, _, vx, vy, vz, x, y, z = self._x[:10].tolist()
        return Belief((x, y, z), (vx, vy, vz), heading_of(self._x))

    def receive_sample(self, sample: ImuSample) -> Quat:
        """Advance to a sample; returns the attitude then."""
        self._row = (self._row + 1) % ekf.HISTORY
        dt_s, self.t_ns = (sample.t_ns - self.t_ns) * 1e-9, sample.t_ns
        t_s = (sample.t_ns - self._t0_ns) * 1e-9
        ekf.predict(
            self._x, self._cov, sample.values, t_s, dt_s, self._history, self._row, self._climbed, self.rate_flu_rad_s
        )
        return self._x[0:4]

    def receive_fix(self, t_ns: int, pos_lab_m: Vec3, q_lab_from_flu: Quat) -> None:
        """A position and heading of the autopilot's own receiver and compass."""
        self.receive_pose(ExternalPose(t_ns, pos_lab_m, q_lab_from_flu), t_ns, _FIX)

    def rest(self) -> None:
        """It is disarmed on the floor: it stands still, to 0.03 m/s."""
        ekf.observe_rest(self._x, self._cov, self._history, 0.03)

    def valid(self, now_ns: int) -> bool:
        """Whether a flight may go on with the position: once steady, until none was fused for too long."""
        fused_ns = self._fused_ns[PLANE]
        return self._was_ready and fused_ns is not None and now_ns - fused_ns < self._valid_ns

    def fault(self, now_ns: int) -> str | None:
        """Why one must not arm on it: no pose, rejected, or not steady yet."""
        fused_ns = self._fused_ns[PLANE]
        if fused_ns is None or now_ns - fused_ns > _FRESH_NS:
            return self._reject_reason
        return None if fused_ns - self._since_ns >= self._ready_after_ns else self._waits

    def receive_pose(self, pose: ExternalPose, now_ns: int, fusion: Fusion) -> None:
        """Fuse what of a pose is within its limits; why the position was not, `fault` says."""
        measured = np.array([*pose.pos_lab_m.tolist(), heading_of(pose.q_lab_from_flu)])
        reason = self._format_fault(pose.t_capture_ns, now_ns, measured)
        if reason is None:
            self._capture_ns, self._valid_ns = pose.t_capture_ns, round(fusion.valid_s * 1e9)
            reason = self._fuse(measured, pose.t_capture_ns, now_ns, fusion)
        self._reject_reason = reason or "external pose is stale"

    def _format_fault(self, t_capture_ns: int, now_ns: int, measured: Float) -> str | None:
        if not math.isfinite(sum(measured.tolist())):
            return "external pose is not finite"
        if not 0 <= now_ns - t_capture_ns <= _AGE_MAX_NS:
            return "external pose has a wrong time"
        if t_capture_ns <= self._capture_ns:
            return "external pose is out of order"
        return None

    def _fuse(self, measured: Float, t_capture_ns: int, now_ns: int, fusion: Fusion) -> str | None:
        """Observe it; a group that was not fused for too long is reset to it. Why the position was not, or None."""
        fused_ns, t_s = self._fused_ns, (t_capture_ns - self._t0_ns) * 1e-9
        before_ns = fused_ns[PLANE]
        lasting_ns = round(fusion.reset_after_s * 1e9)
        for group, last_ns in enumerate(fused_ns):
            if last_ns is None or now_ns - last_ns > lasting_ns:
                self._reset(group, measured, fusion)
        ekf.observe_pose(
            self._x, self._cov, self._history, self._row, t_s, measured, fusion.noise_and_limits, self._ratios
        )
        reason = None
        for group, ratio in enumerate(self._ratios.tolist()):
            if ratio <= 1.0:
                fused_ns[group] = now_ns
            else:
                reason = reason or _REASONS[group]
        if fused_ns[PLANE] != now_ns:
            return reason
        if before_ns is None or now_ns - before_ns > _FRESH_NS:
            self._since_ns = now_ns
        self._was_ready = self._was_ready or now_ns - self._since_ns >= self._ready_after_ns
        return None

    def _reset(self, group: int, measured: Float, fusion: Fusion) -> None:
        if group == HEADING:
            variance = float(fusion.noise_and_limits[1]) ** 2
            ekf.reset_heading(self._x, self._cov, self._history, float(measured[3]), variance)
            return
        if group == PLANE and self._fused_ns[PLANE] is not None:
            if not self._resets:
                return
            self._resets -= 1
        first, last = _AXES[group]
        variance = float(fusion.noise_and_limits[0]) ** 2
        ekf.reset_position(self._x, self._cov, self._history, measured[:3], variance, first, last)


def up_cos(q_lab_from_flu: Quat) -> float:
    """Cosine of the tilt."""
    x, y = float(q_lab_from_flu[1]), float(q_lab_from_flu[2])
    return 1.0 - 2.0 * (x * x + y * y)
