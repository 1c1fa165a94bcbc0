"""Who gets what so that the sum of costs is least: a column for each row of a square matrix.

Crouse, *On implementing 2D rectangular assignment algorithms*, IEEE Transactions on Aerospace and Electronic Systems
52(4), 2016: shortest augmenting paths. SciPy's linear_sum_assignment chooses the same columns, ties included; to import
it takes half a second of every start.
"""

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Float
from formation.maths.kernel import kernel

NOBODY = -1
Ints = NDArray[np.int64]


def assignment(cost: Float) -> Ints:
    """The column of each row (n) of costs (n, n); ValueError where one is not finite."""
    if not np.isfinite(cost).all():
        raise ValueError("a cost is not finite")
    return _columns(cost)


@kernel
def _columns(cost: Float) -> Ints:
    n = len(cost)
    row_price, column_price = np.zeros(n), np.zeros(n)
    column_of, row_of = np.full(n, NOBODY), np.full(n, NOBODY)
    for row in range(n):
        _assign(row, cost, row_price, column_price, column_of, row_of)
    return column_of


@kernel
def _assign(row: int, cost: Float, row_price: Float, column_price: Float, column_of: Ints, row_of: Ints) -> None:
    """Give one more row a column: along the cheapest path on which others hand theirs on."""
    n = len(cost)
    came_from, left = np.full(n, NOBODY), np.arange(n - 1, -1, -1)
    path_cost, is_row_seen, is_column_seen = np.full(n, np.inf), np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    at, least, end, count = row, 0.0, NOBODY, n
    while end == NOBODY:
        is_row_seen[at] = True
        lowest, best = np.inf, NOBODY
        for k in range(count):
            column = left[k]
            reached = least + cost[at, column] - row_price[at] - column_price[column]
            if reached < path_cost[column]:
                came_from[column], path_cost[column] = at, reached
            is_free = row_of[column] == NOBODY
            if path_cost[column] < lowest or (path_cost[column] == lowest and is_free):
                lowest, best = path_cost[column], k
        least, column, count = lowest, left[best], count - 1
        is_column_seen[column] = True
        left[best] = left[count]
        if row_of[column] == NOBODY:
            end = column
        else:
            at = row_of[column]
    row_price[row] += least
    for i in range(n):
        if is_row_seen[i] and i != row:
            row_price[i] += least - path_cost[column_of[i]]
        if is_column_seen[i]:
            column_price[i] -= least - path_cost[i]
    column, holder = end, NOBODY
    while holder != row:
        holder = came_from[column]
        row_of[column] = holder
        column_of[holder], column = column, column_of[holder]
