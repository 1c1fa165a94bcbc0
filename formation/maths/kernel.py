"""The one way this project compiles a loop: numba, cached on disk, IEEE arithmetic (no fastmath)."""

import atexit
import gc
import hashlib
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from fcntl import LOCK_EX, flock
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from types import MappingProxyType
from typing import Any, ClassVar, ParamSpec, TypeVar

import numba
from numba.core import event
from numba.core.caching import CacheImpl, UserProvidedCacheLocator
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher
from numba.core.imputils import lower_cast
from numba.core.types import Array, NestedArray, unliteral
from numba.extending import register_jitable

P = ParamSpec("P")
R = TypeVar("R")
Begun = Callable[[str, int, int], None]
"""Called with the kernel that is compiled now, how many there are with it, and how many there will be."""
_OPTIONS: Mapping[str, Any] = MappingProxyType({"error_model": "numpy", "no_cfunc_wrapper": True})
"""The same for all, or numba compiles its own helpers for each. Nobody calls kernels from C."""
_TEMPORARY = "mavlink-formation-"
_FOLDER = f"kernels-{sys.implementation.cache_tag}"
_PACKAGES = Path(__file__).absolute().parents[2]
_IMPORT = re.compile(r"^ *(?:from ([\w.]+) import (\([^)]*\)|[^\n]*)|import ([\w.]+))", re.MULTILINE)
_NAME = re.compile(r"\w+")


def kernel(function: Callable[P, R], calls: tuple[Callable[..., object], ...] = ()) -> Callable[P, R]:
    """The compiled form of a function of floats, ints, arrays and records; division follows IEEE, never raises.

    calls: plain functions that it calls, directly or not, which are compiled with it and stay plain elsewhere.
    With numba's own NUMBA_DISABLE_JIT=1 it is the function itself, to be stepped through.
    """
    for plain in calls:
        register_jitable(**_OPTIONS, no_cpython_wrapper=False, pipeline_class=_PartCompiler)(plain)
    compiled = numba.njit(**_OPTIONS, cache=True, pipeline_class=_KernelCompiler)(function)
    if isinstance(compiled, Dispatcher):
        part = numba.njit(**_OPTIONS, pipeline_class=_PartCompiler)(function)
        _replace(part, compile=_for_any_value(part.compile))
        _replace(compiled, compile=_one_at_a_time(compiled.compile, _lock_file(_name(compiled))))
        _replace(compiled, get_call_template=part.get_call_template, get_overload=part.get_overload)
    typed: Callable[P, R] = compiled
    return typed


def _replace(dispatcher: Any, **methods: Callable[..., Any]) -> None:
    """Have this dispatcher do something another way than its class."""
    for name, method in methods.items():
        setattr(dispatcher, name, method)


def _for_any_value(compile_for: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """numba's `compile`, which takes the types of the arguments, without the constants that some of them carry, and
    with arrays of records as any others: it would compile a kernel anew for each."""

    def for_usual_types(types: Any) -> Any:
        return compile_for(tuple(map(_usual, types)) if isinstance(types, tuple) else types)

    return for_usual_types


def _usual(kind: Any) -> Any:
    kind = unliteral(kind)  # type: ignore[no-untyped-call]
    return Array(kind.dtype, kind.ndim, "C") if isinstance(kind, NestedArray) else kind


# Both are laid out alike.
lower_cast(NestedArray, Array)(lambda _context, _builder, _from, _to, value: value)  # type: ignore[no-untyped-call]


def _one_at_a_time(compile_for: Callable[[Any], Any], lock_file: Path) -> Callable[[Any], Any]:
    """numba's `compile` by one process at a time: two that write a kernel's index at once may name the same file in it
    for two codes. The second finds what the first has compiled."""

    def alone(types: Any) -> Any:
        lock_file.parent.mkdir(parents=True, exist_ok=True)
        with global_compiler_lock, lock_file.open("w") as lock:
            flock(lock, LOCK_EX)  # until it is closed, or the process ends
            return compile_for(types)

    return alone


def _lock_file(kernel_name: str) -> Path:
    """What is locked while this kernel is compiled or read."""
    root: str = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    return Path(root) / "locks" / kernel_name


class _Part(JITCodeLibrary):
    """A kernel's code for the kernels that call it: optimised and made machine code with each of them, not by itself.

    Two thirds of what a compilation costs were parts that nobody called alone, and callers that held them once more.
    """

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout

    def finalize(self) -> None:
        """Nothing is to be done."""
        self._finalized = True

    @property
    def codegen(self) -> Any:
        """Who gets the environment of the function: nobody."""
        return self

    def set_env(self, name: str, environment: object) -> None:
        """Nothing is to be done."""


class _Whole(JITCodeLibrary):
    """A kernel's code with all its parts."""

    def add_linking_library(self, library: Any) -> None:
        """Add a part, and its own parts."""
        if library not in self._linking_libraries:
            super().add_linking_library(library)  # type: ignore[no-untyped-call]
            for each in library._linking_libraries if isinstance(library, _Part) else ():
                self.add_linking_library(each)


class _KernelCompiler(Compiler):
    """Compiles what Python calls."""

    library: ClassVar[Any] = _Whole

    def define_pipelines(self) -> Any:
        """numba's own passes."""
        state = self.state
        state.library = self.library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return super().define_pipelines()  # type: ignore[no-untyped-call]


class _PartCompiler(_KernelCompiler):
    """Compiles what only other kernels call: Python cannot."""

    library = _Part

    def define_pipelines(self) -> Any:
        """Without the code by which Python calls it."""
        self.state.flags.no_cpython_wrapper = True
        return super().define_pipelines()


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
    found = (v for module in loaded for v in vars(module).values() if isinstance(v, Dispatcher))
    return {_name(v): v for v in found if not v.py_func.__module__.startswith("numba")}


def _name(dispatcher: Any) -> str:
    return f"{dispatcher.py_func.__module__}.{dispatcher.py_func.__qualname__}"


def _add_done(kernels: Mapping[str, Any], done: set[str]) -> None:
    """Add those whose machine code there is, with their parts: another process may compile beside this one."""
    for name, each in kernels.items():
        if name not in done and os.path.exists(each._cache._cache_file._index_path):
            _add_with_parts(each, done)


def _add_with_parts(kernel: Any, found: set[str]) -> None:
    found.add(_name(kernel))
    code, names = kernel.py_func.__code__, kernel.py_func.__globals__
    for part in map(names.get, code.co_names):
        if isinstance(part, Dispatcher) and _name(part) not in found:
            _add_with_parts(part, found)


class _ByContent(UserProvidedCacheLocator):
    """Where in the cache a kernel's machine code is: by its module, and the content of all that it may be made of.

    numba looks only at a kernel's own file to decide whether its machine code is still good, although kernels and
    constants of other files are compiled into it. Here every file of ours that the module imports, directly or not,
    names the folder: no edit is answered by yesterday's code, only what it may change is compiled anew, and all copies
    of a release share what is compiled.
    """

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """The module's path from the packages' folder on, and a digest of the content."""
        file = Path(py_file).absolute()
        path = os.path.relpath(file.with_suffix(""), _PACKAGES)
        if path.startswith(os.pardir):
            path = os.path.join(hashlib.sha256(path.encode()).hexdigest()[:16], file.stem)
        return f"{path}-{_digest(file)}"

    def ensure_cache_path(self) -> None:
        """Make the folder; in a cache of this installation alone, what its module was made of earlier goes."""
        super().ensure_cache_path()  # type: ignore[no-untyped-call]
        folder = Path(self._cache_path)
        if not user_folder:
            for old in folder.parent.glob(f"{folder.name.rpartition('-')[0]}-*"):
                if old != folder:
                    shutil.rmtree(old, ignore_errors=True)


@cache
def _digest(file: Path) -> str:
    """Of the file and every file of ours that it imports, directly or not."""
    known, new = set[Path](), [file]
    while new:
        found = new.pop()
        if found not in known:
            known.add(found)
            new += _part(found)[1]
    state = hashlib.sha256()
    for each in sorted(known - {file}):
        state.update(os.path.relpath(each, _PACKAGES).encode() + _part(each)[0])
    return hashlib.sha256(state.digest() + _part(file)[0]).hexdigest()[:16]


@cache
def _part(file: Path) -> tuple[bytes, tuple[Path, ...]]:
    """The digest of a file, and the files of ours, or of its own folder, that it imports, wherever in it."""
    content, found = file.read_bytes(), list[Path]()
    for module, names, whole in _IMPORT.findall(content.decode("utf-8")):
        for root in (_PACKAGES, file.parent):
            path = root.joinpath(*(module or whole).split("."))
            names_in = _NAME.findall(names) if path.is_dir() else ()
            candidates = [path.with_suffix(".py"), *(path / f"{name}.py" for name in names_in)]
            found += [candidate for candidate in candidates if candidate.is_file()]
    return hashlib.sha256(content).digest(), tuple(found)


def _cache_of_this_installation() -> Path:
    """Those of an earlier release, by all of its files, go."""
    folder = _cache_root() / _FOLDER
    for old in folder.parent.glob(f"{_FOLDER}-*"):
        shutil.rmtree(old, ignore_errors=True)
    return folder


def _cache_root() -> Path:
    """Beside the package, as Python's own caches; else the user's, one per installation; else one for this run."""
    beside = Path(__file__).parent / "__pycache__"
    installation = hashlib.sha256(str(beside).encode()).hexdigest()[:16]
    own = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    for folder in (beside, Path(own, "mavlink-formation", installation)):
        with suppress(OSError):
            if folder.is_absolute():  # a user without a home has "~"
                folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK):
                return folder
    return _temporary_root()


def _temporary_root() -> Path:
    """A folder that goes with this process, and that those it starts find as the user's."""
    folder = mkdtemp(prefix=_TEMPORARY)
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ["XDG_CACHE_HOME"] = folder
    return Path(folder)


def is_cache_temporary() -> bool:
    """Whether compiled kernels go with this process, since no folder for them can be written."""
    root: str = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    return Path(root).parent.name.startswith(_TEMPORARY)


# A sixth less to compile than at 3, and what is compiled is as fast.
numba.config.OPT = type(numba.config.OPT)(2)  # type: ignore[attr-defined]
user_folder: str = numba.config.CACHE_DIR  # type: ignore[attr-defined]
folder = Path(user_folder) / _FOLDER if user_folder else _cache_of_this_installation()
numba.config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]
CacheImpl._locator_classes.insert(0, _ByContent)
