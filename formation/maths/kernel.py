"""The one way this project compiles a loop: numba, cached on disk, IEEE arithmetic (no fastmath)."""

import gc
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any, ParamSpec, TypeVar

import numba
from numba.core import event
from numba.extending import is_jitted, register_jitable

from formation.maths.kernel_cache import use_cache

try:
    from formation.maths import kernel_parts
except ImportError as changed:
    parts, CHANGED = None, str(changed)
else:
    parts, CHANGED = kernel_parts, ""
"""CHANGED: what is not in this numba as kernel_parts wants it; "" where all is."""

P = ParamSpec("P")
R = TypeVar("R")
Begun = Callable[[str, int, int], None]
"""Called with the kernel that is compiled now, how many there are with it, and how many there will be."""
_OPTIONS: Mapping[str, Any] = MappingProxyType({"error_model": "numpy", "no_cfunc_wrapper": True})
"""The same for all, or numba compiles its own helpers for each. Nobody calls kernels from C."""

# A sixth less to compile than at 3, and what is compiled is as fast.
numba.config.OPT = type(numba.config.OPT)(2)  # type: ignore[attr-defined]
use_cache()


def kernel(function: Callable[P, R], calls: tuple[Callable[..., object], ...] = ()) -> Callable[P, R]:
    """The compiled form of a function of floats, ints, arrays and records; division follows IEEE, never raises.

    calls: plain functions that it calls, directly or not, which are compiled with it and stay plain elsewhere.
    With numba's own NUMBA_DISABLE_JIT=1 it is the function itself, to be stepped through.
    """
    as_part = {"pipeline_class": parts.PartCompiler} if parts else {}
    as_whole = {"pipeline_class": parts.WholeCompiler} if parts else {}
    for plain in calls:
        register_jitable(**_OPTIONS, no_cpython_wrapper=False, **as_part)(plain)
    compiled = numba.njit(**_OPTIONS, cache=True, **as_whole)(function)
    if parts and is_jitted(compiled):
        lock_file = Path(numba.config.CACHE_DIR, "locks", _name(compiled))  # type: ignore[attr-defined]
        parts.join(compiled, numba.njit(**_OPTIONS, **as_part)(function), lock_file)
    typed: Callable[P, R] = compiled
    return typed


@contextmanager
def compiling(begun: Begun) -> Iterator[None]:
    """Within it `begun` is called for every kernel that has to be compiled, because no cache on disk has it.

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
        self._done: set[str] = set()

    def on_start(self, event: Any) -> None:
        name = _name(event.data["dispatcher"])
        if name in self._kernels and name not in self._done:
            _add_done(self._kernels, self._done)
            self._done.add(name)
            self._begun(name, len(self._done), len(self._kernels))

    def on_end(self, event: Any) -> None:
        pass


def kernel_counts() -> tuple[int, int]:
    """How many kernels of the loaded modules are in the cache on disk, whoever compiled them; and of how many."""
    kernels, done = _kernels(), set[str]()
    _add_done(kernels, done)
    return len(done), len(kernels)


def _kernels() -> dict[str, Any]:
    """All kernels in the modules loaded so far, by name, as numba has them."""
    loaded = [module for name, module in sys.modules.items() if not name.startswith("numba")]
    found = (v for module in loaded for v in vars(module).values() if is_jitted(v))
    return {_name(v): v for v in found if not v.py_func.__module__.startswith("numba")}


def _name(dispatcher: Any) -> str:
    return f"{dispatcher.py_func.__module__}.{dispatcher.py_func.__qualname__}"


def _add_done(kernels: Mapping[str, Any], done: set[str]) -> None:
    """Add those whose machine code there is, with their parts: another process may compile beside this one."""
    for name, each in kernels.items():
        folder, function = each.stats.cache_path, each.py_func
        index = f"{Path(function.__code__.co_filename).stem}.{function.__qualname__}-*.nbi"
        if name not in done and any(Path(folder).glob(index)):
            _add_with_parts(each, done)


def _add_with_parts(kernel: Any, found: set[str]) -> None:
    found.add(_name(kernel))
    code, names = kernel.py_func.__code__, kernel.py_func.__globals__
    for part in map(names.get, code.co_names):
        if is_jitted(part) and _name(part) not in found:
            _add_with_parts(part, found)
