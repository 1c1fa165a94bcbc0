"""A leader no drone carries: the pose of its body at any time after the start, and when the camera saw it.

A recording is held at its first pose until the start; the playback then eases in (a recording may begin in full
flight), after which every exposure falls on a recorded stamp, jitter included; at the end the last pose holds. In a gap
of the recording the cameras go on, and do not see the body.
"""

import numpy as np

from formation.maths import frames
from formation.maths.arrays import Quat, Vec3
from mocap.sources.csv_file import Recording

EASE_IN_NS = 1_000_000_000
GAP_NS = 50_000_000
"""A longer time without a recorded pose is one without the body."""
IN_GAP_NS = 10_000_000
"""Period of the cameras in a gap."""
RESTING_M = 0.05
"""A body that stays this near its last recorded pose has come to rest."""
REST_NS = 1_000_000_000
"""A recording that ends with a rest of this length ends with a landing; the formation is left this long before it."""


class Playback:
    """The recording against the time since its start."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self.recorded = len(recording.t_ns) > 1
        # The ease-in runs at t^2 / (2 T): it shows half of T of the recording in T.
        self._first_stamp = int(np.searchsorted(recording.t_ns, EASE_IN_NS // 2))

    @classmethod
    def standing(cls, pos_mocap_m: Vec3, q_mocap_from_marker: Quat) -> "Playback":
        """A body that never moves."""
        return cls(Recording(np.zeros(1, dtype=np.int64), pos_mocap_m[None], q_mocap_from_marker[None]))

    @property
    def duration_ns(self) -> int:
        """From the start to the last recorded pose."""
        return int(self._recording.t_ns[-1]) + EASE_IN_NS // 2

    def plays(self, elapsed_ns: int) -> bool:
        """Whether a recording shows its own poses then; before and after it, one of them is held."""
        return self.recorded and 0 <= elapsed_ns <= self.duration_ns

    @property
    def flight_ns(self) -> int:
        """From the start to shortly before the body lands: nobody should follow it onto the floor.

        The whole duration where the recording does not end at rest.
        """
        r = self._recording
        away_m = np.linalg.norm(r.pos_mocap_m - r.pos_mocap_m[-1], axis=-1)
        moving = np.flatnonzero(away_m > RESTING_M)
        landed_ns = int(r.t_ns[moving[-1]]) if len(moving) else 0
        if not REST_NS < landed_ns < r.t_ns[-1] - REST_NS:
            return self.duration_ns
        return landed_ns - REST_NS + EASE_IN_NS // 2

    def pose(self, elapsed_ns: int) -> tuple[Vec3, Quat]:
        """Pose of the body in the mocap's axes: exact on a recorded stamp, interpolated between two."""
        r, t = self._recording, self._recorded_time_ns(elapsed_ns)
        after = int(np.searchsorted(r.t_ns, t))
        if after == 0 or after == len(r.t_ns):
            held = min(after, len(r.t_ns) - 1)
            return r.pos_mocap_m[held], r.q_mocap_from_marker[held]
        before = after - 1
        part = float(t - r.t_ns[before]) / float(r.t_ns[after] - r.t_ns[before])
        if part == 1.0:
            return r.pos_mocap_m[after], r.q_mocap_from_marker[after]
        pos = (1.0 - part) * r.pos_mocap_m[before] + part * r.pos_mocap_m[after]
        q_after = r.q_mocap_from_marker[after]
        same_sign = np.copysign(1.0, np.dot(r.q_mocap_from_marker[before], q_after))
        q = frames.canonical((1.0 - part) * r.q_mocap_from_marker[before] + part * same_sign * q_after)
        return pos, q

    def next_exposure_ns(self, elapsed_ns: int) -> int | None:
        """Elapsed time of the first recorded exposure after `elapsed_ns`; None where the mocap's own rhythm applies.

        In a gap the cameras go on evenly, up to between 0.6 and 1.6 periods before it ends.
        """
        if elapsed_ns < EASE_IN_NS:
            return None
        stamps = self._recording.t_ns
        k = max(int(np.searchsorted(stamps, elapsed_ns - EASE_IN_NS // 2, side="right")), self._first_stamp)
        if k == len(stamps):
            return None
        next_ns = int(stamps[k]) + EASE_IN_NS // 2
        is_gap = k > 0 and stamps[k] - stamps[k - 1] > GAP_NS
        return elapsed_ns + IN_GAP_NS if is_gap and next_ns - elapsed_ns > 1.6 * IN_GAP_NS else next_ns

    def is_in_sight(self, elapsed_ns: int) -> bool:
        """Whether the cameras see the body: not where the recording has a gap."""
        stamps, t_ns = self._recording.t_ns, self._recorded_time_ns(elapsed_ns)
        after = int(np.searchsorted(stamps, t_ns))
        if after in (0, len(stamps)) or stamps[after] == t_ns:
            return True
        return bool(stamps[after] - stamps[after - 1] <= GAP_NS)

    @staticmethod
    def _recorded_time_ns(elapsed_ns: int) -> int:
        if elapsed_ns >= EASE_IN_NS:
            return elapsed_ns - EASE_IN_NS // 2
        return max(elapsed_ns, 0) ** 2 // (2 * EASE_IN_NS)
