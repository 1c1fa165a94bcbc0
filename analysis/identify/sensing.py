"""The mocap as the ground met it: delay, pose noise of each body, and the latency of its stamps.

VRPN and QTM stamp frames with an unknown constant delay. The autopilot reports its own attitude, and TIMESYNC gives its
clock against the ground's. The time shift that best aligns the direction of gravity in both is that delay. Gravity in
body axes needs no heading. The marker frame's tilt on the body is a constant, which is fitted too.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from analysis.identify.signals import CONFIDENCE, UP, Estimate, about, covariance
from analysis.links import from_drones, from_ground
from analysis.load import Flight, Poses, Vehicle
from analysis.reading import IMPORTED
from analysis.tracking import airborne
from formation.maths import frames
from formation.maths.arrays import Bool, Float
from wire.clock_offset import ClockOffset
from wire.link_messages import Attitude, AttitudeQuaternion, MessageId, TimeSync

LEAST = 50
CLOCKS = frozenset({MessageId.TIMESYNC})
ATTITUDES = frozenset({MessageId.ATTITUDE, MessageId.ATTITUDE_QUATERNION})


@dataclass(frozen=True, slots=True)
class Noise:
    """Scatter of one body's pose, standard deviation an axis; attitude only where the body stood still."""

    body: str
    pos_m: Estimate | None
    attitude_rad: Estimate | None


@dataclass(frozen=True, slots=True)
class Sensing:
    """delay_s: capture, as stamped, to receipt by the ground, median; None where no ground received the poses."""

    delay_s: Estimate | None
    noise: tuple[Noise, ...]


def estimate_sensing(flight: Flight) -> Sensing | str:
    """The mocap's delay and noise, or why there is no estimate."""
    poses = flight.poses
    if len(poses) < LEAST:
        return "too few mocap frames"
    delay_s = np.sort(poses.received_s - poses.t_s)
    noise = tuple(
        _noise(vehicle.body, poses, index, ~airborne(flight, poses.t_s))
        for index, vehicle in enumerate(flight.vehicles)
    )
    return Sensing(None if IMPORTED in flight.run.metadata else _median(delay_s), noise)


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
    still = seen & grounded & (np.linalg.norm(poses.pos_lab_m[:, index] - start, axis=1) < 0.02)
    rotation = np.zeros((0, 3))
    if still.any():
        q = poses.q_lab_from_flu[still, index]
        rotation = 2.0 * frames.multiply(frames.inverse(q[0]), q)[:, 1:]
    return Noise(body, scatter(poses.t_s[seen], poses.pos_lab_m[seen, index]), scatter(poses.t_s[still], rotation))


def scatter(t_s: Float, values: Float) -> Estimate | None:
    """White-noise deviation of a smooth signal (T, d) at uneven times: how far each sample is from the cubic through
    the two before and the two after it. The median rejects jumps; None of too few samples.
    """
    others = np.array([-2, -1, 1, 2])
    if len(t_s) - 4 < LEAST:
        return None
    middle = np.arange(2, len(t_s) - 2)
    dt = t_s[middle[:, None] + others] - t_s[middle, None]
    weights = np.ones_like(dt)
    for i in range(len(others)):
        for j in range(len(others)):
            if i != j:
                weights[:, i] *= dt[:, j] / (dt[:, j] - dt[:, i])
    foretold = np.einsum("ki,kid->kd", weights, values[middle[:, None] + others])
    residuals = (values[middle] - foretold) / np.sqrt(1.0 + np.sum(np.square(weights), axis=1))[:, None]
    # Of a normal distribution; 1.17: the standard error of that estimate, over sigma / sqrt(samples).
    deviation = 1.4826 * float(np.median(np.abs(residuals)))
    error = CONFIDENCE * 1.17 * deviation / float(np.sqrt(residuals.size))
    return Estimate(deviation, deviation - error, deviation + error)


MOST_S = 0.1
"""No latency is longer, and nothing is interpolated between attitudes farther apart."""
ATTITUDES_LEAST = 200

Attitudes = tuple[Float, Float]


def attitudes_of(flight: Flight) -> dict[int, Attitudes]:
    """The attitudes that each drone reported, by sysid: times on the flight's clock, s (K,), and their `_up` (K, 2)."""
    sent_s = {
        (sysid, message.ts1_ns): t_s
        for t_s, sysid, message in from_ground(flight, CLOCKS)
        if isinstance(message, TimeSync) and message.tc1_ns == 0
    }
    offsets: dict[int, ClockOffset] = {}
    reported: dict[int, list[tuple[int, Float]]] = {}
    for t_s, sysid, message in from_drones(flight, CLOCKS | ATTITUDES):
        if isinstance(message, TimeSync) and (sysid, message.ts1_ns) in sent_s:
            asked_ns = round(1e9 * sent_s[sysid, message.ts1_ns])
            offsets.setdefault(sysid, ClockOffset()).exchange(asked_ns, message.tc1_ns, round(1e9 * t_s))
        elif isinstance(message, AttitudeQuaternion | Attitude):
            reported.setdefault(sysid, []).append((message.t_boot_ms, np.asarray(message.q_lab_from_flu)))
    return {sysid: _on_our_clock(reported[sysid], offset) for sysid, offset in offsets.items() if sysid in reported}


def logged_attitudes(flight: Flight, vehicle: Vehicle) -> Attitudes | None:
    """As `attitudes_of`, of another recorder's log: on the log's clock, as late as its columns are."""
    own = flight.signals.get((vehicle.body, "estimated_attitude"))
    return None if own is None else (own.t_s, _up(own.values))


def late(flight: Flight, vehicle: Vehicle, own: Attitudes | None) -> Estimate | str:
    """The latency, s, of one vehicle's poses, to be added to `mocap.latency_s`; or why there is no estimate."""
    if own is None or len(own[0]) < ATTITUDES_LEAST:
        return "the autopilot reported too few attitudes"
    index, poses = flight.vehicles.index(vehicle), flight.poses
    flown = poses.seen[:, index] & airborne(flight, poses.t_s)
    return _shift(poses.t_s[flown], _up(poses.q_lab_from_flu[flown, index]), *own, "it hardly leant")


def behind(flight: Flight, vehicle: Vehicle) -> Estimate | str:
    """How far the autopilot's own position is behind the cameras', s, both on the log's clock; or why not known."""
    own = flight.signals.get((vehicle.body, "estimated_position"))
    if own is None or len(own.t_s) < ATTITUDES_LEAST:
        return "the autopilot's own position is not in the log"
    index, poses = flight.vehicles.index(vehicle), flight.poses
    flown = poses.seen[:, index] & airborne(flight, poses.t_s)
    found = _shift(poses.t_s[flown], poses.pos_lab_m[flown, index, :2], own.t_s, own.values[:, :2], "it hardly moved")
    return found if isinstance(found, str) else Estimate(-found.value, -found.high, -found.low)


def _shift(t_s: Float, shown: Float, own_s: Float, own: Float, still: str) -> Estimate | str:
    """By how much what is shown (T, 2) comes later than the drone's own (K, 2); `still` where neither moves."""
    after = np.clip(np.searchsorted(own_s, t_s), 1, len(own_s) - 1)
    near = (own_s[after] - own_s[after - 1] < MOST_S) & (t_s > own_s[0] + MOST_S) & (t_s < own_s[-1] - MOST_S)
    t_s, shown = t_s[near], shown[near]
    if len(t_s) < ATTITUDES_LEAST or float(np.std(shown, axis=0).max()) < 5e-3:
        return still

    def residual(parameters: Float) -> Float:
        when = t_s - parameters[0]
        own_at = np.stack([np.interp(when, own_s, own[:, axis]) for axis in range(2)], axis=1)
        residuals: Float = (shown - own_at - parameters[1:]).T.ravel()
        return residuals

    start = np.concatenate([[0.0], np.median(shown, axis=0) - np.median(own, axis=0)])
    bounds = [-MOST_S, -np.inf, -np.inf], [MOST_S, np.inf, np.inf]
    found = least_squares(residual, start, bounds=bounds, diff_step=[1e-3] * 3, x_scale=[0.01] * 3)
    cov = covariance(np.asarray(found.jac), found.fun, np.tile(t_s, 2))
    return about(float(found.x[0]), float(np.sqrt(cov[0, 0])))


def _on_our_clock(reported: list[tuple[int, Float]], offset: ClockOffset) -> Attitudes:
    """Rising in time; a stamp that comes again is left out."""
    newest: dict[int, Float] = dict(reported)
    boot_ms = sorted(newest)
    times_s = np.array([1e-9 * (offset.to_ours_ns(1_000_000 * ms) or 0) for ms in boot_ms])
    return times_s, _up(np.array([newest[ms] for ms in boot_ms]))


def _up(q_lab_from_flu: Float) -> Float:
    """Up in the body's axes, x and y: (..., 2)."""
    return frames.rotate(frames.inverse(q_lab_from_flu), UP)[..., :2]
