"""An autopilot's clock against a flight's: by TIMESYNC as the flight logged it, else by the motion itself.

The motion: turns over WINDOW_S, of the cameras' attitudes and of the integrated gyros. They are the same turns, but for
the cameras' noise, the gyros' bias, how the markers sit on the body, and the clock. White noise of attitudes costs
least where the window is long, a gyro's drift where it is short.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import correlate

from analysis.identify.signals import BLOCK_S, Estimate, about, covariance
from analysis.series import NEAR_S, Sampled
from formation.maths import frames
from formation.maths.arrays import Bool, Float
from wire.logs.mcap_scan import LogError

WINDOW_S = 1.0
GRID_S, TURN_S = 0.02, 0.2
"""Of the search over all offsets: its steps, and over how long a turn is measured."""
LEAST_S = 10.0
"""Less of common motion says nothing of a clock."""
CANDIDATES = 5
WITHIN_S = 2e-3
"""An offset that is not known so well is none: it is what a joined log is asked for."""
ODDS = 10.0
"""Logarithm of the odds against the second best offset, where the motion repeats itself."""
PAIRS_MOST = 20_000
STEP_S, ROUNDS = 1e-3, 8
OUTLIER = 6.0
"""In standard deviations."""
FLOOR = 0.05
"""Share of the quickest round trip by which two as quick as it may differ from way to way."""


@dataclass(frozen=True, slots=True)
class Alignment:
    """t_flight = t_own - offset - drift * (t_own - middle_s), s. by: TIMESYNC or the motion."""

    by: str
    middle_s: float
    offset_s: Estimate
    drift: Estimate

    def flight_s(self, own_s: Float) -> Float:
        """Times of the autopilot's clock on the flight's."""
        result: Float = own_s - self.offset_s.value - self.drift.value * (own_s - self.middle_s)
        return result

    @property
    def text(self) -> str:
        """In one line."""
        o, d = self.offset_s.scaled(1e3), self.drift.scaled(1e6)
        offset = f"offset {o.value:.3f} ms (± {o.half_width:.3f})"
        return f"by {self.by}: {offset}, drift {d.value:.2f} ppm (± {d.half_width:.2f})"


def by_exchanges(asked_s: Float, theirs_s: Float, answered_s: Float) -> Alignment | None:
    """By TIMESYNC: when asked and answered on the flight's clock, and the autopilot's time between, all (N,), s.

    None where there are too few, or their clock was set. The offset is known within half a round trip.
    """
    trip_s = answered_s - asked_s
    if len(trip_s) < 3 or trip_s.min() < 0.0:
        return None
    if np.ptp(theirs_s) < LEAST_S:
        return None
    # What a trip takes longer than the quickest was spent on one way of the two: so far its offset may be off.
    weight = 1.0 / (trip_s - (1.0 - FLOOR) * trip_s.min())
    offset_s, middle_s = theirs_s - 0.5 * (asked_s + answered_s), float(np.average(theirs_s, weights=weight**2))
    regressors = np.stack([np.ones(len(theirs_s)), theirs_s - middle_s], axis=1)
    solution = np.linalg.lstsq(regressors * weight[:, None], offset_s * weight, rcond=None)[0]
    residual = offset_s - regressors @ solution
    if (np.abs(residual) > trip_s).any():
        return None
    cov = np.linalg.inv((regressors * weight[:, None]).T @ (regressors * weight[:, None]))
    cov = cov * float(np.sum((residual * weight) ** 2)) / (len(theirs_s) - 2)
    half_s, value = 0.5 * float(trip_s.min()), float(solution[0])
    return Alignment("TIMESYNC", middle_s, Estimate(value, value - half_s, value + half_s),
                     about(float(solution[1]), float(np.sqrt(cov[1, 1]))))  # fmt: skip


def by_motion(t_s: Float, q: Float, gyro: Sampled) -> Alignment:
    """By the turns that both saw: the cameras' q (T, 4) at t_s (T,), and the gyros. LogError."""
    turned = _integrated(gyro)
    if len(t_s) < 3 or t_s[-1] - t_s[0] < LEAST_S or gyro.t_s[-1] - gyro.t_s[0] < LEAST_S:
        raise LogError(f"the motion says nothing of its clock: less than {LEAST_S:g} s of poses or of gyros")
    fits = [fit for guess_s in _candidates(t_s, q, turned) if (fit := _fitted(t_s, q, turned, guess_s)) is not None]
    if not fits:
        raise LogError("the motion says nothing of its clock: poses and gyros have no turns in common")
    best = min(fits, key=lambda fit: fit.rms_rad)
    others = [f for f in fits if abs(f.alignment.offset_s.value - best.alignment.offset_s.value) > TURN_S]
    second = min((f.rms_rad for f in others), default=np.inf)
    offset_s = best.alignment.offset_s
    if best.blocks * np.log(second / best.rms_rad) < ODDS:
        raise LogError("the motion says nothing of its clock: it repeats itself, and fits at several offsets")
    if not offset_s.half_width <= WITHIN_S:
        known = f"{1e3 * offset_s.half_width:.1f} ms, {1e3 * WITHIN_S:g} ms are needed"
        raise LogError(f"the motion says too little of its clock: the offset is known within {known}; fly more lively")
    return best.alignment


def _integrated(gyro: Sampled) -> Sampled:
    """The gyros' attitudes, from the first sample on; a gap is a fresh beginning, by which no turn is measured."""
    dt_s = np.diff(gyro.t_s)[:, None]
    steps = frames.from_rotation_vector(0.5 * (gyro.values[1:] + gyro.values[:-1]) * dt_s)
    q = np.concatenate([frames.IDENTITY[None], steps])
    reach = 1
    while reach < len(q):  # products of twice as many with every round
        q[reach:] = frames.multiply(q[:-reach], q[reach:])
        reach *= 2
    return Sampled(gyro.t_s, frames.canonical(q))


def _turns(of: Sampled, from_s: Float, to_s: Float) -> Float:
    """Rotation vectors, body axes, (K, 3); NaN where a sample is missing."""
    return frames.rotation_vector(
        frames.multiply(frames.inverse(of.at(from_s, attitude=True)), of.at(to_s, attitude=True))
    )


def _candidates(t_s: Float, q: Float, turned: Sampled) -> list[float]:
    """Offsets, own clock less the flight's, at which the speeds of turning go together best."""
    series = []
    for of in (Sampled(t_s, q), turned):
        at_s = np.arange(of.t_s[0], of.t_s[-1] - TURN_S, GRID_S)
        speed = np.linalg.norm(_turns(of, at_s, at_s + TURN_S), axis=1)
        series.append((np.nan_to_num(speed), np.isfinite(speed).astype(np.float64)))
    (a, has_a), (b, has_b) = series

    def lagged(x: Float, y: Float) -> Float:
        result: Float = correlate(y, x, mode="full", method="fft")
        return result

    count = np.maximum(lagged(has_a, has_b), 1.0)
    sum_a, sum_b = lagged(a, has_b), lagged(has_a, b)
    var_a = lagged(a * a, has_b) - sum_a**2 / count
    var_b = lagged(has_a, b * b) - sum_b**2 / count
    scale = np.sqrt(np.maximum(var_a, 1e-9) * np.maximum(var_b, 1e-9))
    alike = np.where(count * GRID_S >= LEAST_S, (lagged(a, b) - sum_a * sum_b / count) / scale, -1.0)
    begins_s = float(turned.t_s[0] - t_s[0])
    found = list[float]()
    spacing = round(1.0 / GRID_S)
    for _ in range(CANDIDATES):
        k = int(np.argmax(alike))
        if alike[k] <= 0.0:
            break
        found.append(begins_s + (k - (len(a) - 1)) * GRID_S)
        alike[max(k - spacing, 0) : k + spacing] = -1.0
    return found


@dataclass(frozen=True, slots=True)
class _Fit:
    alignment: Alignment
    rms_rad: float
    blocks: int


def _fitted(t_s: Float, q: Float, turned: Sampled, guess_s: float) -> _Fit | None:
    """Offset, drift, bias of the gyros and tilt of the markers, by least squares; None where too little is common."""
    until = np.searchsorted(t_s, t_s + WINDOW_S)
    first = np.flatnonzero(until < len(t_s))
    first = first[:: len(first) // PAIRS_MOST + 1]
    from_s, to_s = t_s[first], t_s[until[first]]
    seen = frames.rotation_vector(frames.multiply(frames.inverse(q[first]), q[until[first]]))
    usual = to_s - from_s < WINDOW_S + NEAR_S
    middle_s, parameters = float(t_s.mean()), np.zeros(8)
    parameters[0] = guess_s
    good: Bool = usual
    for round_ in range(ROUNDS):
        own_from_s, own_to_s = (x + parameters[0] + parameters[1] * (x - middle_s) for x in (from_s, to_s))
        turn = _turns(turned, own_from_s, own_to_s)
        slope = (_turns(turned, own_from_s + STEP_S, own_to_s + STEP_S) - turn) / STEP_S
        lever = np.stack([np.cross(axis, turn) for axis in np.eye(3)], axis=2)
        bias = np.broadcast_to(np.eye(3), (len(turn), 3, 3)) * (to_s - from_s)[:, None, None]
        drift = slope * (from_s - middle_s)[:, None]
        jacobian = np.concatenate([slope[..., None], drift[..., None], lever, bias], axis=2)
        left = seen - turn - np.einsum("kij,j->ki", jacobian[..., 2:], parameters[2:])
        there = usual & np.isfinite(left).all(axis=1) & np.isfinite(jacobian).all(axis=(1, 2))
        if there.sum() < 50 or np.ptp(from_s[there]) < LEAST_S:
            return None
        size = np.linalg.norm(left, axis=1)
        good = there if round_ < ROUNDS // 2 else there & (size < OUTLIER * float(np.median(size[there])))
        rows = jacobian[good].reshape(-1, 8)
        step = np.linalg.lstsq(rows, left[good].ravel(), rcond=None)[0]
        step[0] = np.clip(step[0], -TURN_S / 2, TURN_S / 2)
        parameters = parameters + step
    rms_rad = float(np.sqrt(np.mean(left[good] ** 2)))
    if rms_rad > 0.5 * float(np.sqrt(np.mean(seen[good] ** 2))):
        return None
    # Turns over a window are alike within it: blocks of several windows are independent.
    cov = covariance(rows, left[good].ravel(), np.repeat(from_s[good], 3) * BLOCK_S / (4.0 * WINDOW_S))
    offset, rate = (about(float(parameters[k]), float(np.sqrt(cov[k, k]))) for k in range(2))
    aligned = Alignment("the motion", middle_s + offset.value, offset, rate)
    return _Fit(aligned, rms_rad, int(np.ptp(from_s[good]) / (4.0 * WINDOW_S)) + 1)
