"""The pose validator of a lab: rejects impossible poses, body by body. A rejected pose is unseen and has a reason.

Capture times are held against arrivals, every pose against what its body can do; the checks of one frame are compiled.
The checks have names, which the manual's table shows, and can be switched off; rejections are reported when they begin
and when they end.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from formation.config import LabConfig
from formation.maths import frames
from formation.maths.arrays import Bool, Float, Quat, Vec3
from formation.maths.kernel import kernel
from formation.maths.quaternion import multiply_into, thrust_axis
from formation.maths.records import Rows, blank, rows
from formation.messages import FROZEN_FRAMES, Event, LabFrame, Rejection, Severity
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.path import (
    SECONDS,
    Bounds,
    Path,
    begin,
    copy_into,
    extend,
    is_in_sight,
    moved_as_it_can,
    position_innovation_m,
    reject_reason,
    since_s,
    turned_as_it_can,
)
from formation.vehicle.profile import VehicleProfile
from wire.clock_offset import LeastDelay
from wire.transport.frame_check import AHEAD_NS

FREEZE, JUMP, FLIP = int(Rejection.FREEZE), int(Rejection.JUMP), int(Rejection.FLIP)
SWAP = int(Rejection.SWAP)

NOISY_FRAMES, STILL_M = 20, 0.01
"""A body whose pose differs in that many frames, within so little, is one whose cameras have noise."""
RECOVERY_FRAMES = 3
KNOWN_FRAMES = 5
"""A path of fewer frames says nothing against another one."""
RELEARN_FRAMES = 50
LEAP_M, LEAP_RAD = 0.01, 0.025
"""A frame so far off the path that it would go on has left it."""
SWAP_S, GAP_S = 0.1, 0.5
"""So short a time ago only one place was a body's own; after a longer gap, until then, the nearer one is."""
NEARER = 0.5
UPSET_FRAMES, UPSET_M_S2, UPSET_LAG_S = 5, 3.0, 0.05
OFF_FLOOR_M = 0.1


@dataclass(slots=True)
class Memory:
    """The memory of one body; a record.

    believed: the path that was believed last; other: a path that does not follow from it, or not surely; possible:
    whether the body can have come to where that began. code: why it is rejected now.
    shown_*, same: the pose last shown, and how many times in a row it was the same to the last bit. still_m, varied,
    noisy: whether a standing body's pose varies, as that of every real camera does.
    slow_vel_lab_m_s: the velocity some time ago; upset: frames whose attitude is inconsistent with the acceleration.
    floor_m: height at which it last stood with its motors off, 0 until that is known.
    """

    believed: Path
    other: Path
    possible: bool
    code: int
    under: int
    shown_pos_m: Vec3
    shown_q: Quat
    same: int
    still_m: Vec3
    varied: int
    noisy: bool
    slow_vel_lab_m_s: Vec3
    upset: int
    floor_m: float


class Frame(NamedTuple):
    """A frame that is judged: capture time, poses and flags (n), which come back believed, and each body's code (n)."""

    t_ns: int
    pos_lab_m: Float
    q_lab_from_flu: Float
    seen: Bool
    rejected: NDArray[np.uint8]


class Criteria(NamedTuple):
    """The criteria: the bodies' bounds and marker frames, which have motors on (n), and what is checked.

    armed_known (n): whether a ground has reported it; until then it is not known to stand on the floor.
    watched (codes): whether a reason counts; a pose against which only an unwatched one speaks is believed.
    """

    bounds: Rows[Bounds]
    q_marker_from_flu: Float
    armed: Bool
    armed_known: Bool
    watched: Bool


@kernel
def judge(frame: Frame, criteria: Criteria, memory: Rows[Memory]) -> int:
    """Judge one frame: rejected poses become unseen. Return the number of identity swaps that were corrected."""
    n = len(frame.seen)
    reasons = np.zeros(n, np.int64)
    for i in range(n):
        if frame.seen[i]:
            watch_bits(memory[i], frame.pos_lab_m[i], frame.q_lab_from_flu[i], criteria.armed[i])
            path, bounds = memory[i].believed, criteria.bounds[i]
            reasons[i] = reject_reason(path, bounds, frame.t_ns, frame.pos_lab_m[i], frame.q_lab_from_flu[i])
    swaps = undo_swaps(frame, criteria, memory, reasons)
    for i in range(n):
        if frame.seen[i]:
            m, pos, q = memory[i], frame.pos_lab_m[i], frame.q_lab_from_flu[i]
            if is_repeated(m, criteria.armed[i]) and criteria.watched[FREEZE]:
                if m.same >= FROZEN_FRAMES:
                    m.code, m.other.frames = FREEZE, 0
                frame.rejected[i], frame.seen[i] = m.code, False
                continue
            reason = reasons[i]
            if reason > 0 and not criteria.watched[reason]:
                m.believed.frames, m.code, reason = 0, 0, 0
            update(m, criteria.bounds[i], frame.t_ns, pos, q, reason, criteria.armed[i])
            if m.code == 0 and reason == 0 and criteria.armed_known[i] and not criteria.armed[i]:
                m.floor_m = pos[2]
            code = m.code
            if code == 0 and criteria.watched[FLIP] and criteria.armed[i] and is_inconsistent(m, criteria.bounds[i], q):
                code = FLIP
            frame.rejected[i] = code
            frame.seen[i] = code == 0
    return swaps


@kernel
def watch_bits(m: Memory, pos: Float, q: Float, armed: bool) -> None:
    """Whether the pose is the one shown before, and whether this body's pose ever varies while it stands still."""
    same = True
    for axis in range(3):
        same = same and pos[axis] == m.shown_pos_m[axis]
        m.shown_pos_m[axis] = pos[axis]
    for k in range(4):
        same = same and q[k] == m.shown_q[k]
        m.shown_q[k] = q[k]
    m.same = m.same + 1 if same else 1
    if armed or m.noisy:
        return
    still = True
    for axis in range(3):
        still = still and abs(pos[axis] - m.still_m[axis]) < STILL_M
    if not still:
        m.varied = 0
        for axis in range(3):
            m.still_m[axis] = pos[axis]
    elif not same:
        m.varied += 1
        m.noisy = m.varied >= NOISY_FRAMES


@kernel
def is_repeated(m: Memory, armed: bool) -> bool:
    """Whether it shows the last pose again, to the last bit, which says nothing new of a body whose pose varies.

    A camera without noise repeats the pose of all that stands, too.
    """
    flies = armed and m.believed.pos_lab_m[2] - m.floor_m > OFF_FLOOR_M
    return m.same > 1 and (m.noisy or flies)


@kernel
def undo_swaps(frame: Frame, criteria: Criteria, memory: Rows[Memory], reasons: NDArray[np.int64]) -> int:
    """Correct pairs of swapped bodies whose attitudes agree, else reject both with SWAP; the number corrected."""
    swaps = 0
    for i in range(len(reasons)):
        for j in range(i + 1, len(reasons)):
            before = memory[i].under == j + 1
            if before:
                memory[i].under = memory[j].under = 0
            if not (frame.seen[i] and frame.seen[j] and is_swapped(frame, criteria, memory, reasons, i, j, before)):
                continue
            both_jumped = reasons[i] == JUMP and reasons[j] == JUMP
            q_i = reassigned_attitude(
                frame.q_lab_from_flu[j], criteria.q_marker_from_flu[j], criteria.q_marker_from_flu[i]
            )
            q_j = reassigned_attitude(
                frame.q_lab_from_flu[i], criteria.q_marker_from_flu[i], criteria.q_marker_from_flu[j]
            )
            wrong = turned_as_it_can(memory[i].believed, criteria.bounds[i], frame.t_ns, q_i)
            wrong += turned_as_it_can(memory[j].believed, criteria.bounds[j], frame.t_ns, q_j)
            if wrong == 0 and criteria.watched[SWAP]:
                reasons[i] = reasons[j] = 0
                memory[i].under, memory[j].under = j + 1, i + 1
                for axis in range(3):
                    here = frame.pos_lab_m[i, axis]
                    frame.pos_lab_m[i, axis] = frame.pos_lab_m[j, axis]
                    frame.pos_lab_m[j, axis] = here
                for k in range(4):
                    frame.q_lab_from_flu[i, k], frame.q_lab_from_flu[j, k] = q_i[k], q_j[k]
                swaps += 1
            elif both_jumped:
                reasons[i] = reasons[j] = SWAP
            break
    return swaps


@kernel
def is_swapped(
    frame: Frame, criteria: Criteria, memory: Rows[Memory], reasons: NDArray[np.int64], i: int, j: int, before: bool
) -> bool:
    """Whether i and j are each where the other must be: where neither can be where it is shown, or after a gap by far.

    before: whether they were in the frame before; then they are until what is shown fits better.
    """
    one, other, t_ns = memory[i], memory[j], frame.t_ns
    if one.code != 0 or other.code != 0:
        return False
    if not moved_as_it_can(one.believed, criteria.bounds[i], t_ns, frame.pos_lab_m[j]):
        return False
    if not moved_as_it_can(other.believed, criteria.bounds[j], t_ns, frame.pos_lab_m[i]):
        return False
    known = one.believed.frames >= KNOWN_FRAMES and other.believed.frames >= KNOWN_FRAMES
    gone_s = (t_ns - min(one.believed.t_ns, other.believed.t_ns)) * SECONDS
    if gone_s <= SWAP_S and not before:
        return known and reasons[i] == JUMP and reasons[j] == JUMP
    crossed = position_innovation_m(one.believed, t_ns, frame.pos_lab_m[j]) + position_innovation_m(
        other.believed, t_ns, frame.pos_lab_m[i]
    )
    straight = position_innovation_m(one.believed, t_ns, frame.pos_lab_m[i]) + position_innovation_m(
        other.believed, t_ns, frame.pos_lab_m[j]
    )
    return (before or known) and gone_s <= GAP_S and crossed < (1.0 if before else NEARER) * straight


@kernel
def reassigned_attitude(q_lab_from_flu: Float, q_marker_from_flu: Float, q_marker_from_its_flu: Float) -> Float:
    """The attitude of the body whose markers were reported under another body's name."""
    q_flu_from_marker, q_lab_from_marker, out = np.empty(4), np.empty(4), np.empty(4)
    q_flu_from_marker[0] = q_marker_from_flu[0]
    for k in range(1, 4):
        q_flu_from_marker[k] = -q_marker_from_flu[k]
    multiply_into(q_lab_from_flu, q_flu_from_marker, q_lab_from_marker)
    multiply_into(q_lab_from_marker, q_marker_from_its_flu, out)
    if out[0] < 0.0:
        for k in range(4):
            out[k] = -out[k]
    return out


@kernel
def update(m: Memory, bounds: Bounds, t_ns: int, pos: Float, q: Float, reason: int, armed: bool) -> None:
    """Accept the pose, or the path that it continues, or neither; reason: why it does not follow `believed`, or 0.

    A path that began with a jump while the body was in sight is never accepted while its motors are on. A path that
    returns from there to where the body must be starts over: a few outliers do not count against later frames.
    """
    believed = m.believed
    if m.code == 0 and reason == 0:
        if believed.frames == 0:
            begin(believed, t_ns, pos, q)
        else:
            extend(believed, t_ns, pos, q)
        return
    other = m.other
    if m.code == 0:
        m.possible = believed.frames < KNOWN_FRAMES
        begin(other, t_ns, pos, q)
        other.period_s, other.burst = believed.period_s, 0  # of the same cameras
    elif not m.possible and reason == 0 and is_reacquired(m, bounds, t_ns, pos, q):
        m.possible = True
        begin(other, t_ns, pos, q)
    elif is_in_sight(other, believed.period_s, t_ns) and reject_reason(other, bounds, t_ns, pos, q) == 0:
        extend(other, t_ns, pos, q)
    else:
        m.possible = reason == 0
        begin(other, t_ns, pos, q)
    if m.code == 0:
        m.code = reason
    if other.frames >= (RECOVERY_FRAMES if m.possible else RELEARN_FRAMES) and (m.possible or not armed):
        copy_into(other, believed)
        m.code = 0


@kernel
def is_reacquired(m: Memory, bounds: Bounds, t_ns: int, pos: Float, q: Float) -> bool:
    """Whether the frame leaves the other path and is within one frame's reach of the believed path's prediction.

    Without the frames between, it would have been accepted at once. A body that is stuck elsewhere, at rest or moving
    along with the true one, is never reacquired.
    """
    believed, other = m.believed, m.other
    gone_s, other_s = (t_ns - believed.t_ns) * SECONDS, since_s(other, t_ns)
    led_m, leapt2, w = np.empty(3), 0.0, 0.0
    for axis in range(3):
        led_m[axis] = pos[axis] - (gone_s - believed.period_s) * believed.vel_lab_m_s[axis]
        leapt2 += (pos[axis] - other.pos_lab_m[axis] - other_s * other.vel_lab_m_s[axis]) ** 2
    for k in range(4):
        w += q[k] * other.q_lab_from_flu[k]
    if leapt2 <= LEAP_M**2 and 1.0 - w * w <= sin(0.5 * LEAP_RAD) ** 2:
        return False
    one_frame_on_ns = believed.t_ns + int(believed.period_s / SECONDS)
    return reject_reason(believed, bounds, one_frame_on_ns, led_m, q) == 0


@kernel
def is_inconsistent(m: Memory, bounds: Bounds, q: Float) -> bool:
    """Whether the attitude would have a flying drone's rotors push downwards for too long; they only pull upwards."""
    path = m.believed
    if path.frames < KNOWN_FRAMES:  # its velocity estimate starts over
        for axis in range(3):
            m.slow_vel_lab_m_s[axis] = path.vel_lab_m_s[axis]
    share = path.period_s / (path.period_s + UPSET_LAG_S)
    x, y, z = thrust_axis(q)
    along = GRAVITY_M_S2 * z
    for axis in range(3):
        m.slow_vel_lab_m_s[axis] += share * (path.vel_lab_m_s[axis] - m.slow_vel_lab_m_s[axis])
    slow, vel = m.slow_vel_lab_m_s, path.vel_lab_m_s
    along += (x * (vel[0] - slow[0]) + y * (vel[1] - slow[1]) + z * (vel[2] - slow[2])) / UPSET_LAG_S
    if bounds.commanded and along < -UPSET_M_S2 and path.pos_lab_m[2] - m.floor_m > OFF_FLOOR_M:
        m.upset += 1
        if m.upset >= UPSET_FRAMES:
            m.upset = UPSET_FRAMES + RECOVERY_FRAMES
    elif m.upset > UPSET_FRAMES:
        m.upset -= 1
    else:
        m.upset = 0
    return m.upset > UPSET_FRAMES


FASTEST_M_S = 15.0
SPIN_RAD_S = 35.0
"""The most about its own axis, with a dead motor too: what the gyros of such vehicles can say (2000 degrees/s)."""
OBSERVED = Bounds(0.05, 50.0, FASTEST_M_S, 0.25, 20.0, 0.15, 10.0, 200.0, False)
"""A body that is only observed may be anything that a hand carries or swings."""


def of_vehicle(profile: VehicleProfile) -> Bounds:
    """Full thrust and gravity together; thrice its rate about x and y: a gust may help; about z, two motors alone."""
    acc_m_s2 = profile.thrust_max_n / profile.mass_kg + GRAVITY_M_S2
    yaw_acc_rad_s2 = 0.5 * profile.thrust_max_n * profile.yaw_torque_m / profile.inertia_kg_m2[2]
    turn_rad_s = 3.0 * profile.rate_max_rad_s
    return Bounds(0.04, acc_m_s2, FASTEST_M_S, 0.2, turn_rad_s, 0.1, SPIN_RAD_S, yaw_acc_rad_s2, True)


def bounds(config: LabConfig) -> Rows[Bounds]:
    """The bounds of the lab's n vehicles."""
    kinds = [OBSERVED if v.sysid is None else of_vehicle(config.profile_of(v)) for v in config.vehicles]
    return rows(Bounds, kinds)


EARLY_NS = 10_000_000
"""How much less than the least delay known a delay may be."""
LATE_NS = 150_000_000
"""How much more: an older pose is too old to fly by."""


@dataclass(frozen=True, slots=True)
class Check:
    """One check: its name, its reason on the bus, its limits in words, frames to detection, and to recovery."""

    name: str
    reason: Rejection
    rejects: str
    detected: str
    recovers: str


_LASTING = f"{RECOVERY_FRAMES} frames of another path, within reach"

CHECKS = (
    Check(
        "validator-freeze", Rejection.FREEZE,
        "a pose that stays the same to the last bit, of a body whose pose varied while it stood, or that flies; "
        "the first such frame already counts as not seen",
        f"{FROZEN_FRAMES} frames", f"{RECOVERY_FRAMES} frames that differ",
    ),
    Check(
        "validator-jump", Rejection.JUMP,
        "a step beyond 4 cm and what full thrust and gravity can do since it was last believed "
        f"(only observed: {100 * OBSERVED.step_m:g} cm and {OBSERVED.acc_m_s2:g} m/s²), or beyond {FASTEST_M_S:g} m/s",
        "1 frame", _LASTING,
    ),
    Check(
        "validator-flip", Rejection.FLIP,
        "a turn about x and y beyond 0.2 rad and thrice the vehicle's rate "
        f"(only observed: {OBSERVED.turn_step_rad:g} rad and {OBSERVED.turn_rad_s:g} rad/s)",
        "1 frame", _LASTING,
    ),
    Check(
        "validator-flip", Rejection.FLIP,
        f"an attitude in flight whose rotors would push downwards with {UPSET_M_S2:g} m/s², by the acceleration seen",
        f"{UPSET_FRAMES} frames", f"{RECOVERY_FRAMES} frames",
    ),
    Check(
        "validator-yaw-rate", Rejection.YAW_RATE,
        "a turn about z beyond 0.1 rad and what two motors alone can do since it was last believed "
        f"(only observed: {OBSERVED.yaw_step_rad:g} rad and {OBSERVED.yaw_acc_rad_s2:g} rad/s²), or beyond "
        f"{SPIN_RAD_S:g} rad/s",
        "1 frame", _LASTING,
    ),
    Check(
        "validator-swap", Rejection.SWAP,
        f"two bodies, each where the other must be, or after a gap of up to {GAP_S:g} s is by far nearer to: "
        "set right if their attitudes fit as well, else both rejected",
        "1 frame", "set right at once, else as a jump",
    ),
    Check(
        "validator-stamp", Rejection.STAMP,
        f"a capture {EARLY_NS / 1e6:g} ms nearer to its arrival than ever before, or {LATE_NS / 1e6:g} ms farther",
        "1 frame", "1 frame",
    ),
)  # fmt: skip

NAMES = tuple(dict.fromkeys(check.name for check in CHECKS))
"""The monitors of the pose validator, each of which can be switched off."""


def watched(without: frozenset[str]) -> frozenset[Rejection]:
    """The reasons that count without those checks."""
    return frozenset(Rejection) - {check.reason for check in CHECKS if check.name in without}


def checks_markdown() -> str:
    """The checks as the documentation shows them: a row a check."""
    rows = (f"| `{c.name}` | {c.rejects} | {c.detected} | {c.recovers} |" for c in CHECKS)
    return "\n".join(("| check | rejects | after | believed again after |", "|---|---|---|---|", *rows))


def name_of(reason: Rejection) -> str:
    """The check that has this reason, empty for a pose that is none."""
    return next((check.name for check in CHECKS if check.reason is reason), "")


SOURCE = "mocap"
QUIET_NS = 500_000_000
"""Rejections with shorter gaps form one episode, so that a flickering body does not fill the log."""


@dataclass(slots=True)
class _Episode:
    began_ns: int
    last_ns: int
    counts: Counter[Rejection] = field(default_factory=Counter)


class Episodes:
    """Those of a lab's bodies. `counts` holds all rejections since the start, by body and reason."""

    def __init__(self, bodies: tuple[str, ...]) -> None:
        self.counts: dict[str, Counter[Rejection]] = {body: Counter() for body in bodies}
        self._open: dict[str, _Episode] = {}
        self._events: list[Event] = []

    def note(self, frame: LabFrame, now_ns: int, detail: str = "") -> None:
        """Note the rejected poses of one frame; detail: what is known beside the reason."""
        for body, code in zip(frame.bodies, frame.rejected.tolist(), strict=True):
            if code:
                self._note(body, Rejection(code), now_ns, detail)

    def note_swaps(self, count: int, now_ns: int) -> None:
        """Note identity swaps that were corrected; count: pairs of bodies."""
        for _ in range(count):
            self._note("", Rejection.SWAP, now_ns)

    def due(self, now_ns: int) -> tuple[Event, ...]:
        """Events that are due."""
        if self._open:
            for body in [b for b, e in self._open.items() if now_ns - e.last_ns >= QUIET_NS]:
                self._close(body, self._open.pop(body))
        events, self._events = tuple(self._events), []
        return events

    def _note(self, body: str, reason: Rejection, now_ns: int, detail: str = "") -> None:
        if body:
            self.counts[body][reason] += 1
        if not name_of(reason):  # no valid pose: MocapCore's reject_log reports it
            return
        episode = self._open.get(body)
        if episode is None:
            episode = self._open[body] = _Episode(now_ns, now_ns)
            self._events.append(
                Event(Severity.WARNING, SOURCE, _began(body, reason, detail), code=name_of(reason), subject=body)
            )
        episode.last_ns = now_ns
        episode.counts[reason] += 1

    def _close(self, body: str, episode: _Episode) -> None:
        lasted_s = (episode.last_ns - episode.began_ns) * 1e-9
        counts = ", ".join(f"{count} x {name_of(reason)}" for reason, count in episode.counts.items())
        text = f"{body} is believed again" if body else "no bodies are swapped any more"
        self._events.append(Event(Severity.NOTICE, SOURCE, f"{text}: over {lasted_s:.2f} s, {counts}"))


def _began(body: str, reason: Rejection, detail: str) -> str:
    if not body:
        return f"{name_of(reason)}: two bodies were swapped; their poses are reassigned"
    return f"{body} is rejected, {name_of(reason)}: {detail or reason.text}"


SETTLED_FRAMES = 50


@dataclass(slots=True)
class StampWatch:
    """One source's least delay, from exposure to arrival."""

    _least: LeastDelay = field(default_factory=LeastDelay)
    _frames: int = 0
    _rejected: int = 0

    def rejects(self, t_capture_ns: int, now_ns: int, in_flight: bool) -> bool:
        """Whether the stamp is rejected. A lasting new delay is accepted while no drone flies."""
        delay_ns = now_ns - t_capture_ns
        least_ns = self._least.at_ns(now_ns)
        settled = least_ns is not None and self._frames >= SETTLED_FRAMES
        if delay_ns >= -AHEAD_NS and settled and least_ns is not None:
            wrong = not -EARLY_NS <= delay_ns - least_ns <= LATE_NS
            if wrong and not in_flight and self._rejected >= RELEARN_FRAMES:
                self._least, self._frames, wrong = LeastDelay(), 0, False
        else:
            wrong = delay_ns < -AHEAD_NS
        if wrong:
            self._rejected += 1
            return True
        self._least.offer(delay_ns, now_ns)
        self._frames, self._rejected = self._frames + 1, 0
        return False

    def why(self, t_capture_ns: int, now_ns: int) -> str:
        """The fault of a rejected stamp, in words."""
        usual_ms, ms = 1e-6 * (self._least.at_ns(now_ns) or 0), 1e-6 * (now_ns - t_capture_ns)
        if ms > usual_ms:
            what = "the network or a busy computer holds frames back, or the cameras' clock was set"
            return f"its frames come {ms:.0f} ms after their exposure, not {usual_ms:.0f}: {what}"
        return f"its frames are stamped {usual_ms - ms:.0f} ms too late: the cameras' clock was set"

    def likely_ns(self, now_ns: int) -> int:
        """When what arrives now was captured, if it took as long as the quickest did."""
        return now_ns - max(self._least.at_ns(now_ns) or 0, 0)


class PoseValidator:
    """Judges every body of every frame. `without`: names of checks that are switched off (mocap.validator)."""

    def __init__(self, config: LabConfig, without: frozenset[str] = frozenset()) -> None:
        counted = watched(without)
        self._bodies = tuple(v.body for v in config.vehicles)
        self._commanded = np.array([v.sysid is not None for v in config.vehicles])
        self._criteria = Criteria(
            bounds=bounds(config),
            q_marker_from_flu=frames.canonical(np.array([v.q_marker_from_flu for v in config.vehicles])),
            armed=np.zeros(len(self._bodies), np.bool_),
            armed_known=np.zeros(len(self._bodies), np.bool_),
            watched=np.array([reason in counted for reason in Rejection]),
        )
        self._memory = blank(Memory, len(self._bodies))
        self._stamps = StampWatch() if Rejection.STAMP in counted else None
        self._episodes = Episodes(self._bodies)

    def note_motors(self, on: Mapping[str, bool]) -> None:
        """Which drones have their motors on, as far as the ground knows; a body that is only observed leads them."""
        armed, armed_known = self._criteria.armed, self._criteria.armed_known
        for i, body in enumerate(self._bodies):
            if self._commanded[i] and body in on:
                armed[i], armed_known[i] = on[body], True
        armed[~self._commanded] = armed[self._commanded].any()
        armed_known[~self._commanded] = armed_known[self._commanded].all()

    def rejects_stamp(self, t_capture_ns: int, now_ns: int) -> bool:
        """Whether a frame that arrives now cannot have been captured then."""
        return self._stamps is not None and self._stamps.rejects(
            t_capture_ns, now_ns, True in self._criteria.armed.tolist()
        )

    def judge(self, frame: LabFrame, now_ns: int) -> LabFrame:
        """The frame with what is not believed unseen; its own arrays are written to."""
        swaps = judge(
            Frame(frame.t_capture_ns, frame.pos_lab_m, frame.q_lab_from_flu, frame.seen, frame.rejected),
            self._criteria, self._memory,
        )  # fmt: skip
        if swaps:
            self._episodes.note_swaps(swaps, now_ns)
        if any(frame.rejected.tolist()):
            self._episodes.note(frame, now_ns)
        return frame

    def without_poses(self, frame: LabFrame, earliest_ns: int, now_ns: int) -> LabFrame:
        """The frame without poses, for a rejected stamp; stamped with its likely time, not before earliest_ns."""
        likely_ns = now_ns if self._stamps is None else self._stamps.likely_ns(now_ns)
        t_ns = max(min(frame.t_capture_ns, likely_ns), earliest_ns)
        rejected = np.where(frame.seen, np.uint8(Rejection.STAMP), frame.rejected)
        without_poses = replace(frame, t_capture_ns=t_ns, seen=np.zeros(len(frame.seen), np.bool_), rejected=rejected)
        self._episodes.note(without_poses, now_ns, self._stamps.why(frame.t_capture_ns, now_ns) if self._stamps else "")
        return without_poses

    def events(self, now_ns: int) -> tuple[Event, ...]:
        """Events that are due: rejections that began, or ended."""
        return self._episodes.due(now_ns)

    def counts(self) -> dict[str, dict[str, int]]:
        """Poses rejected since the start, by body and reason; bodies without any are left out."""
        return {
            body: {name_of(reason) or reason.text: count for reason, count in counts.items()}
            for body, counts in self._episodes.counts.items()
            if counts
        }
