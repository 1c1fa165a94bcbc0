"""From the source's axes, names and marker frames to `lab`, `flu` and the configuration's order; done once, here."""

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from formation.config import LabConfig
from formation.maths import frames
from formation.maths.arrays import Bool, Float
from formation.maths.kernel import kernel
from formation.maths.quaternion import multiply_into
from formation.messages import LabFrame, RawFrame
from wire.transport.frame_check import FARTHEST_M, UNIT_WITHIN

Indices = NDArray[np.int64]


class Fault(IntEnum):
    """What is wrong with one body's pose."""

    NONE = 0
    NOT_FINITE = 1
    NO_ROTATION = 2
    TOO_FAR = 3

    @property
    def text(self) -> str:
        """In words."""
        return _WORDS[self]


_WORDS = {
    Fault.NONE: "",
    Fault.NOT_FINITE: "not finite",
    Fault.NO_ROTATION: "no unit quaternion",
    Fault.TOO_FAR: f"more than {FARTHEST_M:g} m away (millimetres?)",
}


class Alignment:
    """The one conversion of a lab. Bodies that are none of its vehicles are left out, bodies missing are unseen."""

    def __init__(self, config: LabConfig) -> None:
        self.bodies = tuple(v.body for v in config.vehicles)
        self._q_lab_from_mocap = frames.canonical(np.array(config.mocap.q_lab_from_mocap))
        self._rotation = frames.matrix(self._q_lab_from_mocap)
        self._origin_lab_m = np.array(config.mocap.origin_lab_m)
        self._q_marker_from_flu = frames.canonical(np.array([v.q_marker_from_flu for v in config.vehicles]))
        self._order: tuple[tuple[str, ...], Indices] | None = None

    def align(self, raw: RawFrame, seq: int, t_capture_ns: int, t_receive_ns: int) -> tuple[LabFrame, Indices]:
        """The frame in `lab`, and each vehicle's Fault (n); a body with one counts as unseen."""
        n = len(self.bodies)
        pos, q, seen, faults = np.zeros((n, 3)), np.zeros((n, 4)), np.zeros(n, np.bool_), np.zeros(n, np.int64)
        _align(
            self._places(raw.bodies), raw.pos_mocap_m, raw.q_mocap_from_marker, raw.seen,
            self._rotation, self._origin_lab_m, self._q_lab_from_mocap, self._q_marker_from_flu, pos, q, seen, faults,
        )  # fmt: skip
        return LabFrame(seq, t_capture_ns, self.bodies, pos, q, seen, t_receive_ns), faults

    def _places(self, bodies: tuple[str, ...]) -> Indices:
        """Index into the frame of each vehicle, -1 where it lacks it; the frame's own order rarely changes."""
        if self._order is None or self._order[0] != bodies:
            place = {body: i for i, body in enumerate(bodies)}
            self._order = bodies, np.array([place.get(body, -1) for body in self.bodies], dtype=np.int64)
        return self._order[1]


@kernel
def _product(a: Float, b: Float, out: Float) -> None:
    """a b into out, unit, w >= 0."""
    multiply_into(a, b, out)
    norm = np.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2 + out[3] ** 2)
    out /= np.copysign(norm, out[0])


@kernel
def _align(
    places: Indices, pos_mocap_m: Float, q_mocap_from_marker: Float, seen_in: Bool, rotation: Float,
    origin_lab_m: Float, q_lab_from_mocap: Float, q_marker_from_flu: Float, pos: Float, q: Float, seen: Bool,
    faults: Indices,
) -> None:  # fmt: skip
    """pos_lab = R pos_mocap + origin, q_lab_from_flu = q_lab_from_mocap q_mocap_from_marker q_marker_from_flu.

    Fills pos (n, 3), q (n, 4), seen (n) and faults (n), which come in as zeros.
    """
    q_lab_from_marker = np.empty(4)
    for i in range(len(places)):
        q[i, 0] = 1.0
        at = places[i]
        if at < 0 or not seen_in[at]:
            continue
        norm, far2 = 0.0, 0.0
        for k in range(4):
            norm += q_mocap_from_marker[at, k] ** 2
        for row in range(3):
            far2 += pos_mocap_m[at, row] ** 2
        if np.isnan(norm + far2):
            faults[i] = 1
        elif abs(norm - 1.0) > UNIT_WITHIN:
            faults[i] = 2
        elif far2 > FARTHEST_M**2:
            faults[i] = 3
        else:
            for row in range(3):
                pos[i, row] = origin_lab_m[row]
                for k in range(3):
                    pos[i, row] += rotation[row, k] * pos_mocap_m[at, k]
            _product(q_lab_from_mocap, q_mocap_from_marker[at], q_lab_from_marker)
            _product(q_lab_from_marker, q_marker_from_flu[i], q[i])
            seen[i] = True
