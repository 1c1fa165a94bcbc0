"""Statistics of some seconds of frames: for `gcs mocap`, its published state and the doctor. Pure."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from formation.maths import frames
from formation.maths.arrays import Bool, Float
from formation.messages import LabFrame

Times = NDArray[np.int64]
FRAMES_MAX = 512
WINDOW_NS = 2_000_000_000
BURST_SHARE = 0.01
"""Share of spacings: a clock that is set once in a window of two seconds is less."""
CAUGHT_UP, GAP = 0.5, 1.5
"""A frame that follows the one before it by less than this share of the period catches up; by more than GAP, lags."""
STILL_M = 0.01
"""A body whose positions span more than this moves: its noise at rest is not to be seen."""


@dataclass(frozen=True, slots=True)
class Timing:
    """The frames' rate and standard deviation of the exposures' spacing, share lost, delay (median), longest gap.

    arrival_stamps: the stamps are arrival times, as they come in bursts.
    """

    rate_hz: float
    jitter_s: float
    lost_share: float
    delay_s: float
    gap_s: float
    arrival_stamps: bool


@dataclass(frozen=True, slots=True)
class BodyFigures:
    """One body's share of frames it was seen in, longest time unseen, noise (None while it moves), newest pose."""

    body: str
    seen_share: float
    gap_s: float
    noise_m: float | None
    pos_lab_m: tuple[float, float, float] | None
    yaw_rad: float | None


def timing(captured_ns: Times, received_ns: Times, seq: Times) -> Timing:
    """The figures of at least two frames; exposure, receipt and number of each (k)."""
    spacing_s = np.diff(captured_ns) * 1e-9
    steps = np.maximum(np.diff(seq), 1)
    passed_s = float(spacing_s.sum())
    return Timing(
        rate_hz=float(steps.sum()) / passed_s if passed_s > 0.0 else np.inf,
        jitter_s=float(np.std(spacing_s)),
        lost_share=float(np.sum(steps - 1)) / float(np.sum(steps)),
        delay_s=float(np.median(received_ns - captured_ns)) * 1e-9,
        gap_s=float(spacing_s.max()),
        arrival_stamps=is_stamped_on_arrival(spacing_s, steps),
    )


def is_stamped_on_arrival(spacings: ArrayLike, steps: ArrayLike) -> bool:
    """Whether stamps with these spacings (k), of frames so many numbers apart, are no exposures but arrival times.

    Frames that were held back arrive in a burst: some follow a late one in less than half of the usual spacing. One
    that is early by itself is no sign, since exposures that jitter are as often early as late.
    """
    each = np.asarray(spacings)
    usual = np.median(each / np.asarray(steps))
    late, early = each > GAP * usual * np.asarray(steps), each < CAUGHT_UP * usual
    in_bursts, is_burst = 0, False
    for is_late, is_early in zip(late.tolist(), early.tolist(), strict=True):
        is_burst = is_late or (is_burst and is_early)
        in_bursts += is_burst and is_early
    return in_bursts > BURST_SHARE * len(each)


def noise_m(pos_lab_m: Float) -> float:
    """Standard deviation of a resting body's positions (k, 3), of the worst axis."""
    return float(np.std(pos_lab_m, axis=0).max())


class FrameWindow:
    """The frames of the last two seconds in a ring buffer: adding one allocates nothing."""

    def __init__(self, bodies: tuple[str, ...]) -> None:
        n = len(bodies)
        self._bodies = bodies
        self._count = 0
        self._times = np.zeros((3, FRAMES_MAX), np.int64)
        self._pos = np.zeros((FRAMES_MAX, n, 3))
        self._seen = np.zeros((FRAMES_MAX, n), np.bool_)
        self._newest: LabFrame | None = None

    def add(self, frame: LabFrame) -> None:
        """Take a frame in."""
        row = self._count % FRAMES_MAX
        self._times[:, row] = frame.t_capture_ns, frame.t_receive_ns, frame.seq
        self._pos[row], self._seen[row] = frame.pos_lab_m, frame.seen
        self._newest = frame
        self._count += 1

    def timing(self, now_ns: int) -> Timing | None:
        """None where fewer than two frames came in the last two seconds."""
        rows = self._rows(now_ns)
        return None if len(rows) < 2 else timing(*self._times[:, rows])

    def bodies(self, now_ns: int) -> tuple[BodyFigures, ...]:
        """Each of the lab's bodies."""
        rows = self._rows(now_ns)
        captured_ns, seen = self._times[0, rows], self._seen[rows]
        return tuple(
            self._body(i, captured_ns, seen[:, i], self._pos[rows, i], now_ns) for i in range(len(self._bodies))
        )

    def _rows(self, now_ns: int) -> NDArray[np.int64]:
        """Oldest first."""
        first = max(self._count - FRAMES_MAX, 0)
        rows: NDArray[np.int64] = np.arange(first, self._count) % FRAMES_MAX
        recent: NDArray[np.int64] = rows[self._times[0, rows] > now_ns - WINDOW_NS]
        return recent

    def _body(self, i: int, captured_ns: Times, seen: Bool, pos: Float, now_ns: int) -> BodyFigures:
        name = self._bodies[i]
        if self._newest is None or not seen.any():
            return BodyFigures(name, 0.0, WINDOW_NS * 1e-9, None, None, None)
        times, positions = captured_ns[seen], pos[seen]
        gaps_ns = np.diff(np.append(times, now_ns))
        rests = len(positions) > 1 and float(np.ptp(positions, axis=0).max()) <= STILL_M
        x, y, z = positions[-1].tolist()
        yaw_rad = float(frames.yaw(self._newest.q_lab_from_flu[i])) if self._newest.seen[i] else None
        return BodyFigures(
            name,
            float(seen.mean()),
            float(gaps_ns.max()) * 1e-9,
            noise_m(positions) if rests else None,
            (x, y, z),
            yaw_rad,
        )


def as_json(window: FrameWindow, now_ns: int) -> dict[str, Any]:
    """Both, as in the mocap process's published state; SI units."""
    frame_timing = window.timing(now_ns)
    return {
        "timing": None if frame_timing is None else asdict(frame_timing),
        "body_figures": [asdict(body) for body in window.bodies(now_ns)],
    }
