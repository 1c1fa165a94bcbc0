"""The acceleration that a vehicle's model does not explain, found in its recorded positions from both sides in time.

An observer runs forward (a Kalman filter of position, velocity and disturbance, the disturbance a random walk), and a
smoother back over it (Rauch, Tung, Striebel 1965). The observer of the flight knows the past alone and lags; this one
does not. How fast the disturbance may change is chosen by the likelihood of the innovations.
"""

from dataclasses import dataclass

import numpy as np

from formation.maths.arrays import Bool, Float

WALKS = 10.0 ** np.arange(-3.0, 5.1, 0.5)
"""The densities of the disturbance's random walk that are tried, m^2/s^5."""
VAGUE = np.diag([1.0, 100.0, 100.0])
"""Variances of position, velocity and disturbance before anything was seen."""


@dataclass(frozen=True, slots=True, eq=False)
class Smoothed:
    """S series at T times. pos_m, vel_m_s, dist_m_s2 (S, T); known_hz (S): up to there the disturbance is known: its
    own spectrum is above that of the measurement's noise."""

    pos_m: Float
    vel_m_s: Float
    dist_m_s2: Float
    known_hz: Float


def smooth(t_s: Float, pos_m: Float, seen: Bool, acc_m_s2: Float, noise_m: Float) -> Smoothed:
    """Position, velocity and disturbance of S independent series.

    t_s (T); pos_m (S, T), of which those count that are seen (S, T); acc_m_s2 (S, T - 1): mean of what the model
    explains from each time to the next; noise_m (S): standard deviation of a position.
    """
    steps = _steps(t_s)
    series, tried = len(pos_m), len(WALKS)

    each = np.repeat(np.arange(series), tried)
    walks = np.tile(WALKS, series)
    forward = _forward(steps, pos_m[each], seen[each], acc_m_s2[each], walks, noise_m[each])
    best = WALKS[np.argmax(forward.likelihood.reshape(series, tried), axis=1)]
    x = _backward(steps, _forward(steps, pos_m, seen, acc_m_s2, best, noise_m))
    spacing_s = float(np.median(np.diff(t_s)))
    known_hz = (best / (np.square(noise_m) * spacing_s)) ** (1.0 / 6.0) / (2.0 * np.pi)
    return Smoothed(x[:, :, 0].T, x[:, :, 1].T, x[:, :, 2].T, known_hz)


@dataclass(frozen=True, slots=True, eq=False)
class _Steps:
    """dt_s (T - 1); move, walk (T - 1, 3, 3): the transition, and the covariance that a unit walk adds to it."""

    dt_s: Float
    move: Float
    walk: Float


@dataclass(frozen=True, slots=True, eq=False)
class _Forward:
    """The filter of S series: means (T, S, 3) and covariances (T, S, 3, 3), before and after each measurement."""

    likelihood: Float
    before: Float
    before_cov: Float
    after: Float
    after_cov: Float


def _steps(t_s: Float) -> _Steps:
    dt = np.diff(t_s)
    one, no = np.ones_like(dt), np.zeros_like(dt)
    move = np.array([[one, dt, dt**2 / 2.0], [no, one, dt], [no, no, one]])
    walk = np.array(
        [
            [dt**5 / 20.0, dt**4 / 8.0, dt**3 / 6.0],
            [dt**4 / 8.0, dt**3 / 3.0, dt**2 / 2.0],
            [dt**3 / 6.0, dt**2 / 2.0, dt],
        ]
    )
    return _Steps(dt, np.moveaxis(move, 2, 0), np.moveaxis(walk, 2, 0))


def _forward(steps: _Steps, pos_m: Float, seen: Bool, acc_m_s2: Float, walks: Float, noise_m: Float) -> _Forward:
    count, times = pos_m.shape
    noise = np.square(noise_m)
    x, cov = np.zeros((count, 3)), np.tile(VAGUE, (count, 1, 1))
    x[:, 0] = pos_m[np.arange(count), np.argmax(seen, axis=1)]
    before, before_cov = np.empty((times, count, 3)), np.empty((times, count, 3, 3))
    after, after_cov = np.empty_like(before), np.empty_like(before_cov)
    likelihood = np.zeros(count)
    for k in range(times):
        if k > 0:
            dt, move = steps.dt_s[k - 1], steps.move[k - 1]
            x = x @ move.T
            x[:, 0] += 0.5 * dt * dt * acc_m_s2[:, k - 1]
            x[:, 1] += dt * acc_m_s2[:, k - 1]
            cov = move @ cov @ move.T + walks[:, None, None] * steps.walk[k - 1]
        before[k], before_cov[k] = x, cov
        variance = cov[:, 0, 0] + noise
        innovation = pos_m[:, k] - x[:, 0]
        gain = np.where(seen[:, k, None], cov[:, :, 0] / variance[:, None], 0.0)
        x = x + gain * innovation[:, None]
        cov = cov - gain[:, :, None] * cov[:, None, 0]
        likelihood -= np.where(seen[:, k], innovation**2 / variance + np.log(variance), 0.0)
        after[k], after_cov[k] = x, cov
    return _Forward(likelihood, before, before_cov, after, after_cov)


def _backward(steps: _Steps, forward: _Forward) -> Float:
    """The smoothed means (T, S, 3)."""
    gain = np.linalg.solve(forward.before_cov[1:], steps.move[:, None] @ forward.after_cov[:-1])
    x = forward.after.copy()
    for k in range(len(x) - 2, -1, -1):
        x[k] += np.einsum("sji,sj->si", gain[k], x[k + 1] - forward.before[k + 1])
    return x
