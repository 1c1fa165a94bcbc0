"""Faults of the cameras' frames, and of frames on the bus: altered, late, or not there at all."""

from collections.abc import Sequence
from dataclasses import replace
from math import cos, pi, sin

import numpy as np

from formation.config import LabConfig
from formation.maths import frames
from formation.maths.arrays import Float, Quat, Vec3
from formation.messages import RawFrame
from sim.faults.fault import Family, Fault

Active = Sequence[tuple[int, Fault, int]]
"""Number, fault and onset, as `sim.faults.onsets` gives them."""
NOISE_RAD_PER_M = 10.0


class CameraFaults:
    """Alters raw frames. The same seed draws the same directions and noise."""

    def __init__(self, lab: LabConfig, seed: int) -> None:
        self._seed = seed
        self._noise = np.random.default_rng([seed, 7])
        self._q_mocap_from_lab = frames.inverse(np.array(lab.mocap.q_lab_from_mocap))
        self._q_marker_from_flu = {v.body: np.array(v.q_marker_from_flu) for v in lab.vehicles}
        self._held: dict[tuple[int, str], tuple[Vec3, Quat]] = {}

    def alter(self, frame: RawFrame, active: Active, now_ns: int) -> tuple[RawFrame, int]:
        """The frame as the faults make it, and how many ns later it arrives."""
        if not active:
            return frame, 0
        pos, q, seen = frame.pos_mocap_m.copy(), frame.q_mocap_from_marker.copy(), frame.seen.copy()
        stamp_ns, late_ns = frame.t_capture_ns, 0
        for number, fault, onset_ns in active:
            match fault.family:
                case Family.HIDDEN_LATENCY:
                    late_ns += round(fault.severity * 1e9)
                    stamp_ns += round(fault.severity * 1e9)
                case Family.STAMP_OFFSET:
                    stamp_ns += round(fault.severity * 1e9)
                case Family.SWAP:
                    self._swap(fault, frame.bodies, pos, q)
                case _:
                    for i, body in enumerate(frame.bodies):
                        if fault.hits(body):
                            self._alter_body(number, fault, body, (now_ns - onset_ns) * 1e-9, pos[i], q[i])
                            seen[i] &= fault.family is not Family.LOST_BODY
        altered = replace(frame, t_capture_ns=stamp_ns, pos_mocap_m=pos, q_mocap_from_marker=q, seen=seen)
        return altered, late_ns

    def _swap(self, fault: Fault, bodies: tuple[str, ...], pos: Float, q: Float) -> None:
        if fault.body in bodies and fault.other in bodies:
            one, other = bodies.index(fault.body), bodies.index(fault.other)
            pos[[one, other]], q[[one, other]] = pos[[other, one]], q[[other, one]]

    def _alter_body(self, number: int, fault: Fault, body: str, since_s: float, pos: Vec3, q: Quat) -> None:
        """In place."""
        match fault.family:
            case Family.FREEZE:
                pos[:], q[:] = self._held.setdefault((number, body), (pos.copy(), q.copy()))
            case Family.JUMP:
                pos += fault.severity * self._direction(number, fault)
            case Family.DRIFT:
                pos += fault.severity * since_s * self._direction(number, fault)
            case Family.ABSURD:
                pos[:] = fault.severity
            case Family.NOT_A_NUMBER:
                pos[:] = np.nan
            case Family.FLIP:
                half = 0.5 * fault.severity
                marker = self._q_marker_from_flu[body]
                turn = frames.multiply(np.array([cos(half), sin(half), 0.0, 0.0]), frames.inverse(marker))
                q[:] = frames.multiply(q, frames.multiply(marker, turn))
            case Family.YAW:
                half, lab = 0.5 * fault.severity, self._q_mocap_from_lab
                turn = frames.multiply(np.array([cos(half), 0.0, 0.0, sin(half)]), frames.inverse(lab))
                q[:] = frames.multiply(frames.multiply(lab, turn), q)
            case Family.NOISE:
                pos += fault.severity * self._noise.standard_normal(3)
                turn = NOISE_RAD_PER_M * fault.severity * self._noise.standard_normal(3)
                q[:] = frames.multiply(q, frames.from_rotation_vector(turn))

    def _direction(self, number: int, fault: Fault) -> Vec3:
        """A horizontal direction of the lab in the mocap's axes, the fault's own."""
        drawn = np.random.default_rng([self._seed, 6, number]).uniform(-pi, pi)
        angle = drawn if fault.heading_rad is None else fault.heading_rad
        return frames.rotate(self._q_mocap_from_lab, np.array([cos(angle), sin(angle), 0.0]))


class Thinning:
    """Which frames of a stream come through: none, or an even share."""

    def __init__(self) -> None:
        self._owed = 0.0

    def passes(self, faults: Sequence[Fault]) -> bool:
        """Whether the next frame does."""
        if any(fault.family is Family.LOST_STREAM for fault in faults):
            return False
        missing = max((fault.severity for fault in faults if fault.family is Family.SLOW_STREAM), default=0.0)
        self._owed += missing
        if self._owed >= 1.0:
            self._owed -= 1.0
            return False
        return True


def late_ns(faults: Sequence[Fault]) -> int:
    """How much later a frame on the bus arrives."""
    return sum(round(fault.severity * 1e9) for fault in faults if fault.family is Family.LATE_STREAM)
