"""The one way this project compiles a loop: numba, cached on disk, IEEE arithmetic (no fastmath)."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar

import numba

P = ParamSpec("P")
R = TypeVar("R")


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """The compiled form of a function of floats, ints and float64 arrays; division follows IEEE, never raises."""
    compiled: Callable[P, R] = numba.njit(cache=True, error_model="numpy")(function)
    return compiled
