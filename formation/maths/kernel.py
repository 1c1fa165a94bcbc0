"""The one way this project compiles a loop: numba, cached on disk, IEEE arithmetic (no fastmath)."""

import gc
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba
from numba.core import event
from numba.core.dispatcher import Dispatcher
from numba.extending import register_jitable

P = ParamSpec("P")
R = TypeVar("R")
Begun = Callable[[str, int, int], None]
"""Told the kernel that is compiled now, how many have been begun with it, and how many kernels there are."""


def kernel(function: Callable[P, R], calls: tuple[Callable[..., object], ...] = ()) -> Callable[P, R]:
    """The compiled form of a function of floats, ints and float64 arrays; division follows IEEE, never raises.

    calls: plain functions that it calls, directly or not, which are compiled with it and stay plain elsewhere.
    numba looks only at a kernel's own file to decide whether its cached machine code is still good, although
    kernels of other files are compiled into it. The stamp is widened to all of `formation`, whose kernels are
    the ones that others call, so that an edit is never answered by yesterday's code.
    """
    for part in calls:
        register_jitable(error_model="numpy")(part)
    # Nobody calls kernels from C. numba's own types know nothing of this option, its documentation does.
    compiled = numba.njit(cache=True, error_model="numpy", no_cfunc_wrapper=True)(function)  # type: ignore[call-overload]
    index = compiled._cache._cache_file
    index._source_stamp = (index._source_stamp, _sources())
    typed: Callable[P, R] = compiled
    return typed


@contextmanager
def compiling(begun: Begun) -> Iterator[None]:
    """Within it every kernel that has to be compiled, because no cache on disk has it, is told of.

    Garbage is not collected meanwhile: numba makes objects by the million, and a quarter of its time went there.
    """
    collected = gc.isenabled()
    gc.disable()
    try:
        with event.install_listener("numba:compile", _Listener(begun)):
            yield
    finally:
        if collected:
            gc.enable()


class _Listener(event.Listener):
    """Hears what numba begins to compile, its own helpers among it."""

    def __init__(self, begun: Begun) -> None:
        self._begun = begun
        self._kernels = _kernels()
        self._seen: set[str] = set()

    def on_start(self, event: Any) -> None:
        function = event.data["dispatcher"].py_func
        name = f"{function.__module__}.{function.__qualname__}"
        if name in self._kernels and name not in self._seen:
            self._seen.add(name)
            self._begun(name, len(self._seen), len(self._kernels))

    def on_end(self, event: Any) -> None:
        pass


def _kernels() -> set[str]:
    """The names of all kernels in the modules loaded so far."""
    loaded = [module for name, module in sys.modules.items() if not name.startswith("numba")]
    functions = [v.py_func for module in loaded for v in vars(module).values() if isinstance(v, Dispatcher)]
    return {f"{f.__module__}.{f.__qualname__}" for f in functions if not f.__module__.startswith("numba")}


@cache
def _sources() -> tuple[tuple[str, float, int], ...]:
    """Name, time and size of every source file of this package."""
    here = Path(__file__).parent.parent
    files = sorted(here.rglob("*.py"))
    return tuple((str(f.relative_to(here)), f.stat().st_mtime, f.stat().st_size) for f in files)
