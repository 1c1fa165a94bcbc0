"""The one way this project compiles a loop: numba, cached on disk, IEEE arithmetic (no fastmath)."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import ParamSpec, TypeVar

import numba
from numba.extending import register_jitable

P = ParamSpec("P")
R = TypeVar("R")


def kernel(function: Callable[P, R], calls: tuple[Callable[..., object], ...] = ()) -> Callable[P, R]:
    """The compiled form of a function of floats, ints and float64 arrays; division follows IEEE, never raises.

    calls: plain functions that it calls, directly or not, which are compiled with it and stay plain elsewhere.
    numba looks only at a kernel's own file to decide whether its cached machine code is still good, although
    kernels of other files are compiled into it. The stamp is widened to all of `formation`, whose kernels are
    the ones that others call, so that an edit is never answered by yesterday's code.
    """
    for part in calls:
        register_jitable(error_model="numpy")(part)
    compiled = numba.njit(cache=True, error_model="numpy", no_cfunc_wrapper=True)(function)
    index = compiled._cache._cache_file  # type: ignore[attr-defined]
    index._source_stamp = (index._source_stamp, _sources())
    typed: Callable[P, R] = compiled
    return typed


@cache
def _sources() -> tuple[tuple[str, float, int], ...]:
    """Name, time and size of every source file of this package."""
    here = Path(__file__).parent
    files = sorted(here.rglob("*.py"))
    return tuple((str(f.relative_to(here)), f.stat().st_mtime, f.stat().st_size) for f in files)
