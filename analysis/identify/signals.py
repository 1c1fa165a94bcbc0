"""What was sent to one drone and what the mocap then saw of it; estimates from fits, with confidence intervals."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from analysis.load import Flight, Vehicle
from analysis.tracking import airborne
from formation.maths import frames
from formation.maths.arrays import Bool, Float
from wire.mavlink.frames import setpoints

CONFIDENCE = 1.96  # standard deviations of a 95 % interval
BLOCK_S = 1.0  # residuals further apart than this are taken as independent


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value and its 95 % confidence interval."""

    value: float
    low: float
    high: float

    @property
    def half_width(self) -> float:
        """Half the interval."""
        return 0.5 * (self.high - self.low)

    @property
    def share(self) -> float:
        """Half the interval, as a share of the value."""
        return self.half_width / abs(self.value) if self.value else np.inf

    def scaled(self, factor: float) -> "Estimate":
        """The same in another unit; factor > 0."""
        return Estimate(factor * self.value, factor * self.low, factor * self.high)


def about(value: float, deviation: float) -> Estimate:
    """The estimate of that value with that standard deviation."""
    reach = CONFIDENCE * deviation
    return Estimate(float(value), float(value - reach), float(value + reach))


def covariance(jacobian: Float, residual: Float, t_s: Float) -> Float:
    """Covariance (p, p) of a least-squares solution, robust to residuals correlated within BLOCK_S.

    jacobian (N, p), residual (N), t_s (N). The cluster-robust sandwich of Liang and Zeger (1986), a block a cluster.
    """
    bread = np.linalg.pinv(jacobian.T @ jacobian)
    block = np.unique(np.floor(t_s / BLOCK_S), return_inverse=True)[1]
    blocks, parameters = int(block.max()) + 1, jacobian.shape[1]
    scores = np.zeros((blocks, parameters))
    np.add.at(scores, block, jacobian * residual[:, None])
    correction = blocks / max(blocks - parameters, 1)
    result: Float = correction * bread @ (scores.T @ scores) @ bread
    return result


def propagated(function: Callable[[Float], Float], at: Float, covariance_of: Float) -> tuple[Estimate, ...]:
    """What a smooth function (p) -> (k) of uncertain parameters gives, by the delta method."""
    value = function(at)
    steps = np.maximum(1e-5 * np.abs(at), 1e-7)
    columns = [(function(at + h * e) - value) / h for h, e in zip(steps, np.eye(len(at)), strict=True)]
    slope = np.stack(columns, axis=1)
    deviation = np.sqrt(np.maximum(np.diag(slope @ covariance_of @ slope.T), 0.0))
    return tuple(about(float(v), float(s)) for v, s in zip(value, deviation, strict=True))


GRID_S = 0.002
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class Sent:
    """Every attitude target sent to one drone, at t_s (S,): (S, 4), (S, 3) and (S,) as in AttitudeSetpoint."""

    t_s: Float
    q_lab_from_flu: Float
    rate_flu_rad_s: Float
    thrust_norm: Float


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """One drone's measured motion in free flight: tilt, xy_lab_m (T, 2), all else (T,).

    tilt: the horizontal part of the body's up axis in lab axes; for small angles in radians. xy_lab_m: x and y.
    """

    t_s: Float
    height_m: Float
    tilt: Float
    cos_tilt: Float
    heading_rad: Float
    xy_lab_m: Float


def sent(flight: Flight) -> dict[int, Sent]:
    """The targets of every drone, by system id; those that another recorder wrote where none crossed a link."""
    if not len(flight.down) and len(flight.target):
        return _recorded(flight)
    every = setpoints(flight.down.frames, flight.down.sysid)
    t_s, sysids = flight.down.t_s[every.datagram], flight.down.sysid[every.datagram]
    columns = t_s, every.q_lab_from_flu, every.rate_flu_rad_s, every.thrust_norm
    return {sysid: Sent(*(column[sysids == sysid] for column in columns)) for sysid in np.unique(sysids).tolist()}


def _recorded(flight: Flight) -> dict[int, Sent]:
    """The targets of the log's own channel, of which each vehicle has those that are there."""
    found = dict[int, Sent]()
    for vehicle in flight.vehicles:
        if vehicle.sysid is None or vehicle.column is None:
            continue
        names = ("q_lab_from_flu", "rate_flu_rad_s", "thrust_norm")
        q, rates, thrust = (flight.target[name][:, vehicle.column] for name in names)
        is_there = np.isfinite(q).all(axis=1)
        if is_there.any():
            no_rates = np.nan_to_num(rates[is_there])  # none sent is no lead
            found[vehicle.sysid] = Sent(flight.target.t_s[is_there], q[is_there], no_rates, thrust[is_there])
    return found


def seen(flight: Flight, vehicle: Vehicle) -> Seen:
    """One drone's free flight: airborne, seen, clear of the place it stood on."""
    index, poses = flight.vehicles.index(vehicle), flight.poses
    z = poses.pos_lab_m[:, index, 2]
    visible = poses.seen[:, index]
    floor_m = float(z[visible].min()) if visible.any() else 0.0
    free: Bool = visible & airborne(flight, poses.t_s) & (z > floor_m + 0.1)
    q = poses.q_lab_from_flu[free, index]
    up = frames.rotate(q, UP)
    return Seen(
        poses.t_s[free], z[free], up[:, :2], up[:, 2], np.unwrap(frames.yaw(q)), poses.pos_lab_m[free, index, :2]
    )


def tilt_of(q_lab_from_flu: Float) -> Float:
    """Horizontal part of the body's up axis, lab axes, shape (..., 2)."""
    return frames.rotate(q_lab_from_flu, UP)[..., :2]


def turn_of(q_lab_from_flu: Float, rate_flu_rad_s: Float) -> Float:
    """The rate of that tilt by body rates: R (rate x up), horizontal part, 1/s, shape (..., 2)."""
    return frames.rotate(q_lab_from_flu, np.cross(rate_flu_rad_s, UP))[..., :2]


def grid(of: Sent, until_s: float) -> Float:
    """Even times from the first target to until_s."""
    return np.arange(of.t_s[0], max(until_s, of.t_s[0]) + GRID_S, GRID_S)


def held(t_s: Float, values: Float, at_s: Float) -> Float:
    """A signal (S, ...) held from each t_s to the next, averaged over every cell of the even grid at_s (G,): (G, ...).

    The average, not a sample: so no target's time is rounded to the grid.
    """
    step = at_s[1] - at_s[0]
    edges = np.append(at_s, at_s[-1] + step)
    flat = values.reshape(len(t_s), -1)
    swept = np.vstack([np.zeros((1, flat.shape[1])), np.cumsum(flat[:-1] * np.diff(t_s)[:, None], axis=0)])
    index = np.clip(np.searchsorted(t_s, edges, side="right") - 1, 0, len(t_s) - 1)
    integral = swept[index] + flat[index] * (edges - t_s[index])[:, None]
    means: Float = np.diff(integral, axis=0) / step
    return means.reshape(len(at_s), *values.shape[1:])
