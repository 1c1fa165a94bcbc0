"""Neighbours among many points without a look at every pair: points in order along an axis, looked at by stretches."""

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Bool, Float
from formation.maths.copying import copy_into
from formation.maths.kernel import kernel

Index = NDArray[np.int64]


@kernel
def widest_axis(points: Float, chosen: Bool, axes: int) -> int:
    """Along which of the first axes the chosen points (n, 3) extend farthest: there a stretch holds the fewest."""
    widest, extent = 0, -1.0
    for axis in range(axes):
        low, high = np.inf, -np.inf
        for i in range(len(points)):
            if chosen[i]:
                low, high = min(low, points[i, axis]), max(high, points[i, axis])
        if high - low > extent:
            widest, extent = axis, high - low
    return widest


@kernel
def ascending(values: Float, chosen: Bool) -> Index:
    """The chosen indices by ascending value, those of equal values by index: a merge sort, from single ones upwards."""
    order, count = np.empty(len(values), np.int64), 0
    for i in range(len(values)):
        if chosen[i]:
            order[count] = i
            count += 1
    merged, width = np.empty(count, np.int64), 1
    while width < count:
        for begin in range(0, count, 2 * width):
            middle, end = min(begin + width, count), min(begin + 2 * width, count)
            left, right = begin, middle
            for k in range(begin, end):
                from_left = right >= end or (left < middle and values[order[left]] <= values[order[right]])
                merged[k] = order[left] if from_left else order[right]
                left, right = left + from_left, right + (not from_left)
        copy_into(merged, order[:count])
        width *= 2
    return order[:count]
