"""Time series of logged messages: one topic's messages in order, with columns read off as arrays. No files."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from formation.maths.arrays import Bool, Float

M = TypeVar("M")
Index = NDArray[np.int64]
MIN_PARABOLA, MOST_REACHED = 5, 500


@dataclass(frozen=True, slots=True, eq=False)
class Series(Generic[M]):
    """The messages of one topic, ordered in time.

    t_s (T,): the time each message speaks of (capture time where it has one, else when it was logged);
    logged_s (T,): when it was logged; both in seconds since the first record of the log.
    """

    t_s: Float
    logged_s: Float
    messages: tuple[M, ...]

    def __len__(self) -> int:
        return len(self.messages)

    def column(self, field: Callable[[M], ArrayLike]) -> Float:
        """One field of every message as float64, shape (T, ...); of an empty series, (0,)."""
        return np.array([field(message) for message in self.messages], dtype=np.float64)

    def where(self, mask: Bool) -> "Series[M]":
        """The messages whose flag in mask (T,) is set."""
        return Series(
            self.t_s[mask],
            self.logged_s[mask],
            tuple(m for m, flag in zip(self.messages, mask, strict=True) if flag),
        )


def series(stamped: list[tuple[float, float, M]]) -> Series[M]:
    """A series of (t_s, logged_s, message), sorted by the first; equal times keep their order."""
    ordered = sorted(stamped, key=lambda entry: entry[0])
    times = np.array([entry[:2] for entry in ordered], dtype=np.float64).reshape(-1, 2)
    return Series(times[:, 0], times[:, 1], tuple(message for _, _, message in ordered))


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
    reach = int(min(np.ceil(0.5 * window_s / max(float(np.median(np.diff(t_s))), 1e-9)), MOST_REACHED))
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
