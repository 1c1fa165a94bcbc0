"""Time series of logged messages: one topic's messages in order, as columns or one by one. No files."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from formation.maths import frames
from formation.maths.arrays import Bool, Float
from wire.columns import Column

M = TypeVar("M")
Index = NDArray[np.int64]
MIN_PARABOLA = 5
NEAR_S = 0.1
"""Between samples farther apart nothing is interpolated."""


@dataclass(frozen=True, slots=True, eq=False)
class Series(Generic[M]):
    """The few messages of one topic, ordered in time.

    t_s (T,): when each was logged, in seconds since the first record of the log.
    """

    t_s: Float
    messages: tuple[M, ...]

    def __len__(self) -> int:
        return len(self.messages)


@dataclass(frozen=True, slots=True, eq=False)
class Sampled:
    """What another recorder wrote of one quantity of `analysis.imports.maps`: t_s (T,), values (T, w) without a NaN."""

    t_s: Float
    values: Float

    def at(self, at_s: Float, attitude: bool = False) -> Float:
        """(K, w): interpolated; NaN where the neighbours are farther apart than NEAR_S, or there are not two."""
        after = np.clip(np.searchsorted(self.t_s, at_s), 1, len(self.t_s) - 1) if len(self.t_s) > 1 else None
        if after is None:
            return np.full((len(at_s), self.values.shape[1]), np.nan)
        near = (self.t_s[after] - self.t_s[after - 1] <= NEAR_S) & (at_s >= self.t_s[0]) & (at_s <= self.t_s[-1])
        if attitude:
            found = frames.interpolated(self.t_s, self.values, at_s)
        else:
            found = np.stack([np.interp(at_s, self.t_s, column) for column in self.values.T], axis=1)
        return np.where(near[:, None], found, np.nan)

    def held(self, at_s: Float, within_s: float = NEAR_S) -> Float:
        """(K, w): each value until the next, for as long as within_s; NaN else."""
        at = np.searchsorted(self.t_s, at_s, side="right") - 1
        found = self.values[np.maximum(at, 0)]
        return np.where(((at >= 0) & (at_s - self.t_s[at] <= within_s))[:, None], found, np.nan)


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """The many messages of one topic, ordered in time.

    t_s (T,): the time each message speaks of (capture time where it has one, else when it was logged), in seconds
    since the first record of the log.
    fields, order: the columns as they were logged, and the place there of each message.
    """

    t_s: Float
    fields: Mapping[str, Column]
    order: Index

    def __len__(self) -> int:
        return len(self.t_s)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """One field of every message (T, ...), numbers with a fraction as float64; of an empty series, (0,).

        KeyError where it is no field of the topic, or none that analysis reads from a file.
        """
        if not len(self):
            return np.zeros(0)
        values = self.fields[name].stack()[self.order]
        return values.astype(np.float64) if values.dtype.kind == "f" else values

    def where(self, mask: Bool) -> "Columns":
        """The messages whose flag in mask (T,) is set."""
        return replace(self, t_s=self.t_s[mask], order=self.order[mask])


def nearest(t_s: Float, wanted_s: Float) -> Index:
    """Indices into the sorted t_s (T >= 1) of the entries nearest to each wanted time."""
    right = np.clip(np.searchsorted(t_s, wanted_s), 0, len(t_s) - 1)
    left = np.maximum(right - 1, 0)
    closer_left = np.abs(t_s[left] - wanted_s) <= np.abs(t_s[right] - wanted_s)
    index: Index = np.where(closer_left, left, right).astype(np.int64)
    return index


def moving_average(t_s: Float, values: Float, window_s: float) -> Float:
    """Centred moving average over window_s, by the trapezoid rule on uneven times.

    Shapes (T,) and (T, ...). The window is cut at the ends of the data.
    """
    flat = values.reshape(len(t_s), -1)
    steps = 0.5 * (flat[1:] + flat[:-1]) * np.diff(t_s)[:, None]
    integral = np.vstack([np.zeros((1, flat.shape[1])), np.cumsum(steps, axis=0)])
    low = np.maximum(t_s - 0.5 * window_s, t_s[0])
    high = np.minimum(t_s + 0.5 * window_s, t_s[-1])
    span = np.maximum(high - low, 1e-12)
    means = [
        (_integral_at(t_s, i, f, high) - _integral_at(t_s, i, f, low)) / span
        for i, f in zip(integral.T, flat.T, strict=True)
    ]
    return np.column_stack(means).reshape(values.shape)


def _integral_at(t_s: Float, integral: Float, values: Float, at_s: Float) -> Float:
    """The integral of the piecewise-linear signal up to at_s, all (T,)."""
    k = np.clip(np.searchsorted(t_s, at_s, side="right") - 1, 0, len(t_s) - 2)
    dt = at_s - t_s[k]
    slope = (values[k + 1] - values[k]) / np.maximum(t_s[k + 1] - t_s[k], 1e-12)
    result: Float = integral[k] + values[k] * dt + 0.5 * slope * dt * dt
    return result


def smoothed(t_s: Float, values: Float, window_s: float, mask: Bool) -> Float:
    """Each value of (T,) replaced by that of the parabola fitted through the kept ones within window_s about it.

    Centred, so it lags nothing; uneven times are honoured. Where fewer than five are kept, the value stays as it is.
    """
    if len(t_s) < MIN_PARABOLA:
        return values
    reach = int(min(np.ceil(0.5 * window_s / max(float(np.median(np.diff(t_s))), 1e-9)), 500))
    index = np.arange(len(t_s))[:, None] + np.arange(-reach, reach + 1)
    inside = np.clip(index, 0, len(t_s) - 1)
    dt = (t_s[inside] - t_s[:, None]) / window_s
    weight = (index == inside) & mask[inside] & (np.abs(dt) <= 0.5)
    powers = dt[..., None] ** np.arange(3)
    normal = np.einsum("tk,tki,tkj->tij", weight, powers, powers)
    enough = weight.sum(axis=1) >= MIN_PARABOLA
    normal[~enough] = np.eye(3)
    right = np.einsum("tk,tki,tk->ti", weight, powers, values[inside] - values[:, None])
    fitted = values + np.linalg.solve(normal, right[..., None])[:, 0, 0]
    return np.where(enough, fitted, values)
