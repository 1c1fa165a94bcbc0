"""Hover thrust and thrust curve: sent thrust against the vertical motion it made.

    z'' = cos(tilt) (F1 u + F2 u^2 + F3 t u) - D z' - g

u is the sent thrust after the vehicle's delay and motor lag, F3 what the battery loses, D the drag. No derivative is
ever taken: both sides are weighted by a smooth bump and integrated, which moves it from the noisy height onto the bump.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from analysis.identify.signals import GRID_S, Estimate, Seen, Sent, covariance, grid, held, propagated
from formation.maths.arrays import Float
from formation.vehicle.body import GRAVITY_M_S2

BUMP_S = 0.6


@dataclass(frozen=True, slots=True, eq=False)
class Thrust:
    """The thrust of one vehicle, per kilogram.

    hover_norm: thrust_norm that hovers at lift-off. curve: k of T/T_max = (1 - k) u + k u^2, None where the thrust
    varied too little for a fit. full_m_s2: T_max over mass. fade_1_s: share of the thrust lost a second.
    """

    hover_norm: Estimate
    curve: Estimate | None
    full_m_s2: Estimate
    fade_1_s: Estimate


def fit(of: Sent, saw: Seen, delay_s: float, motor_lag_s: float) -> Thrust | str:
    """The thrust of one vehicle whose delay and motor lag are known, or why it cannot be had from this flight."""
    if not np.isfinite(of.thrust_norm).all():
        return "thrust was not recorded with every target"
    windows = list(_windows(of, saw, delay_s, motor_lag_s))
    if len(windows) < 40:
        return "too little uninterrupted free flight"
    table = np.array(windows)
    t_s, force, regressors = table[:, 0], table[:, 1], table[:, 2:]
    solution = np.linalg.lstsq(regressors, force, rcond=None)[0]
    residual = force - regressors @ solution
    cov = covariance(regressors, residual, t_s)
    hover, curve, full, fade = propagated(_meant, solution, cov)
    known = curve if curve.half_width < 0.1 else None
    return Thrust(hover, known, full, fade)


def _windows(
    of: Sent, saw: Seen, delay_s: float, motor_lag_s: float, spacing_s: float = 0.05
) -> Iterator[tuple[float, ...]]:
    """(t, specific force, its regressors) of each window without gaps."""
    at_s = grid(of, float(saw.t_s[-1])) if len(saw.t_s) else of.t_s[:1]
    if len(at_s) < 2 or len(saw.t_s) < 2:
        return
    sent = held(of.t_s + delay_s, of.thrust_norm, at_s)
    decay = float(np.exp(-GRID_S / motor_lag_s))
    first, second = (lfilter([0.0, 1.0 - decay], [1.0, -decay], sent**power) for power in (1, 2))
    cos = np.interp(at_s, saw.t_s, saw.cos_tilt)
    usual = BUMP_S / float(np.median(np.diff(saw.t_s)))
    for middle_s in np.arange(saw.t_s[0] + BUMP_S / 2.0, saw.t_s[-1] - BUMP_S / 2.0, spacing_s):
        frames = inside(saw.t_s, middle_s)
        if frames.stop - frames.start < 0.8 * usual:
            continue  # a window with a gap says nothing
        cells = inside(at_s, middle_s)
        weight = bump(at_s[cells] - middle_s)
        weight = cos[cells] * weight / weight.sum()
        speed, acceleration = motion(saw.t_s[frames] - middle_s, saw.height_m[frames])
        since_s = middle_s - saw.t_s[0]
        yield (
            float(middle_s), acceleration + GRAVITY_M_S2, float(weight @ first[cells]), float(weight @ second[cells]),
            float(weight @ first[cells]) * since_s, -speed,
        )  # fmt: skip


def inside(t_s: Float, middle_s: float) -> slice:
    """The entries within the bump about middle_s."""
    low, high = np.searchsorted(t_s, [middle_s - BUMP_S / 2.0, middle_s + BUMP_S / 2.0])
    return slice(int(low), int(high))


def bump(from_middle_s: Float) -> Float:
    """(1 - x^2)^4 over the window, x from -1 to 1: it and three derivatives vanish at the ends."""
    weight: Float = (1.0 - np.square(from_middle_s / (BUMP_S / 2.0))) ** 4
    return weight


def motion(from_middle_s: Float, height_m: Float) -> tuple[float, float]:
    """The bump-weighted means of z' and z'', from z alone: the integrals of -bump' z and bump'' z over the bump's."""
    half_s = BUMP_S / 2.0
    x = from_middle_s / half_s
    line = np.polyfit(x, height_m, 1)
    level = height_m - np.polyval(line, x)
    area = half_s * 256.0 / 315.0
    sloped = -8.0 * x * (1.0 - x * x) ** 3 / half_s
    bent = 8.0 * (1.0 - x * x) ** 2 * (7.0 * x * x - 1.0) / half_s**2
    speed = line[0] / half_s - np.trapezoid(sloped * level, from_middle_s) / area
    return float(speed), float(np.trapezoid(bent * level, from_middle_s) / area)


def _meant(solution: Float) -> Float:
    """Hover thrust, curve, full specific thrust and relative fade that F1, F2, F3 mean."""
    linear, square, fade, _ = solution
    full = linear + square
    if abs(square) < 1e-9 * abs(linear):
        hover = GRAVITY_M_S2 / linear
    else:
        hover = (-linear + np.sqrt(max(linear**2 + 4.0 * square * GRAVITY_M_S2, 0.0))) / (2.0 * square)
    return np.array([hover, square / full, full, -fade * hover / GRAVITY_M_S2])
