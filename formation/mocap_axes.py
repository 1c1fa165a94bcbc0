"""From the mocap's axes, names and marker frames to `lab`, the configuration's order and `flu`; done once, here."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from formation import frames
from formation.arrays import Bool, Float
from formation.config import MocapConfig
from formation.kernel import kernel
from formation.messages import MocapFrame
from formation.model import QuatTuple
from formation.quaternion import multiply_into

UNIT_WITHIN = 0.1


class MarkedBody(Protocol):
    """A body as the mocap knows it: its name, and how its marker frame lies on it."""

    @property
    def body(self) -> str:
        """The mocap's name of it."""

    @property
    def q_marker_from_flu(self) -> QuatTuple:
        """The marker frame's alignment."""


class MocapAxes:
    """The one conversion of a lab. Bodies that are none of `vehicles` are left out, bodies missing are unseen.

    bad_poses counts poses that are no poses (not finite, no rotation); they count as unseen.
    """

    def __init__(self, mocap: MocapConfig, vehicles: Sequence[MarkedBody]) -> None:
        self.bad_poses = 0
        self._bodies = tuple(v.body for v in vehicles)
        self._q_lab_from_mocap = frames.canonical(np.array(mocap.q_lab_from_mocap))
        self._rotation = frames.matrix(self._q_lab_from_mocap)
        self._origin_lab_m = np.array(mocap.origin_lab_m)
        self._q_marker_from_flu = frames.canonical(np.array([v.q_marker_from_flu for v in vehicles]).reshape(-1, 4))
        self._order: tuple[tuple[str, ...], NDArray[np.int64]] | None = None

    def align(self, frame: MocapFrame) -> MocapFrame:
        """The frame of the n vehicles in lab and flu."""
        n = len(self._bodies)
        pos, q, seen = np.zeros((n, 3)), np.zeros((n, 4)), np.zeros(n, np.bool_)
        self.bad_poses += _align(
            self._places(frame.bodies), frame.pos_lab_m, frame.q_lab_from_flu, frame.seen,
            self._rotation, self._origin_lab_m, self._q_lab_from_mocap, self._q_marker_from_flu, pos, q, seen,
        )  # fmt: skip
        return MocapFrame(frame.seq, frame.t_capture_ns, self._bodies, pos, q, seen)

    def _places(self, bodies: tuple[str, ...]) -> NDArray[np.int64]:
        """Index into the frame of each vehicle, -1 where it lacks it; the frame's own order rarely changes."""
        if self._order is None or self._order[0] != bodies:
            place = {body: i for i, body in enumerate(bodies)}
            self._order = bodies, np.array([place.get(body, -1) for body in self._bodies], dtype=np.int64)
        return self._order[1]


@kernel
def _product(a: Float, b: Float, out: Float) -> None:
    """a b into out, unit, w >= 0."""
    multiply_into(a, b, out)
    norm = np.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2 + out[3] ** 2)
    out /= np.copysign(norm, out[0])


@kernel
def _align(
    places: NDArray[np.int64], pos_mocap_m: Float, q_mocap_from_marker: Float, seen_in: Bool, rotation: Float,
    origin_lab_m: Float, q_lab_from_mocap: Float, q_marker_from_flu: Float, pos: Float, q: Float, seen: Bool,
) -> int:  # fmt: skip
    """pos_lab = R pos_mocap + origin, q_lab_from_flu = q_lab_from_mocap q_mocap_from_marker q_marker_from_flu.

    Fills pos (n, 3), q (n, 4), seen (n), which come in as zeros; returns how many seen poses were none.
    """
    bad = 0
    q_lab_from_marker = np.empty(4)
    for i in range(len(places)):
        q[i, 0] = 1.0
        at = places[i]
        if at < 0:
            continue
        norm = 0.0
        for k in range(4):
            norm += q_mocap_from_marker[at, k] ** 2
        total = norm + pos_mocap_m[at, 0] + pos_mocap_m[at, 1] + pos_mocap_m[at, 2]
        if not np.isfinite(total) or abs(norm - 1.0) > UNIT_WITHIN:
            bad += seen_in[at]
            continue
        for row in range(3):
            pos[i, row] = origin_lab_m[row]
            for k in range(3):
                pos[i, row] += rotation[row, k] * pos_mocap_m[at, k]
        _product(q_lab_from_mocap, q_mocap_from_marker[at], q_lab_from_marker)
        _product(q_lab_from_marker, q_marker_from_flu[i], q[i])
        seen[i] = seen_in[at]
    return bad
