"""Where n bodies are and how they move, by inertial samples and mocap poses, and which poses are faulty. No bytes.

One error-state Kalman filter a body (formation.navigation.error_state); why nothing is fused late, and how the present
is predicted, says formation.navigation.fusion. A guard has one body, the ground has all. Times are of this machine's
monotonic clock. Inputs in any order of arrival, each source's stamps rising.
"""

from dataclasses import dataclass

import numpy as np

from drone_agent.guard.integrity import SIGNATURES, Signature, shapes
from formation.maths.arrays import Bool, Float, Vec3
from formation.maths.frames import IDENTITY
from formation.maths.records import blank
from formation.messages import Innovation
from formation.navigation import receive, samples
from formation.navigation.evidence import empty_bank
from formation.navigation.receive import Input, Ints, RejectReason
from formation.navigation.state import Airframe, Body, Estimate

SOURCES = ("pose position", "pose attitude", "autopilot attitude", "thrust")


@dataclass(frozen=True, slots=True)
class Fault:
    """A detected fault of one body. onset_ns: stamp of the last pose before it; amplitude (3) in the row's unit."""

    body: int
    signature: Signature
    t_ns: int
    onset_ns: int
    statistic: float
    amplitude: Vec3


class Navigator:
    """The navigator of n bodies. rejected (n, inputs, reasons): how many inputs were used (NONE) and rejected, why."""

    def __init__(
        self,
        n: int = 1,
        airframe: Airframe | None = None,
        pose_rate_hz: float = 120.0,
        signatures: tuple[Signature, ...] = SIGNATURES,
    ) -> None:
        """airframe: of all; pose_rate_hz: at most, for the false-alarm rate."""
        self.signatures = signatures
        self.bodies = blank(Body, n)
        self._bank = empty_bank(shapes(signatures, pose_rate_hz), n)
        self.rejected: Ints = np.zeros((n, len(Input), len(RejectReason)), np.int64)
        self._reported = np.zeros(n, np.int64)
        # Fields of all bodies, read outside of kernels: through a record, each level of it would cost a microsecond.
        self._rejecting_ns: Ints = self.bodies["status"]["rejecting_ns"]
        self._begun: Bool = self.bodies["status"]["begun"]
        self._fault_ns: Ints = self.bodies["fault"]["t_ns"]
        self._fault_row: Ints = self.bodies["fault"]["row"]
        self.thrust_scale: Float = self.bodies["estimate"]["thrust_scale"]
        """True over modelled thrust of each body (n)."""
        newest = self.bodies["innovations"]
        self._newest = tuple(
            newest[name]
            for name in ("t_ns", "observation", "innovation", "innovation_variance", "test_ratio", "rejected")
        )
        self._predicted = blank(Estimate, n)
        self._predicted_pos, self._predicted_vel = self._predicted["pos_lab_m"], self._predicted["vel_lab_m_s"]
        known = airframe or Airframe(np.zeros(3), 0, 0.0)
        for i in range(n):
            body = self.bodies[i]
            body.estimate.q_lab_from_flu[:] = IDENTITY
            body.estimate.thrust_scale = 1.0
            body.estimate.thrust_m_s2 = np.nan
            # Before they are learned: 1 mm, 2 mrad, 2 mrad, 0.5 m/s^2; an inertial sample's 0.3 m/s^2 and 0.02 rad/s.
            body.noise.source[:] = (1e-6, 4e-6, 4e-6, 0.25)
            body.noise.force_m2_s4[:] = 0.3**2
            body.noise.rate_rad2_s2[:] = 0.02**2
            body.airframe.drag_flu_1_s[:] = known.drag_flu_1_s
            body.airframe.thrust_dead_time_ns = known.thrust_dead_time_ns
            body.airframe.thrust_lag_s = known.thrust_lag_s
            body.noise.last_force_flu_m_s2[:] = np.nan
            body.fault.row = -1

    def receive_imu(self, which: Ints, t_ns: Ints, force_flu_m_s2: Float, rate_flu_rad_s: Float) -> bool:
        """HIGHRES_IMU of bodies `which` (k): means until t_ns (k) of specific force and body rate (k, 3).

        This and every other observation: whether it shows a fault, which `new_faults` has.
        """
        receive.receive_imu(self.bodies, self.rejected, which, t_ns, force_flu_m_s2, rate_flu_rad_s)
        return receive.advance_bodies(self.bodies, self._bank, which)

    def receive_attitude(self, which: Ints, t_ns: Ints, q_lab_from_flu: Float, rate_flu_rad_s: Float) -> bool:
        """ATTITUDE_QUATERNION (k, 4) and its rates (k, 3); with the thrust it stands in for an absent HIGHRES_IMU."""
        receive.receive_attitude(self.bodies, self.rejected, which, t_ns, q_lab_from_flu, rate_flu_rad_s)
        return receive.advance_bodies(self.bodies, self._bank, which)

    def receive_pose(self, which: Ints, t_capture_ns: Ints, pos_lab_m: Float, q_lab_from_flu: Float) -> bool:
        """Mocap poses (k, 3) and (k, 4) at their capture times (k)."""
        receive.receive_pose(self.bodies, self.rejected, which, t_capture_ns, pos_lab_m, q_lab_from_flu)
        return receive.advance_bodies(self.bodies, self._bank, which)

    def receive_thrust(self, which: Ints, t_ns: Ints, thrust_m_s2: Float) -> None:
        """Thrust commanded to bodies in flight (k), over mass by the profile; NaN: on the ground, or nobody knows."""
        receive.receive_thrust(self.bodies, self.rejected, which, t_ns, thrust_m_s2)

    def reset_checks(self, i: int) -> None:
        """Body i stands on the floor: a pose may repeat, and where poses are rejected the estimate begins anew."""
        self.bodies["pending"]["last_pos_lab_m"][i] = np.nan
        if self._rejecting_ns[i]:
            self._begun[i] = False
            self._bank.order[i].count = 0

    @property
    def rejecting(self) -> Bool:
        """Whether each body's poses are rejected at present (n)."""
        rejecting: Bool = self._rejecting_ns != 0
        return rejecting

    def predicted(self, i: int, t_ns: int) -> Estimate:
        """Body i's motion at a time, its covariance at the newest pose; overwritten by the next call for it."""
        samples.predicted(self.bodies, i, t_ns, self._predicted)
        return self._predicted[i]

    def motion(self, i: int, t_ns: int) -> tuple[Vec3, Vec3] | None:
        """Body i's position and velocity in `lab` at a time; None before the first pose."""
        if not self._begun[i]:
            return None
        samples.predicted(self.bodies, i, t_ns, self._predicted)
        return self._predicted_pos[i].copy(), self._predicted_vel[i].copy()

    def innovation(self, i: int, source: int, sysid: int = 0) -> Innovation:
        """The newest of body i, which is that system's, and a source (formation.navigation.state)."""
        t_ns, observation, innovation, variance, ratio, rejected = self._newest
        return Innovation(
            int(t_ns[i, source]),
            sysid,
            SOURCES[source],
            observation[i, source].copy(),
            innovation[i, source].copy(),
            variance[i, source].copy(),
            ratio[i, source].copy(),
            bool(rejected[i, source]),
        )

    def new_faults(self) -> list[Fault]:
        """The faults detected since the last call."""
        out = []
        for i, t_ns in enumerate(self._fault_ns.tolist()):
            if self._fault_row[i] >= 0 and t_ns > self._reported[i]:
                fault = self.bodies[i].fault
                self._reported[i] = t_ns
                row, t_ns, onset_ns = self.signatures[fault.row], int(fault.t_ns), int(fault.onset_ns)
                out.append(Fault(i, row, t_ns, onset_ns, float(fault.statistic), fault.amplitude.copy()))
        return out
