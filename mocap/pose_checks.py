"""What a lab's bodies can do, and each pose held against it: the compiled checks of one frame, body by body.

Each body has one stage; where its poses do not follow the path that is believed, they make a second one:

| stage | entered by | left for |
|---|---|---|
| BELIEVED | RECOVERY_FRAMES of a REACHABLE path; RELEARN_FRAMES of any, motors off | the others, by a wrong pose |
| FROZEN | FROZEN_FRAMES of the same pose | REACHABLE or UNREACHABLE, by the next that differs |
| REACHABLE | a second path that began where the body can have come to | UNREACHABLE, where it begins anew elsewhere |
| UNREACHABLE | one that began elsewhere, of a body with KNOWN_FRAMES | REACHABLE, where `is_reacquired` |

Two bodies that are swapped are one another's `under` until a frame fits better without.
"""

from dataclasses import dataclass
from math import sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from formation.config import LabConfig
from formation.maths.arrays import Bool, Float, Quat, Vec3
from formation.maths.kernel import kernel
from formation.maths.quaternion import multiply_into, thrust_axis
from formation.maths.records import Rows, rows
from formation.messages import FROZEN_FRAMES, Rejection
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

FREEZE, JUMP, FLIP = int(Rejection.FREEZE), int(Rejection.JUMP), int(Rejection.FLIP)
SWAP = int(Rejection.SWAP)
BELIEVED, FROZEN, REACHABLE, UNREACHABLE = range(4)

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

    believed: the path that was believed last; other: the second one, that does not follow from it, or not surely.
    stage, and code: why it is rejected now, or 0. under: of two swapped bodies the other's index + 1, else 0.
    shown_*, same: the pose last shown, and how many times in a row it was the same to the last bit. still_m, varied,
    noisy: whether a standing body's pose varies, as that of every real camera does.
    slow_vel_lab_m_s: the velocity some time ago; upset: frames whose attitude is inconsistent with the acceleration.
    floor_m: height at which it last stood with its motors off, 0 until that is known.
    """

    believed: Path
    other: Path
    stage: int
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
                    m.code, m.stage = FREEZE, FROZEN
                frame.rejected[i], frame.seen[i] = m.code, False
                continue
            reason = reasons[i]
            if reason > 0 and not criteria.watched[reason]:
                m.believed.frames, m.code, m.stage, reason = 0, 0, BELIEVED, 0
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
            q_i, q_j = reassigned_attitude(frame, criteria, j, i), reassigned_attitude(frame, criteria, i, j)
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
def reassigned_attitude(frame: Frame, criteria: Criteria, shown: int, body: int) -> Float:
    """The attitude of the body whose markers were reported under the name of the body `shown`."""
    q_marker_from_flu, q_flu_from_marker = criteria.q_marker_from_flu[shown], np.empty(4)
    q_lab_from_marker, out = np.empty(4), np.empty(4)
    q_flu_from_marker[0] = q_marker_from_flu[0]
    for k in range(1, 4):
        q_flu_from_marker[k] = -q_marker_from_flu[k]
    multiply_into(frame.q_lab_from_flu[shown], q_flu_from_marker, q_lab_from_marker)
    multiply_into(q_lab_from_marker, criteria.q_marker_from_flu[body], out)
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
    believed, other, was = m.believed, m.other, m.stage
    if was == BELIEVED and reason == 0:
        if believed.frames == 0:
            begin(believed, t_ns, pos, q)
        else:
            extend(believed, t_ns, pos, q)
        return
    if was == BELIEVED:
        m.stage, m.code = REACHABLE if believed.frames < KNOWN_FRAMES else UNREACHABLE, reason
    elif was == UNREACHABLE and reason == 0 and is_reacquired(m, bounds, t_ns, pos, q):
        m.stage = REACHABLE
    elif was != FROZEN and continues(other, bounds, believed.period_s, t_ns, pos, q):
        extend(other, t_ns, pos, q)
        is_long = other.frames >= (RECOVERY_FRAMES if was == REACHABLE else RELEARN_FRAMES)
        if is_long and (was == REACHABLE or not armed):
            copy_into(other, believed)
            m.stage, m.code = BELIEVED, 0
        return
    else:
        m.stage = REACHABLE if reason == 0 else UNREACHABLE
    begin(other, t_ns, pos, q)
    if was == BELIEVED:
        other.period_s, other.burst = believed.period_s, 0  # of the same cameras


@kernel
def continues(path: Path, bounds: Bounds, period_s: float, t_ns: int, pos: Float, q: Float) -> bool:
    """Whether the pose is the next one of the path."""
    return is_in_sight(path, period_s, t_ns) and reject_reason(path, bounds, t_ns, pos, q) == 0


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
