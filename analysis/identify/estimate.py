"""Estimates with confidence intervals, from least-squares fits whose residuals may be correlated."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from formation.maths.arrays import Float

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
