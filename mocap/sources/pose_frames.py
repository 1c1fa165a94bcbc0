"""Frames from poses that come one by one, as VRPN's and ROS 2's do: their times, exposures, numbers, and a row a body.

Each tracker has a clock of its own: one that is off is found by its stamps less their arrivals, against those of the
other bodies. Poses of one stamp, or nearly, are one exposure, out as soon as the bodies of the one before have come, or
at a deadline. Lost exposures show as gaps in the stamps. Cameras have noise: a body whose pose has varied and then
stays the same to the last bit is lost.
"""

import asyncio
from collections import deque
from collections.abc import Hashable, Iterator
from dataclasses import dataclass, field
from statistics import fmean, median, median_low

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Bool, Float
from formation.messages import RawFrame, Severity
from mocap.capture_time import CaptureTime
from mocap.sources.poses import from_quaternions
from mocap.sources.source import Feed
from wire.clock import Clock

STRAY_NS = 1_000_000_000
"""A tracker's clock that is farther from the others' is off."""
JUDGED, REPEATED_SHARE = 64, 0.15
"""Stamps are judged by so many poses of one body; they step coarsely where this share repeats the one before."""


@dataclass(slots=True)
class _Track:
    """One body's newest stamp and pose, what its clock is ahead of arrivals and of the others', its last steps, ns."""

    stamp_ns: int = 0
    pose: bytes = b""
    ahead_ns: int = 0
    off_ns: int = 0
    steps_ns: deque[int] = field(default_factory=lambda: deque(maxlen=JUDGED))


class Stamps:
    """The stamps of one connection. coarse_ns: the step of stamps that are not used; 0 where they are."""

    def __init__(self) -> None:
        self.coarse_ns = 0
        self._tracks: dict[int, _Track] = {}
        self._base_ns = 0

    def time_ns(self, row: int, stamp_ns: int, pose: bytes, now_ns: int) -> int:
        """The time of a pose that came now; stamp_ns: 0 for none."""
        if self.coarse_ns or not stamp_ns:
            return now_ns
        track = self._tracks.setdefault(row, _Track())
        if self._is_coarse(track, stamp_ns, pose):
            return now_ns
        track.ahead_ns = stamp_ns - now_ns
        if abs(track.ahead_ns - track.off_ns - self._base_ns) > STRAY_NS:
            self._compare()
        return stamp_ns - track.off_ns

    def off_s(self) -> Iterator[tuple[int, float]]:
        """The rows whose clocks are off, and by how much."""
        return ((row, track.off_ns * 1e-9) for row, track in self._tracks.items() if track.off_ns)

    def _compare(self) -> None:
        """The clock of most bodies is the one to go by."""
        self._base_ns = median_low(track.ahead_ns for track in self._tracks.values())
        for track in self._tracks.values():
            off_ns = track.ahead_ns - self._base_ns
            track.off_ns = off_ns if abs(off_ns) > STRAY_NS else 0

    def _is_coarse(self, track: _Track, stamp_ns: int, pose: bytes) -> bool:
        """Whether the stamps of this body step more coarsely than its poses come."""
        if pose == track.pose:
            return False
        steps, before_ns = track.steps_ns, track.stamp_ns
        track.stamp_ns, track.pose = stamp_ns, pose
        if before_ns:
            steps.append(stamp_ns - before_ns)
        if len(steps) == JUDGED and steps.count(0) > REPEATED_SHARE * JUDGED:
            self.coarse_ns = round(median([step for step in steps if step > 0] or [STRAY_NS]))
        return self.coarse_ns > 0


OUT_OF_ORDER_NS = 100_000_000
"""A stamp so much before the newest is late; one still earlier is that of a clock which was set."""


@dataclass(slots=True)
class Exposure:
    """Poses of one time: the stamp of the first that came, when it came, and each body's 56 bytes by its row."""

    stamp_ns: int
    arrived_ns: int
    poses: dict[int, bytes] = field(default_factory=dict)


class Assembly:
    """longest_ns: how long an exposure waits for its last pose, and how far apart its stamps may be."""

    def __init__(self, longest_ns: int) -> None:
        self.late = 0
        """Poses of an exposure that was out already."""
        self._longest_ns = self._window_ns = longest_ns
        self._open: Exposure | None = None
        self._last: Exposure | None = None
        self._newest: dict[int, tuple[int, bytes]] = {}
        self._ready: list[Exposure] = []

    @property
    def due_ns(self) -> int | None:
        """When `take` is to be called at the latest; None while nothing waits."""
        return None if self._open is None else self._open.arrived_ns + self._longest_ns

    def set_period(self, period_ns: float) -> None:
        """How far exposures are apart: stamps of one are nearer to each other than to those of the next."""
        self._window_ns = min(self._longest_ns, round(0.4 * period_ns))

    def add(self, row: int, stamp_ns: int, pose: bytes, now_ns: int) -> None:
        """One body's pose has come."""
        if self._newest.get(row) == (stamp_ns, pose):
            return
        self._newest[row] = stamp_ns, pose
        current = self._open
        if current is not None:
            if abs(stamp_ns - current.stamp_ns) <= self._window_ns:
                had = current.poses.setdefault(row, pose)
                if had == pose:
                    return
            elif self._is_of_last(row, stamp_ns, pose) or self._is_late(stamp_ns, current):
                return
            self._close()
        elif self._is_of_last(row, stamp_ns, pose) or self._is_late(stamp_ns, self._last):
            return
        self._open = Exposure(stamp_ns, now_ns, {row: pose})

    def pop_ready(self, now_ns: int) -> list[Exposure]:
        """Exposures that are whole, or have waited long enough; to be called when all that came was added."""
        due_ns = self.due_ns
        if due_ns is not None and (now_ns >= due_ns or self._is_whole()):
            self._close()
        ready, self._ready = self._ready, []
        return ready

    def _is_of_last(self, row: int, stamp_ns: int, pose: bytes) -> bool:
        """Whether it belongs to the exposure that is out: a second copy, or one too late (which is counted)."""
        last = self._last
        if last is None or abs(stamp_ns - last.stamp_ns) > self._window_ns:
            return False
        if row not in last.poses:
            last.poses[row] = pose
            self.late += 1
            return True
        return last.poses[row] == pose

    def _is_late(self, stamp_ns: int, newest: Exposure | None) -> bool:
        if newest is None or not self._window_ns < newest.stamp_ns - stamp_ns <= OUT_OF_ORDER_NS:
            return False
        self.late += 1
        return True

    def _is_whole(self) -> bool:
        return self._open is not None and self._last is not None and self._open.poses.keys() >= self._last.poses.keys()

    def _close(self) -> None:
        if self._open is not None:
            self._ready.append(self._open)
            self._last, self._open = self._open, None


ENOUGH = 16
LONGEST_GAP_NS = 1_000_000_000
"""Nothing for longer than this is no loss of frames: nobody was in sight, or the server paused."""


class Pacing:
    """One source's, over all its connections. period_ns: as configured, until it is measured by the stamps."""

    def __init__(self, period_ns: float) -> None:
        self.period_ns = period_ns
        self.lost = 0
        """Exposures that a gap in the stamps shows, less those that were merely stamped late."""
        self._seq = -1
        self._stamp_ns: int | None = None
        self._steps: deque[int] = deque(maxlen=64)
        self._late_ns = 0.0
        """How much later the last stamp was than an even rhythm has it."""
        self._learnt = 0
        self._doubtful = 0

    def restart(self) -> None:
        """A new connection: its stamps are not compared with those before."""
        self._stamp_ns = None
        self._late_ns = 0.0
        self._doubtful = 0

    def number(self, stamp_ns: int) -> int:
        """The next exposure's number: one more, and one more for each that is missing before it."""
        missing, last_ns = 0, self._stamp_ns
        self._stamp_ns = stamp_ns
        if last_ns is not None and 0 <= stamp_ns - last_ns <= LONGEST_GAP_NS:
            missing = self._missing(stamp_ns - last_ns)
        self._seq += 1 + missing
        return self._seq

    def _missing(self, step_ns: int) -> int:
        if len(self._steps) < ENOUGH:
            self._learn(step_ns)
            return 0
        since_ns, period_ns = self._late_ns + step_ns, self.period_ns
        steps = round(since_ns / period_ns)
        if self._doubtful and steps < 1:  # it was not lost, but stamped late
            self._doubtful -= 1
            self.lost -= 1
            return 0
        missing = max(steps - 1, 0)
        if missing:
            self._doubtful = missing
        self.lost += missing
        # The even rhythm is moved towards each stamp by a tenth.
        self._late_ns = 0.9 * max(since_ns - (1 + missing) * period_ns, -0.5 * period_ns)
        self._learn(step_ns)
        return missing

    def _learn(self, step_ns: int) -> None:
        """The mean of the steps that are one period long: most of them."""
        self._steps.append(step_ns)
        self._learnt += 1
        if self._learnt % ENOUGH == 0:
            middle_ns = median(self._steps)
            near = [step for step in self._steps if abs(step - middle_ns) <= 0.5 * middle_ns]
            self.period_ns = max(fmean(near or self._steps), 1.0)


REVERSALS = 5
"""So many steps in a row against the one before: no smooth motion has them, noise has them within 0.3 s at 100 Hz."""


class Repeats:
    """Repeated poses of all bodies of one source, by row."""

    def __init__(self) -> None:
        self._pos = np.full((0, 3), np.nan)
        self._step = np.zeros((0, 3))
        self._reversals = np.zeros(0, np.int64)
        self._noisy = np.zeros(0, np.bool_)

    def lost(self, rows: NDArray[np.intp], poses: Float, same: Bool) -> Bool:
        """Which of the poses (k, 7) of `rows` (k,) show a lost body; same: those that are the last ones, bit by bit."""
        self._grow(int(rows.max(initial=-1)) + 1)
        noisy = self._noisy[rows]
        if noisy.all():
            return same
        with np.errstate(all="ignore"):  # any numbers at all come
            step = poses[:, :3] - self._pos[rows]
            back = (step * self._step[rows]).sum(axis=1) < 0.0
        moved = rows[~same]
        self._reversals[moved] = np.where(back, self._reversals[rows] + 1, 0)[~same]
        self._pos[moved], self._step[moved] = poses[~same, :3], step[~same]
        self._noisy[moved] |= self._reversals[moved] >= REVERSALS
        lost: Bool = same & noisy
        return lost

    def _grow(self, n: int) -> None:
        more = n - len(self._pos)
        if more > 0:
            self._pos = np.vstack((self._pos, np.full((more, 3), np.nan)))
            self._step = np.vstack((self._step, np.zeros((more, 3))))
            self._reversals = np.append(self._reversals, np.zeros(more, np.int64))
            self._noisy = np.append(self._noisy, np.zeros(more, np.bool_))


MOST_BODIES = 256
NOWHERE = np.eye(1, 7, 6)
"""x y z, quaternion x y z w."""


class Rows:
    """repeats_are_lost: whether a pose that repeats to the last bit, of a body with noise, shows a lost one."""

    def __init__(self, repeats_are_lost: bool) -> None:
        self.names: tuple[str, ...] = ()
        self._by_key: dict[Hashable, int | None] = {}
        self._poses = np.zeros((0, 7))
        self._raw: list[bytes] = []
        self._repeats = Repeats() if repeats_are_lost else None

    def find(self, key: Hashable) -> tuple[bool, int | None]:
        """Whether what the source calls so is known, and its row; None where it is no body."""
        known = self._by_key.get(key, -1)
        return known != -1, known

    @property
    def is_full(self) -> bool:
        """Whether no more are remembered."""
        return len(self._by_key) >= MOST_BODIES

    def add(self, key: Hashable, name: str | None) -> int | None:
        """Its row from now on; None where it is no body (`name` None)."""
        row = None if name is None else len(self.names)
        self._by_key[key] = row
        if name is not None:
            self.names = (*self.names, name)
            self._poses = np.vstack((self._poses, NOWHERE))
            self._raw.append(b"")
        return row

    def fill(self, exposure: Exposure) -> tuple[Float, Bool]:
        """The frame: poses as they came (n, 7), seen (n,). Who did not come keeps its last pose."""
        poses = exposure.poses
        rows = np.fromiter(poses, np.intp, len(poses))
        values = np.frombuffer(b"".join(poses.values()), ">f8").reshape(-1, 7).astype(np.float64)
        seen = np.zeros(len(self.names), np.bool_)
        seen[rows] = True
        if self._repeats is not None:
            same = np.array([self._raw[row] == pose for row, pose in poses.items()], np.bool_)
            seen[rows] = ~self._repeats.lost(rows, values, same)
        for row, pose in poses.items():
            self._raw[row] = pose
        self._poses[rows] = values
        return self._poses, seen


@dataclass(frozen=True, slots=True)
class Assembling:
    """How one source's poses become frames, over all its connections.

    assemble_ns: how long an exposure waits for its last pose. latency_ns: the constant part of the delay.
    """

    feed: Feed
    pacing: Pacing
    assemble_ns: int
    latency_ns: int
    repeats_are_lost: bool


class PoseFrames:
    """One connection's frames, delivered to the feed as soon as they are whole, or have waited long enough."""

    def __init__(self, how: Assembling) -> None:
        self.latency_ns: int | None = None
        """From the exposure of the newest frame to its first pose's receipt."""
        self._how = how
        self._time = CaptureTime(how.latency_ns)
        self.begin()
        how.pacing.restart()

    def begin(self) -> None:
        """Know no bodies any more."""
        self.rows = Rows(self._how.repeats_are_lost)
        self._assembly = Assembly(self._how.assemble_ns)
        self._stamps = Stamps()

    @property
    def due_ns(self) -> int | None:
        """When `deliver` is to be called at the latest."""
        return self._assembly.due_ns

    def uncertainty_ns(self, now_ns: int) -> int | None:
        """Of the capture times, apart from the constant."""
        return self._time.uncertainty_ns(now_ns)

    def clocks_off(self) -> Iterator[tuple[str, float]]:
        """Bodies whose stamps are of another clock than the others', and how far that one is off, s."""
        return ((self.rows.names[row], off_s) for row, off_s in self._stamps.off_s())

    def receive(self, row: int, stamp_ns: int, pose: bytes, now_ns: int) -> None:
        """One body's pose: seven doubles in big-endian byte order, x y z, quaternion x y z w. stamp_ns: 0 for none."""
        was_coarse = self._stamps.coarse_ns
        stamp_ns = self._stamps.time_ns(row, stamp_ns, pose, now_ns)
        if self._stamps.coarse_ns and not was_coarse:
            self._go_by_arrivals()
        self._assembly.add(row, stamp_ns, pose, now_ns)

    def deliver(self, now_ns: int) -> None:
        """Deliver what is whole, or has waited long enough; to be called when all that came was received."""
        late = self._assembly.late
        for exposure in self._assembly.pop_ready(now_ns):
            self._deliver_one(exposure)
        if late:
            self._assembly.late = 0
            self._how.feed.reject("pose later than the rest of its exposure", late)

    def _go_by_arrivals(self) -> None:
        """The stamps are of no use from here on."""
        how, step_ms = self._how, self._stamps.coarse_ns * 1e-6
        self._time, self._assembly = CaptureTime(how.latency_ns), Assembly(how.assemble_ns)
        how.pacing.restart()
        text = f"the server's stamps step by {step_ms:.0f} ms, poses come more often: arrival times are used, re-timed"
        how.feed.report(Severity.WARNING, text)

    def _deliver_one(self, exposure: Exposure) -> None:
        pacing, feed = self._how.pacing, self._how.feed
        seq = pacing.number(exposure.stamp_ns)
        self._assembly.set_period(pacing.period_ns)
        t_capture_ns = self._time.capture_ns(exposure.stamp_ns, exposure.arrived_ns)
        self.latency_ns = exposure.arrived_ns - t_capture_ns
        rows, seen = self.rows.fill(exposure)
        placed = from_quaternions(rows, feed.unit_m)
        feed.deliver(RawFrame(seq, t_capture_ns, self.rows.names, *placed, seen))


class Expiry:
    """Wakes frames that have waited long enough; of the event loop."""

    def __init__(self, frames: PoseFrames, clock: Clock) -> None:
        self._frames, self._clock = frames, clock
        self._timer: asyncio.TimerHandle | None = None

    def set(self) -> None:
        """To be called when poses were received."""
        due_ns = self._frames.due_ns
        if due_ns is not None and self._timer is None:
            delay_s = self._clock.seconds_until(due_ns)
            self._timer = asyncio.get_running_loop().call_later(delay_s, self._expire)

    def cancel(self) -> None:
        """No frame comes of it any more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _expire(self) -> None:
        self._timer = None
        self._frames.deliver(self._clock.monotonic_ns())
        self.set()
