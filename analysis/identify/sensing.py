"""The mocap as the ground met it: delay, rhythm, pose noise of each body."""

from dataclasses import dataclass

import numpy as np

from analysis.identify.estimate import CONFIDENCE, Estimate
from analysis.load import Flight, Poses
from analysis.tracking import airborne
from formation.maths import frames
from formation.maths.arrays import Bool, Float

MAD_TO_DEVIATION = 1.4826  # of a normal distribution
MAD_COST = 1.17  # standard error of that estimate, over sigma / sqrt(samples)
LEAST = 50
REACH = 2  # frames on either side that foretell a frame
STILL_M = 0.02


@dataclass(frozen=True, slots=True)
class Noise:
    """Scatter of one body's pose, standard deviation an axis; attitude only where the body stood still."""

    body: str
    pos_m: Estimate | None
    attitude_rad: Estimate | None


@dataclass(frozen=True, slots=True)
class Sensing:
    """delay_s: capture, as stamped, to receipt by the ground, median; late_s: its 99th percentile."""

    delay_s: Estimate
    late_s: float
    rate_hz: float
    noise: tuple[Noise, ...]


def estimate_sensing(flight: Flight) -> Sensing | str:
    """The mocap's rate, delay and noise, or why there is no estimate."""
    poses = flight.poses
    if len(poses) < LEAST:
        return "too few mocap frames"
    delay_s = np.sort(poses.received_s - poses.t_s)
    noise = tuple(
        _noise(vehicle.body, poses, index, ~airborne(flight, poses.t_s))
        for index, vehicle in enumerate(flight.vehicles)
    )
    spacing_s = float(np.median(np.diff(poses.t_s)))
    return Sensing(_median(delay_s), float(np.percentile(delay_s, 99.0)), 1.0 / spacing_s, noise)


def _median(ordered: Float) -> Estimate:
    """The median of sorted values and its interval by order statistics."""
    n = len(ordered)
    reach = CONFIDENCE * 0.5 * np.sqrt(n)
    low, high = max(int(n / 2 - reach), 0), min(int(np.ceil(n / 2 + reach)), n - 1)
    return Estimate(float(np.median(ordered)), float(ordered[low]), float(ordered[high]))


def _noise(body: str, poses: Poses, index: int, grounded: Bool) -> Noise:
    """Noise of one body: positions from the whole flight, attitude from where it stood."""
    seen = poses.seen[:, index]
    start = poses.pos_lab_m[np.argmax(seen), index]
    still = seen & grounded & (np.linalg.norm(poses.pos_lab_m[:, index] - start, axis=1) < STILL_M)
    rotation = np.zeros((0, 3))
    if still.any():
        q = poses.q_lab_from_flu[still, index]
        rotation = 2.0 * frames.multiply(frames.inverse(q[0]), q)[:, 1:]
    return Noise(body, scatter(poses.t_s[seen], poses.pos_lab_m[seen, index]), scatter(poses.t_s[still], rotation))


def scatter(t_s: Float, values: Float) -> Estimate | None:
    """White-noise deviation of a smooth signal (T, d) at uneven times: how far each sample is from the cubic through
    the two before and the two after it. The median rejects jumps; None of too few samples.
    """
    count = len(t_s) - 2 * REACH
    if count < LEAST:
        return None
    middle = np.arange(REACH, len(t_s) - REACH)
    others = np.array([-2, -1, 1, 2])
    dt = t_s[middle[:, None] + others] - t_s[middle, None]
    weights = np.ones_like(dt)
    for i in range(len(others)):
        for j in range(len(others)):
            if i != j:
                weights[:, i] *= dt[:, j] / (dt[:, j] - dt[:, i])
    foretold = np.einsum("ki,kid->kd", weights, values[middle[:, None] + others])
    residuals = (values[middle] - foretold) / np.sqrt(1.0 + np.sum(np.square(weights), axis=1))[:, None]
    deviation = MAD_TO_DEVIATION * float(np.median(np.abs(residuals)))
    error = CONFIDENCE * MAD_COST * deviation / float(np.sqrt(residuals.size))
    return Estimate(deviation, deviation - error, deviation + error)
