"""Motions from rest to rest, smooth in acceleration: the leader's own trajectories, and how a gap to a course closes.

The trajectories are the kinds of formation.trajectory_config. A gap is the one way in which a reference changes its
mind: it closes from any motion to none. Two motions add up: what motion there was is soon braked to rest, and the
distance left then closes along a quintic from rest to rest; so a long way does not let a passing motion run on.
Position, velocity and acceleration stay continuous, and after `duration` the gap is exactly zero. On the way it may
make a detour: a bump that begins and ends at rest. A gap is an array (4, 4): columns x, y, z, heading; rows position,
velocity, acceleration when it began, and the detour half-way. brake_s: how long that motion is braked.

Plain functions, so that a lab is judged without a compiler; where they must be fast, kernels call them
(formation.guidance.reference_generator), and it is these very functions that they compile.
"""

from dataclasses import dataclass
from itertools import pairwise
from math import cos, pi, sin, sqrt

import numpy as np

from formation.config import TrajectoryConfig
from formation.guidance import spline
from formation.maths.arrays import Float
from formation.trajectory_config import FROM_OUTSIDE

HOLD, LINE, CIRCLE, WAYPOINTS, LISSAJOUS, SPLINE = range(6)
# Where each of a trajectory's numbers is, after the start's x, y, z and heading; the last three along x, y and z.
DURATION, LENGTH, RADIUS, LAP_RATE, LAP_RAMP, TURN_RATE, TURN_RAMP = range(4, 11)
AMPLITUDE, CYCLES, PHASE = range(11, 20, 3)
RAMP_MAX_S, TURN_RAMP_S = 3.0, 2.0
PEAK_SPEED = 1.875  # of a minimum-jerk step of unit length and duration
SHORTEST_S, HARDEST_S = 0.6, 0.2
ACCELERATION_M_S2 = 2.5
TURN_RAD_S = 1.0
HARD_M_S2 = 4.0  # two thirds of what a tilt of 0.6 rad gives
PEAK_BRAKING = 1.5  # of a speed braked along Hermite's cubic in unit time
STILL_M_S = 0.01
PEAK_ACCELERATION = 5.7735  # of such a step
BUMP_SPEED, BUMP_ACCELERATION = 3.4346, 24.0  # of a detour of unit height and duration


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """A trajectory anchored where the leader was when it began; evaluate with `sample`.

    kind: one of the constants above; numbers (20): its parameters, by the names above; knots: of WAYPOINTS (k, 4),
    arrival time and x, y, z of each, of a SPLINE its pieces (formation.guidance.spline).
    """

    kind: int
    numbers: Float
    knots: Float
    duration_s: float


def anchored(config: TrajectoryConfig, pos_lab_m: Float, yaw_rad: float) -> Trajectory:
    """The configured trajectory for a leader whose reference rests at pos_lab_m (3).

    The line starts there, along lab x; the circle lies about the lab's origin at that height, whole laps from
    (radius, 0), as do a figure of eight, from its crossing, and Lissajous's figure; waypoints are points of the lab, in
    each of which it rests; a polynomial passes through them without stopping (of all such ways the one with the least
    snap); file and own are points of the lab, their heading is the leader's; relative ones are moved to
    begin where it is. The turn (yaw_rate_rad_s) is added.
    It lasts: a hold duration_s; a line duration_s each way; a circle, eight or Lissajous's a period a lap and a ramp, a
    quarter period or 3 s; waypoints 1.875 times the way at speed_m_s, each piece half a second at least; a polynomial
    so long that its highest speed is speed_m_s; file and own as their points say.
    """
    knots = np.zeros((1, 4))
    knots[0, 1:] = pos_lab_m
    kind, duration = HOLD, config.duration_s
    amplitude, cycles, phase = config.amplitude_m, config.cycles, config.phase_rad
    if config.kind == "line" and config.laps is None:
        kind = LINE
    elif config.kind == "line":
        kind, knots = WAYPOINTS, _there_and_back(config, config.laps or 1, pos_lab_m)
        duration = float(knots[-1, 0])
    elif config.kind == "circle":
        laps = config.laps or max(1, round(config.duration_s / config.period_s))
        kind, duration = CIRCLE, laps * config.period_s + _ramp_s(config.period_s)
    elif config.kind == "waypoints":
        kind, knots = WAYPOINTS, _timed_knots(config, pos_lab_m)
        duration = float(knots[-1, 0])
    elif config.kind in ("figure8", "lissajous"):
        kind, duration = LISSAJOUS, (config.laps or 1) * config.period_s + _ramp_s(config.period_s)
        if config.kind == "figure8":
            width_m = config.width_m or 0.5 * config.length_m
            amplitude, cycles, phase = (0.5 * config.length_m, 0.5 * width_m, 0.0), (1, 2, 0), (0.0, 0.0, 0.0)
    elif config.kind == "polynomial":
        kind, (knots, duration) = SPLINE, spline.through(_path_points(config, pos_lab_m), yaw_rad, config.speed_m_s)
    elif config.kind in FROM_OUTSIDE:
        points = np.array(config.points)
        if config.relative:
            points[:, 1:4] += pos_lab_m - points[0, 1:4]
        kind, (knots, duration) = SPLINE, spline.timed(points)
    numbers = np.array(
        [*pos_lab_m, yaw_rad, duration, config.length_m, config.radius_m, 2.0 * pi / config.period_s,
         _ramp_s(config.period_s), config.yaw_rate_rad_s, min(TURN_RAMP_S, 0.5 * duration),
         *amplitude, *cycles, *phase]
    )  # fmt: skip
    return Trajectory(kind, numbers, knots, duration)


def _ramp_s(period_s: float) -> float:
    """How long a circle takes to reach its speed: a quarter lap at most."""
    return min(RAMP_MAX_S, 0.25 * period_s)


def _there_and_back(config: TrajectoryConfig, laps: int, pos_lab_m: Float) -> Float:
    """Knots of a line flown out and home again, `laps` times."""
    ends = np.array([pos_lab_m, pos_lab_m + np.array([config.length_m, 0.0, 0.0])])
    flown = np.arange(2 * laps + 1)
    return np.column_stack([config.duration_s * flown, ends[flown % 2]])


def _timed_knots(config: TrajectoryConfig, pos_lab_m: Float) -> Float:
    """Arrival times at the start and each waypoint, with the peak speed of each step at the configured one."""
    points, times = _path_points(config, pos_lab_m), [0.0]
    for a, b in pairwise(points):
        times.append(times[-1] + max(PEAK_SPEED * float(np.linalg.norm(b - a)) / config.speed_m_s, 0.5))
    return np.column_stack([times, points])


def _path_points(config: TrajectoryConfig, pos_lab_m: Float) -> Float:
    """The start and every waypoint of every lap (k, 3)."""
    return np.array([tuple(pos_lab_m), *(config.waypoints_m * (config.laps or 1))], dtype=np.float64)


def min_jerk(u: float) -> tuple[float, float, float]:
    """The minimum-jerk step from 0 to 1 over u in 0..1, and its two derivatives by u (Flash and Hogan 1985)."""
    if u <= 0.0:
        return 0.0, 0.0, 0.0
    if u >= 1.0:
        return 1.0, 0.0, 0.0
    u2 = u * u
    return (
        u2 * u * (10.0 - 15.0 * u + 6.0 * u2),
        u2 * (30.0 - 60.0 * u + 30.0 * u2),
        u * (60.0 - 180.0 * u + 120.0 * u2),
    )


def ramped_angle(t_s: float, rate: float, ramp_s: float, duration_s: float) -> tuple[float, float, float]:
    """Angle and its two derivatives of a turn at `rate` that starts and stops over ramp_s each, from 0 at 0."""
    if t_s <= 0.0:
        return 0.0, 0.0, 0.0
    t_s = min(t_s, duration_s)
    mirrored = t_s > duration_s - ramp_s
    t = duration_s - t_s if mirrored else t_s
    if t < ramp_s:
        u = t / ramp_s
        u4 = u * u * u * u
        angle = rate * ramp_s * u4 * (2.5 - 3.0 * u + u * u)
        step, slope, _ = min_jerk(u)
        turn, acc = rate * step, rate * slope / ramp_s
    else:
        angle, turn, acc = rate * (t - 0.5 * ramp_s), rate, 0.0
    if mirrored:
        angle, acc = rate * (duration_s - ramp_s) - angle, -acc
    return angle, turn, acc


def sample(kind: int, numbers: Float, knots: Float, t_s: float, out: Float) -> None:
    """Position, velocity, acceleration (rows) of x, y, z, heading (columns) at t_s into out (3, 4), lab."""
    for axis in range(4):
        out[0, axis], out[1, axis], out[2, axis] = numbers[axis], 0.0, 0.0
    duration = numbers[DURATION]
    if kind == LINE:
        step = min_jerk(t_s / duration)
        scale = numbers[LENGTH]
        for order in range(3):
            out[order, 0] += scale * step[order]
            scale /= duration
    elif kind == CIRCLE:
        _circle(ramped_angle(t_s, numbers[LAP_RATE], numbers[LAP_RAMP], duration), numbers[RADIUS], out)
    elif kind == LISSAJOUS:
        _lissajous(ramped_angle(t_s, numbers[LAP_RATE], numbers[LAP_RAMP], duration), numbers, out)
    elif kind == WAYPOINTS:
        _waypoints(knots, t_s, out)
    elif kind == SPLINE:
        spline.at(knots, min(max(t_s, 0.0), duration), out)
    turn = ramped_angle(t_s, numbers[TURN_RATE], numbers[TURN_RAMP], duration)
    for order in range(3):
        out[order, 3] += turn[order]


def _lissajous(angle: tuple[float, float, float], numbers: Float, out: Float) -> None:
    """Of each axis amplitude * sin(cycles * angle + phase): x and y about the lab's origin, z about the start's."""
    th, w, acc = angle
    for axis in range(3):
        size, cycles = numbers[AMPLITUDE + axis], numbers[CYCLES + axis]
        at = cycles * th + numbers[PHASE + axis]
        s, c = size * sin(at), size * cycles * cos(at)
        out[0, axis] = s if axis < 2 else out[0, axis] + s
        out[1, axis] = c * w
        out[2, axis] = c * acc - cycles * cycles * s * w * w


def _circle(angle: tuple[float, float, float], radius_m: float, out: Float) -> None:
    """x and y of a point at `angle` (and derivatives) about the lab's origin."""
    th, w, acc = angle
    c, s = radius_m * cos(th), radius_m * sin(th)
    out[0, 0], out[0, 1] = c, s
    out[1, 0], out[1, 1] = -s * w, c * w
    out[2, 0], out[2, 1] = -c * w * w - s * acc, -s * w * w + c * acc


def _waypoints(knots: Float, t_s: float, out: Float) -> None:
    """Minimum-jerk steps, from rest to rest, along the timed knots."""
    if len(knots) < 2:
        return
    piece = 0
    while piece + 2 < len(knots) and t_s > knots[piece + 1, 0]:
        piece += 1
    duration = knots[piece + 1, 0] - knots[piece, 0]
    step = min_jerk((t_s - knots[piece, 0]) / duration)
    for axis in range(3):
        scale = knots[piece + 1, 1 + axis] - knots[piece, 1 + axis]
        out[0, axis] = knots[piece, 1 + axis]
        for order in range(3):
            out[order, axis] += scale * step[order]
            scale /= duration


PARTS = (min_jerk, ramped_angle, _circle, _waypoints, _lissajous, spline.at)
"""What `sample` calls: whoever compiles it has these compiled too."""


def braking_s(gap: Float) -> float:
    """How long the motion that a gap (4, 4) began with is braked where there is room."""
    speed = sqrt(gap[1, 0] ** 2 + gap[1, 1] ** 2 + gap[1, 2] ** 2)
    return max(2.0 * speed / ACCELERATION_M_S2, SHORTEST_S)


def stopping_s(gap: Float, distance_m: Float) -> float:
    """Braking time, s, with so much free distance ahead (3) in x, y, z: harder where that is short, up to HARD_M_S2."""
    speed = np.abs(gap[1, :3])
    stop_s = np.min(2.0 * np.maximum(distance_m, 0.0) / np.maximum(speed, STILL_M_S))
    hardest_s = PEAK_BRAKING * np.linalg.norm(speed) / HARD_M_S2
    return min(max(float(stop_s), float(hardest_s), HARDEST_S), braking_s(gap))


def braked(gap: Float, column: int, brake_s: float) -> float:
    """How far the motion of one column goes on before it is at rest."""
    ahead: float = brake_s * (0.5 * gap[1, column] + gap[2, column] * brake_s / 12.0)
    return ahead


def closing_s(gap: Float, brake_s: float, speed_m_s: float) -> float:
    """How long a gap (4, 4) should take to close: its peaks stay under speed_m_s, a gentle acceleration and turn."""
    left = [gap[0, column] + braked(gap, column, brake_s) for column in range(4)]
    distance, detour = float(np.linalg.norm(left[:3])), float(np.linalg.norm(gap[3, :3]))
    duration_s: float = max(
        (PEAK_SPEED * distance + BUMP_SPEED * detour) / speed_m_s,
        sqrt((PEAK_ACCELERATION * distance + BUMP_ACCELERATION * detour) / ACCELERATION_M_S2),
        PEAK_SPEED * abs(left[3]) / TURN_RAD_S,
        brake_s,
    )
    return duration_s


def add_gap(gap: Float, brake_s: float, elapsed_s: float, duration_s: float, out: Float) -> None:
    """Adds to the motion `out` (3, 4) what is left after elapsed_s of the gap (4, 4) it began with.

    Velocity is braked along Hermite's cubic, the distance closes along the minimum-jerk quintic; the detour is
    64 u^3 (1 - u)^3 of its height.
    """
    if elapsed_s >= duration_s:
        return
    t, d = max(elapsed_s, 0.0), duration_s
    u = t / d
    b = min(t / brake_s, 1.0)
    left = (1.0 - b) * (1.0 - b)
    for i in range(4):
        ahead, v, a = braked(gap, i, brake_s), gap[1, i], gap[2, i] * brake_s
        p = gap[0, i] + ahead
        out[0, i] += p * (1.0 - u * u * u * (10.0 + u * (-15.0 + 6.0 * u)))
        out[1, i] -= p * 30.0 * u * u * (1.0 - u) * (1.0 - u) / d
        out[2, i] -= p * 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / (d * d)
        out[0, i] += (
            brake_s * b * (v * (1.0 + b * b * (0.5 * b - 1.0)) + a * b * (0.5 + b * (0.25 * b - 2.0 / 3.0))) - ahead
        )
        out[1, i] += left * (v * (1.0 + 2.0 * b) + a * b)
        out[2, i] += (1.0 - b) * (a * (1.0 - 3.0 * b) - 6.0 * v * b) / brake_s
        if gap[3, i] != 0.0:
            w = u * (1.0 - u)
            out[0, i] += gap[3, i] * 64.0 * w * w * w
            out[1, i] += gap[3, i] * 192.0 * w * w * (1.0 - 2.0 * u) / d
            out[2, i] += gap[3, i] * 384.0 * w * (1.0 - 5.0 * w) / (d * d)
