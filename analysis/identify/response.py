"""The attitude's answer to a target: fitted as a dead time and the three lags of a cascaded attitude loop.

    tilt(s) / target(s) = e^(-d s) (1 + k s) / (1 + s/P (1 + s/R (1 + T s)))

P and R are the autopilot's attitude and rate gains, T the motors' lag, k s what it makes of the target's body rates.
The controller assumes less: a dead time and one first-order lag. They are those whose step comes nearest to the step
of the fitted response, so that they do not depend on what a flight happened to excite.
The fit is an output-error fit: the mocap's attitude noise is white, so the loop being closed does not bias it.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import curve_fit, least_squares
from scipy.signal import cont2discrete, lfilter

from analysis.identify.signals import (
    GRID_S,
    Estimate,
    Seen,
    Sent,
    about,
    covariance,
    grid,
    held,
    propagated,
    tilt_of,
    turn_of,
)
from formation.maths.arrays import Bool, Float

START = np.array([np.log(10.0), np.log(40.0), np.log(0.025), 0.02, 0.0, 0.0, 0.0])
LOWEST = np.array([np.log(1.0), np.log(4.0), np.log(0.002), 0.0, -0.5, -0.2, -0.2])
HIGHEST = np.array([np.log(80.0), np.log(400.0), np.log(0.2), 0.5, 0.5, 0.2, 0.2])
SCALE = np.array([0.3, 0.3, 0.3, 0.02, 0.05, 0.01, 0.01])
DEAD, RATES = 3, 4
LEAST_S = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """The attitude response of one vehicle.

    dead_time_s, lag_s: what the controller assumes; the other four: the fitted loop.
    rate_lead: how much of the body rates' lead the autopilot takes, 1 all, 0 none; None where none was sent.
    tilt_share: of a commanded tilt, what is flown for good, by a fit of its own; no profile has a number for it.
    """

    dead_time_s: Estimate
    lag_s: Estimate
    attitude_p_1_s: Estimate
    rate_p_1_s: Estimate
    motor_lag_s: Estimate
    delay_s: Estimate
    rate_lead: Estimate | None
    tilt_share: Estimate


def fit(of: Sent, saw: Seen) -> Response | str:
    """The response of one vehicle, or why it cannot be had from this flight."""
    if len(saw.t_s) < 10 or saw.t_s[-1] - saw.t_s[0] < LEAST_S:
        return f"less than {LEAST_S:g} s of free flight"
    inputs, at_s = _inputs(of, float(saw.t_s[-1]))
    if float(np.std(inputs[:, :2])) < 2e-3:
        return "the attitude targets hardly moved"
    free = np.ones(len(START), dtype=np.bool_)
    free[RATES] = bool(np.abs(inputs[:, 2:]).max() > 1e-6)

    def residual(parameters: Float) -> Float:
        every = START.copy()
        every[free] = parameters
        residuals: Float = (saw.tilt - _modelled(every, inputs, at_s, saw)).T.ravel()
        return residuals

    found = least_squares(residual, START[free], bounds=(LOWEST[free], HIGHEST[free]), x_scale=SCALE[free])
    cov = np.zeros((len(START), len(START)))
    cov[np.ix_(free, free)] = covariance(np.asarray(found.jac), found.fun, np.tile(saw.t_s, 2))
    best = START.copy()
    best[free] = found.x
    share = _tilt_share(np.clip(best, LOWEST + 1e-6, HIGHEST - 1e-6), free, inputs, at_s, saw)
    dead, lag, p, r, motor, delay, lead = propagated(_meant, best, cov)
    return Response(dead, lag, p, r, motor, delay, lead if free[RATES] else None, share)


def _tilt_share(start: Float, free: Bool, inputs: Float, at_s: Float, saw: Seen) -> Estimate:
    """The loop fitted once more, with that share free beside it."""

    def residual(parameters: Float) -> Float:
        every = start.copy()
        every[free] = parameters[:-1]
        trimmed = _modelled(every, inputs, at_s, saw)
        every[5:] = 0.0
        missing = (1.0 - parameters[-1]) * _modelled(every, inputs, at_s, saw)
        residuals: Float = (saw.tilt - trimmed + missing).T.ravel()
        return residuals

    bounds = np.append(LOWEST[free], 0.2), np.append(HIGHEST[free], 2.0)
    found = least_squares(residual, np.append(start[free], 1.0), bounds=bounds, x_scale=np.append(SCALE[free], 0.1))
    cov = covariance(np.asarray(found.jac), found.fun, np.tile(saw.t_s, 2))
    return about(float(found.x[-1]), float(np.sqrt(cov[-1, -1])))


def _inputs(of: Sent, until_s: float) -> tuple[Float, Float]:
    """Target tilt and its rate from the target's body rates, (G, 4), on an even grid (G,)."""
    at_s = grid(of, until_s)
    both = np.hstack([tilt_of(of.q_lab_from_flu), turn_of(of.q_lab_from_flu, of.rate_flu_rad_s)])
    return held(of.t_s, both, at_s), at_s


def _modelled(parameters: Float, inputs: Float, at_s: Float, saw: Seen) -> Float:
    """The tilt (T, 2) that the parameters predict at the mocap's times; the trim turns with the heading."""
    target, lead = inputs[:, :2], inputs[:, 2:]
    answered = _answer(parameters, target + parameters[RATES] * lead, GRID_S)
    when = saw.t_s - parameters[DEAD]
    tilt: Float = np.stack([np.interp(when, at_s, answered[:, axis]) for axis in range(2)], axis=1)
    cos, sin = np.cos(saw.heading_rad), np.sin(saw.heading_rad)
    x, y = parameters[5], parameters[6]
    trim: Float = np.stack([cos * x - sin * y, sin * x + cos * y], axis=1)
    return tilt + trim


def _answer(parameters: Float, values: Float, step_s: float) -> Float:
    """The three lags' exact response to a signal held over each step, without the dead time."""
    p, r, motor = np.exp(parameters[:3])
    lags = np.array([motor / (p * r), 1.0 / (p * r), 1.0 / p, 1.0], dtype=np.float64)
    numerator, denominator, _ = cont2discrete((np.ones(1), lags), step_s, "zoh")
    answered: Float = lfilter(numerator.ravel(), denominator, values - values[0], axis=0) + values[0]
    return answered


def _meant(parameters: Float) -> Float:
    """Dead time, lag, P, R, T, d, and the lead as a fraction of 1/P."""
    p, r, motor = np.exp(parameters[:3])
    dead_s, lag_s = nearest_first_order(parameters)
    return np.array([dead_s, lag_s, p, r, motor, parameters[DEAD], parameters[RATES] * p])


def step(parameters: Float, t_s: Float) -> Float:
    """Response to a unit step at even times t_s (from 0), dead time included."""
    spacing = float(t_s[1] - t_s[0])
    answered = _answer(parameters, np.append(0.0, np.ones(len(t_s) - 1)), spacing)
    later: Float = np.interp(t_s - parameters[DEAD], t_s - spacing, answered, left=0.0)
    return later


def nearest_first_order(parameters: Float) -> tuple[float, float]:
    """(dead_time_s, lag_s) of the first-order response whose step is nearest, in squares, until it has settled."""
    length_s = 4.4 / float(np.exp(parameters[0]))  # so many 1/P
    t_s = np.linspace(0.0, length_s, 400)
    without_delay = parameters.copy()
    without_delay[DEAD] = 0.0
    (dead_s, lag_s), _ = curve_fit(first_order, t_s, step(without_delay, t_s), p0=(0.1 * length_s, 0.15 * length_s))
    return float(dead_s + parameters[DEAD]), float(lag_s)


def first_order(t_s: Float, dead_s: float, lag_s: float) -> Float:
    """Unit step response of a dead time and a first-order lag."""
    since = np.maximum(t_s - dead_s, 0.0)
    risen: Float = 1.0 - np.exp(-since / max(lag_s, 1e-6))
    return risen
