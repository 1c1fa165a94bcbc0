"""The newest push of a drone beside its bound (formation.estimation.push), found by the page's process: it hears the
cameras' frames itself, and the ground computes nothing for it. Pure.

Once a second the drone that was farthest off is judged, over the last seconds; so a push is known about two seconds
after it began.
"""

from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np

from formation.config import LabConfig
from formation.estimation.push import CALM_S, SETTLED_M, Flown, Push, pushes
from formation.maths.arrays import Float
from formation.messages import LabFrame

WINDOW_NS, EVERY_NS = round(4.0e9 * CALM_S), round(1.0e9 * CALM_S)


class PushFinder:
    """Frames and errors of the last seconds, and what was found in them."""

    def __init__(self, config: LabConfig) -> None:
        self.found: list[tuple[str, Push]] = []
        """Whose, and how each was met; the newest last."""
        self._config, self._bodies = config, tuple(vehicle.body for vehicle in config.vehicles)
        self._frames: deque[LabFrame] = deque()
        self._errors: deque[tuple[int, Mapping[str, Float]]] = deque()
        self._searched_ns = 0
        self._over_ns: dict[str, int] = {}
        """Until when the pushes of each are known."""

    @property
    def text(self) -> str:
        """The newest push, and the mean of all of that body, since noise hides when one began; empty for none."""
        if not self.found:
            return ""
        body, newest = self.found[-1]
        every = [(push.by_attitude_m, push.flown_m) for whose, push in self.found if whose == body]
        possible_mm, flown_mm = 1e3 * np.mean(every, axis=0)
        mean = f"; mean of {len(every)}: {possible_mm:.0f} and {flown_mm:.0f} mm" if len(every) > 1 else ""
        return f"{body}: {newest.text}{mean}"

    def receive_frame(self, frame: LabFrame) -> None:
        """Receive what the cameras saw; a frame that is older than the last, or of other bodies, is left out."""
        newer = not self._frames or frame.t_capture_ns > self._frames[-1].t_capture_ns
        if newer and frame.bodies == self._bodies:
            self._frames.append(frame)
            while self._frames[0].t_capture_ns < frame.t_capture_ns - WINDOW_NS:
                self._frames.popleft()

    def receive_errors(self, errors_lab_m: Mapping[str, Float], now_ns: int) -> None:
        """Receive how far each body in formation is from its reference, now, and search for a push when it is time."""
        self._errors.append((now_ns, errors_lab_m))
        while self._errors[0][0] < now_ns - WINDOW_NS:
            self._errors.popleft()
        if now_ns - self._searched_ns > EVERY_NS:
            self._searched_ns = now_ns
            off_m = {body: max(self._off_m(body)) for body in errors_lab_m}
            if off_m and max(off_m.values()) > SETTLED_M:
                self._search(max(off_m, key=off_m.__getitem__))

    def _off_m(self, body: str) -> Sequence[float]:
        return [float(np.linalg.norm(errors[body][:2])) for _, errors in self._errors if body in errors]

    def _search(self, body: str) -> None:
        index = self._bodies.index(body)
        known = [(t_ns, errors[body]) for t_ns, errors in self._errors if body in errors]
        frames = [
            frame for frame in self._frames if frame.seen[index] and known[0][0] <= frame.t_capture_ns <= known[-1][0]
        ]
        if not frames:
            return
        began_ns = frames[0].t_capture_ns
        t_s = np.array([frame.t_capture_ns - began_ns for frame in frames]) * 1e-9
        pos = np.array([frame.pos_lab_m[index] for frame in frames])
        q = np.array([frame.q_lab_from_flu[index] for frame in frames])
        # Errors come ten times a second; between them, the frames show how the drone moved.
        at_s = np.array([t_ns - began_ns for t_ns, _ in known]) * 1e-9
        error = np.stack(
            [
                one + np.interp(t_s, at_s, errors - np.interp(at_s, t_s, one))
                for one, errors in zip(pos.T, np.array([error for _, error in known]).T, strict=True)
            ],
            axis=1,
        )
        delay_s = float(np.median([frame.t_receive_ns - frame.t_capture_ns for frame in frames])) * 1e-9
        profile = self._config.profile_of(self._config.vehicles[index])
        found = pushes(Flown(t_s, pos, q, error), profile, max(delay_s, 0.0), self._config.limits.tilt_rad)
        for push in found:
            if began_ns + round(push.begin_s * 1e9) > self._over_ns.get(body, 0):
                self._over_ns[body] = began_ns + round(push.end_s * 1e9)
                self.found.append((body, push))
