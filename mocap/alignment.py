"""From the source's axes, names and marker frames to `lab`, `flu` and the configuration's order; done once, here."""

from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from formation.config import LabConfig
from formation.maths import frames
from formation.maths.arrays import Bool, Float
from formation.maths.kernel import kernel
from formation.maths.quaternion import multiply_into
from formation.messages import FARTHEST_M, LabFrame, RawFrame, Rejection
from wire.transport.frame_check import UNIT_WITHIN

Indices = NDArray[np.int64]
NOT_FINITE, NO_ROTATION, TOO_FAR = int(Rejection.NOT_FINITE), int(Rejection.NO_ROTATION), int(Rejection.TOO_FAR)


class Mounting(NamedTuple):
    """How the mocap lies in the lab, and the markers on the bodies: rotation (3, 3), origin (3), (4) and (n, 4)."""

    r_lab_from_mocap: Float
    origin_lab_m: Float
    q_lab_from_mocap: Float
    q_marker_from_flu: Float


class AlignedFrame(NamedTuple):
    """The output of `_align`: pos (n, 3), q (n, 4), seen (n) and each body's Rejection (n), which come in as zeros."""

    pos_lab_m: Float
    q_lab_from_flu: Float
    seen: Bool
    rejected: NDArray[np.uint8]


class Alignment:
    """The one conversion of a lab. Bodies that are none of its vehicles are left out, bodies missing are unseen."""

    def __init__(self, config: LabConfig) -> None:
        self.bodies = tuple(v.body for v in config.vehicles)
        q_lab_from_mocap = frames.canonical(np.array(config.mocap.q_lab_from_mocap))
        self._mounting = Mounting(
            frames.matrix(q_lab_from_mocap),
            np.array(config.mocap.origin_lab_m),
            q_lab_from_mocap,
            frames.canonical(np.array([v.q_marker_from_flu for v in config.vehicles])),
        )
        self._order: tuple[tuple[str, ...], Indices] | None = None

    def align(self, raw: RawFrame, seq: int, t_capture_ns: int, t_receive_ns: int) -> LabFrame:
        """The frame in `lab`; a body with an invalid pose counts as unseen, and is rejected.

        One that is named twice is unseen.
        """
        n = len(self.bodies)
        out = AlignedFrame(np.zeros((n, 3)), np.zeros((n, 4)), np.zeros(n, np.bool_), np.zeros(n, np.uint8))
        indices = self._indices(raw.bodies)
        _align(indices, raw.pos_mocap_m, raw.q_mocap_from_marker, raw.seen, self._mounting, out)
        return LabFrame(
            seq, t_capture_ns, self.bodies, out.pos_lab_m, out.q_lab_from_flu, out.seen, t_receive_ns, out.rejected
        )

    def _indices(self, bodies: tuple[str, ...]) -> Indices:
        """Index into the frame of each vehicle, -1 where it lacks it; the frame's own order rarely changes."""
        if self._order is None or self._order[0] != bodies:
            count = Counter(bodies)  # a body that is named twice has no one pose
            index_of = {body: i for i, body in enumerate(bodies) if count[body] == 1}
            self._order = bodies, np.array([index_of.get(body, -1) for body in self.bodies], dtype=np.int64)
        return self._order[1]


@kernel
def _product(a: Float, b: Float, out: Float) -> None:
    """a b into out, unit, w >= 0."""
    multiply_into(a, b, out)
    norm = np.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2 + out[3] ** 2)
    out /= np.copysign(norm, out[0])


@kernel
def _align(
    indices: Indices, pos_mocap_m: Float, q_mocap_from_marker: Float, seen: Bool, mounting: Mounting, out: AlignedFrame
) -> None:
    """pos_lab = R pos_mocap + origin, q_lab_from_flu = q_lab_from_mocap q_mocap_from_marker q_marker_from_flu."""
    q_lab_from_marker = np.empty(4)
    for i in range(len(indices)):
        out.q_lab_from_flu[i, 0] = 1.0
        at = indices[i]
        if at < 0 or not seen[at]:
            continue
        norm, far2 = 0.0, 0.0
        for k in range(4):
            norm += q_mocap_from_marker[at, k] ** 2
        for row in range(3):
            far2 += pos_mocap_m[at, row] ** 2
        if np.isnan(norm + far2):
            out.rejected[i] = NOT_FINITE
        elif abs(norm - 1.0) > UNIT_WITHIN:
            out.rejected[i] = NO_ROTATION
        elif far2 > FARTHEST_M**2:
            out.rejected[i] = TOO_FAR
        else:
            for row in range(3):
                out.pos_lab_m[i, row] = mounting.origin_lab_m[row]
                for k in range(3):
                    out.pos_lab_m[i, row] += mounting.r_lab_from_mocap[row, k] * pos_mocap_m[at, k]
            _product(mounting.q_lab_from_mocap, q_mocap_from_marker[at], q_lab_from_marker)
            _product(q_lab_from_marker, mounting.q_marker_from_flu[i], out.q_lab_from_flu[i])
            out.seen[i] = True
