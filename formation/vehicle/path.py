"""Whether a pose follows from the poses before it: a body's path as far as it was seen, and what it can do.

A body can have come, and turned, only so far since it was last believed.
"""

from dataclasses import dataclass
from math import sqrt

from formation.maths.arrays import Float, Quat, Vec3
from formation.maths.kernel import kernel
from formation.maths.quaternion import turn_flu_rad
from formation.messages import Rejection

JUMP, FLIP, YAW_RATE = int(Rejection.JUMP), int(Rejection.FLIP), int(Rejection.YAW_RATE)
VELOCITY_GAIN = 0.3
"""Of an alpha-beta filter whose position is the measured one: its velocity is some 1 / gain frames old."""
PERIOD_GAIN = 0.1
BURST_SHARE, BURST_FRAMES = 0.5, 300
"""Frames nearer to each other than this share of the period arrived together; more in a row, and the rate is higher."""
IN_SIGHT_S, IN_SIGHT_PERIODS = 0.05, 3.5
SECONDS = 1e-9


@dataclass(slots=True)
class Bounds:
    """One body's; a record. What a step may be: each `step` for noise and glitches, and what grows with the time.

    acc_m_s2: the most its velocity can change by; turn: about the body's x and y axes; yaw: about its z axis, at most
    yaw_rad_s, which changes by yaw_acc_rad_s2 at most. commanded: whether it is a drone of ours, whose thrust is along
    its z axis.
    """

    step_m: float
    acc_m_s2: float
    speed_m_s: float
    turn_step_rad: float
    turn_rad_s: float
    yaw_step_rad: float
    yaw_rad_s: float
    yaw_acc_rad_s2: float
    commanded: bool


@dataclass(slots=True)
class Path:
    """The newest pose of a path, its velocity, and how many frames made it since the last gap (0: none); a record.

    yaw_rate_rad_s: about its own z axis. period_s: the time between its frames, without gaps and bursts; burst: how
    many of the newest frames came nearer to each other.
    """

    t_ns: int
    frames: int
    period_s: float
    burst: int
    pos_lab_m: Vec3
    vel_lab_m_s: Vec3
    yaw_rate_rad_s: float
    q_lab_from_flu: Quat


@kernel
def begin(path: Path, t_ns: int, pos_lab_m: Float, q_lab_from_flu: Float) -> None:
    """A path of this one pose."""
    path.t_ns, path.frames, path.yaw_rate_rad_s = t_ns, 1, 0.0
    for axis in range(3):
        path.pos_lab_m[axis], path.vel_lab_m_s[axis] = pos_lab_m[axis], 0.0
    for k in range(4):
        path.q_lab_from_flu[k] = q_lab_from_flu[k]


@kernel
def since_s(path: Path, t_ns: int) -> float:
    """Time from the path's end to a frame; a period where their stamps show that they only arrived together.

    No cameras expose twice in half a period: frames that a network held back are stamped so as they arrive.
    """
    dt_s = (t_ns - path.t_ns) * SECONDS
    return path.period_s if dt_s < BURST_SHARE * path.period_s else dt_s


@kernel
def learn_period(path: Path, t_ns: int) -> None:
    """Follow the time between frames, one of which came now; a burst says nothing of it."""
    dt_s = (t_ns - path.t_ns) * SECONDS
    path.burst = path.burst + 1 if dt_s < BURST_SHARE * path.period_s else 0
    if path.period_s == 0.0 or path.burst > BURST_FRAMES:
        path.period_s = dt_s
    elif path.burst == 0:
        path.period_s += PERIOD_GAIN * (dt_s - path.period_s)


@kernel
def extend(path: Path, t_ns: int, pos_lab_m: Float, q_lab_from_flu: Float) -> None:
    """The path with one pose more; after a gap it begins anew."""
    if not is_in_sight(path, path.period_s, t_ns):
        begin(path, t_ns, pos_lab_m, q_lab_from_flu)
        return
    learn_period(path, t_ns)
    dt_s = since_s(path, t_ns)
    gain = 1.0 if path.frames < 2 else VELOCITY_GAIN
    for axis in range(3):
        mean = (pos_lab_m[axis] - path.pos_lab_m[axis]) / dt_s
        path.vel_lab_m_s[axis] += gain * (mean - path.vel_lab_m_s[axis])
        path.pos_lab_m[axis] = pos_lab_m[axis]
    yaw_rad = turn_flu_rad(path.q_lab_from_flu, q_lab_from_flu)[2]
    path.yaw_rate_rad_s += gain * (yaw_rad / dt_s - path.yaw_rate_rad_s)
    for k in range(4):
        path.q_lab_from_flu[k] = q_lab_from_flu[k]
    path.t_ns, path.frames = t_ns, path.frames + 1


@kernel
def is_in_sight(path: Path, period_s: float, t_ns: int) -> bool:
    """Whether the path went on until just now; period_s: between frames, as far as known."""
    if path.frames == 0:
        return False
    return (t_ns - path.t_ns) * SECONDS <= max(IN_SIGHT_S, IN_SIGHT_PERIODS * period_s)


@kernel
def copy_into(path: Path, out: Path) -> None:
    """The same path in another place."""
    out.t_ns, out.frames, out.period_s, out.burst = path.t_ns, path.frames, path.period_s, path.burst
    out.yaw_rate_rad_s = path.yaw_rate_rad_s
    for axis in range(3):
        out.pos_lab_m[axis], out.vel_lab_m_s[axis] = path.pos_lab_m[axis], path.vel_lab_m_s[axis]
    for k in range(4):
        out.q_lab_from_flu[k] = path.q_lab_from_flu[k]


@kernel
def position_innovation_m(path: Path, t_ns: int, pos_lab_m: Float) -> float:
    """How far it is from where the body came with the velocity that it had at the path's end."""
    dt_s, innovation2 = since_s(path, t_ns), 0.0
    for axis in range(3):
        innovation2 += (pos_lab_m[axis] - path.pos_lab_m[axis] - dt_s * path.vel_lab_m_s[axis]) ** 2
    return sqrt(innovation2)


@kernel
def moved_as_it_can(path: Path, bounds: Bounds, t_ns: int, pos_lab_m: Float) -> bool:
    """Whether the body can have come here from the path's end, with the velocity it had there."""
    dt_s = since_s(path, t_ns)
    away2 = 0.0
    for axis in range(3):
        away2 += (pos_lab_m[axis] - path.pos_lab_m[axis]) ** 2
    if away2 > (bounds.step_m + bounds.speed_m_s * dt_s) ** 2:
        return False
    if path.frames < 2:
        return True
    known_s = path.period_s / VELOCITY_GAIN
    return position_innovation_m(path, t_ns, pos_lab_m) <= bounds.step_m + bounds.acc_m_s2 * dt_s * (
        0.5 * dt_s + known_s
    )


@kernel
def turned_as_it_can(path: Path, bounds: Bounds, t_ns: int, q_lab_from_flu: Float) -> int:
    """Whether it can have turned so far, about z with the rate it had at the path's end: 0, or FLIP or YAW_RATE."""
    dt_s = since_s(path, t_ns)
    turn = turn_flu_rad(path.q_lab_from_flu, q_lab_from_flu)
    if sqrt(turn[0] * turn[0] + turn[1] * turn[1]) > bounds.turn_step_rad + bounds.turn_rad_s * dt_s:
        return FLIP
    if abs(turn[2]) > bounds.yaw_step_rad + bounds.yaw_rad_s * dt_s:
        return YAW_RATE
    if path.frames < 2:
        return 0
    known_s = path.period_s / VELOCITY_GAIN
    reach_rad = bounds.yaw_step_rad + bounds.yaw_acc_rad_s2 * dt_s * (0.5 * dt_s + known_s)
    return YAW_RATE if abs(turn[2] - dt_s * path.yaw_rate_rad_s) > reach_rad else 0


@kernel
def reject_reason(path: Path, bounds: Bounds, t_ns: int, pos_lab_m: Float, q_lab_from_flu: Float) -> int:
    """Why the pose does not follow from the path: JUMP, FLIP, YAW_RATE; 0 where it does, or there is no path."""
    if path.frames == 0:
        return 0
    if not moved_as_it_can(path, bounds, t_ns, pos_lab_m):
        return JUMP
    return turned_as_it_can(path, bounds, t_ns, q_lab_from_flu)
