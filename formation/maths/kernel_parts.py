"""Kernels compile in 0.6 of numba's time, by what numba keeps to itself; to the same bits as the plain way.

Nothing else touches numba's insides. Where a numba has changed what is called or replaced here, importing this raises
ImportError with the method's name: kernels then compile the plain way, slower (formation.maths.kernel).
"""

from fcntl import LOCK_EX, flock
from inspect import signature, unwrap
from pathlib import Path
from typing import Any, ClassVar

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher
from numba.core.types import Array, NestedArray, unliteral
from numba.extending import lower_cast

_RELIED_ON = (
    (JITCodeLibrary, "__init__", "self codegen name", {"_linking_libraries"}),
    (JITCodeLibrary, "_optimize_functions", "self ll_module", {"_codegen", "_data_layout"}),
    (JITCodeLibrary, "add_linking_library", "self library", {"_linking_libraries", "_ensure_finalized"}),
    (JITCodeLibrary, "_ensure_finalized", "self", {"_finalized", "finalize"}),
    (JITCodeLibrary, "finalize", "self", {"_linking_libraries", "_optimize_final_module"}),
    (JITCodeLibrary, "enable_object_caching", "self", set[str]()),
    (Compiler, "define_pipelines", "self", {"state"}),
    (Dispatcher, "compile", "self sig", {"_cache", "load_overload", "save_overload"}),
    (Dispatcher, "get_call_template", "self args kws", {"compile"}),
    (Dispatcher, "get_overload", "self sig", {"overloads"}),
)
"""Class and method, its parameters, and names in its code that matter here."""
for _owner, _method, _parameters, _names in _RELIED_ON:
    _found = getattr(_owner, _method, lambda: None)
    if " ".join(signature(_found).parameters) != _parameters or not _names <= set(unwrap(_found).__code__.co_names):
        raise ImportError(f"{_owner.__name__}.{_method}")


class _Part(JITCodeLibrary):
    """A kernel's code for the kernels that call it: optimised and made machine code with each of them."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

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


class WholeCompiler(Compiler):
    """Compiles what Python calls."""

    library: ClassVar[Any] = _Whole

    def define_pipelines(self) -> Any:
        """numba's own passes."""
        state = self.state
        state.library = self.library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return super().define_pipelines()  # type: ignore[no-untyped-call]


class PartCompiler(WholeCompiler):
    """Compiles what only other kernels call: Python cannot."""

    library = _Part

    def define_pipelines(self) -> Any:
        """Without the code by which Python calls it."""
        self.state.flags.no_cpython_wrapper = True
        return super().define_pipelines()


def join(whole: Any, part: Any, lock_file: Path) -> None:
    """Have other kernels call `part`, the form of the kernel `whole` by PartCompiler; one process at a time compiles.

    Two processes that write a kernel's index at once may name the same file in it for two codes; the second finds what
    the first has compiled. A part is not compiled anew for constants and for arrays within records, as by numba itself.
    """
    compile_whole, compile_part = whole.compile, part.compile

    def compile_alone(types: Any) -> Any:
        lock_file.parent.mkdir(parents=True, exist_ok=True)
        with global_compiler_lock, lock_file.open("w") as lock:
            flock(lock, LOCK_EX)  # until it is closed, or the process ends
            return compile_whole(types)

    part.compile = lambda types: compile_part(tuple(map(_usual, types)) if isinstance(types, tuple) else types)
    whole.compile = compile_alone
    whole.get_call_template, whole.get_overload = part.get_call_template, part.get_overload


def _usual(kind: Any) -> Any:
    kind = unliteral(kind)  # type: ignore[no-untyped-call]
    return Array(kind.dtype, kind.ndim, "C") if isinstance(kind, NestedArray) else kind


# Both are laid out alike.
lower_cast(NestedArray, Array)(lambda _context, _builder, _from, _to, value: value)  # type: ignore[no-untyped-call]
