"""From the mocap's axes, names and marker frames to `lab`, the configuration's order and `flu`; done once, here."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from formation import frames
from formation.config import NO_ROTATION, LabConfig
from formation.messages import MocapFrame


class MocapAxes:
    """The one conversion of a lab. Bodies the configuration does not name are left out, bodies missing are unseen."""

    def __init__(self, config: LabConfig) -> None:
        self._bodies = tuple(v.body for v in config.vehicles)
        self._q_lab_from_mocap = frames.canonical(np.array(config.mocap.q_lab_from_mocap))
        self._origin_lab_m = np.array(config.mocap.origin_lab_m)
        self._q_marker_from_flu = frames.canonical(np.array([v.q_marker_from_flu for v in config.vehicles]))
        self._rotated = config.mocap.q_lab_from_mocap != NO_ROTATION or bool(self._origin_lab_m.any())
        self._order: tuple[tuple[str, ...], NDArray[np.int64]] | None = None
        self.bad_poses = 0

    def align(self, frame: MocapFrame) -> MocapFrame:
        """The frame of the n configured vehicles in lab and flu; a pose that is no pose counts as unseen."""
        if not frame.bodies:
            return self._nobody(frame)
        at = self._places(frame.bodies)
        present = at >= 0
        pos, q = frame.pos_lab_m[at], frame.q_lab_from_flu[at]
        sound = np.isfinite(pos).all(axis=-1) & (np.abs(np.einsum("ij,ij->i", q, q) - 1.0) < 0.1)
        seen = frame.seen[at] & present
        self.bad_poses += int(np.count_nonzero(seen & ~sound))
        if not (sound & present).all():
            pos = np.where((sound & present)[:, None], pos, 0.0)
            q = np.where((sound & present)[:, None], q, frames.IDENTITY)
        if self._rotated:
            pos = frames.rotate(self._q_lab_from_mocap, pos) + self._origin_lab_m
            q = frames.multiply(np.broadcast_to(self._q_lab_from_mocap, q.shape), q)
        q = frames.canonical(frames.multiply(q, self._q_marker_from_flu))
        return replace(frame, bodies=self._bodies, pos_lab_m=pos, q_lab_from_flu=q, seen=seen & sound)

    def _nobody(self, frame: MocapFrame) -> MocapFrame:
        n = len(self._bodies)
        q = np.tile(frames.IDENTITY, (n, 1))
        return replace(
            frame, bodies=self._bodies, pos_lab_m=np.zeros((n, 3)), q_lab_from_flu=q, seen=np.zeros(n, np.bool_)
        )

    def _places(self, bodies: tuple[str, ...]) -> NDArray[np.int64]:
        """Index into the frame of each vehicle, -1 where it lacks it; the frame's own order rarely changes."""
        if self._order is None or self._order[0] != bodies:
            place = {body: i for i, body in enumerate(bodies)}
            self._order = bodies, np.array([place.get(body, -1) for body in self._bodies])
        return self._order[1]
