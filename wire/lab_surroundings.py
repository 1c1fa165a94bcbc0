"""A lab file's surroundings: recorded ways beside it; ways, shapes and laws of the lab's own packages.

A package registers what it makes under an entry point; `examples/own_package` is one. Ways and shapes become part of
the configuration when the file is read, so that a log replays where the package is not;
a law is code, and must be there.
"""

import sys
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from functools import partial, wraps
from importlib.metadata import EntryPoint, entry_points
from importlib.util import module_from_spec, spec_from_file_location
from inspect import isfunction, signature
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from formation.names import meant
from formation.own_law.law import ControlLaw
from wire.path_files import COLUMNS, read_points

T = TypeVar("T")

TRAJECTORIES, SHAPES = "mavlink_formation.trajectories", "mavlink_formation.shapes"
LAWS = "mavlink_formation.control_laws"
_PACKAGED = "a lab's law is named as a package registers it, not by its file (manual: Your own control law)"


class TrajectoryMaker(Protocol):
    """Makes a leader's way; registered in the group `mavlink_formation.trajectories`."""

    def __call__(self, **options: Any) -> ArrayLike:
        """Rows (k, 5) of time, s, from 0 on; x, y, z in `lab`, m; heading about lab z, rad. options: the lab file's.

        It is flown through them, from rest to rest, by a spline of the fifth order. ValueError says what is not right.
        """


class ShapeMaker(Protocol):
    """Makes a formation's slots; registered in the group `mavlink_formation.shapes`."""

    def __call__(self, n: int, spacing_m: float) -> ArrayLike:
        """The slots (n, 3) of n followers in the leader's frame (forward, left, up), m, spacing_m apart or more."""


class Surroundings:
    """A lab file's surroundings in `folder`; `formation.trajectory_config.PathReader` for the models read from it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def points_of(self, kind: str, trajectory: Mapping[str, Any]) -> list[list[float]]:
        """The points of a trajectory of kind `file` or `own`; ValueError where there are none to be had."""
        if kind != "own":
            return read_points(self._folder / str(trajectory["file"])) if trajectory.get("file") else []
        if not trajectory.get("name"):
            return []
        maker: TrajectoryMaker = _load(TRAJECTORIES, str(trajectory["name"]))
        return _rows(maker, len(COLUMNS), **dict(trajectory.get("options") or {}))

    def shape_of(self, name: str, n: int, spacing_m: float) -> list[list[float]]:
        """The slots (n, 3) of a shape of the lab's own packages; ValueError where there is none, or it is none."""
        maker: ShapeMaker = _load(SHAPES, name)
        slots = _rows(maker, 3, n=n, spacing_m=spacing_m)
        if len(slots) != n:
            raise ValueError(f"{_name(maker)}: shape {name!r} has {len(slots)} slots for {n} followers")
        return slots

    def check_law(self, name: str, options: Mapping[str, Any]) -> None:
        """ValueError where no package registers the law, or it cannot be made with these options."""
        law_of(name, options)


def law_of(name: str, options: Mapping[str, Any]) -> Callable[[], ControlLaw]:
    """The maker of the lab's own law; ValueError where no package registers it, or it cannot be made so."""
    return _tried(_load(LAWS, name), options)


def law_in_file(source: str, options: Mapping[str, Any]) -> Callable[[], ControlLaw]:
    """The maker of the law in a Python file, `law.py` or `law.py:Name`; ValueError where there is none, or several."""
    file, _, wanted = source.partition(":")
    path = Path(file)
    spec = spec_from_file_location(f"law_in_{path.stem}", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise ValueError(f"{path}: no such file")
    module = module_from_spec(spec)
    sys.modules[spec.name] = module  # as an import does: dataclasses and pickle look there
    try:
        printing_to_stderr(partial(spec.loader.exec_module, module))
    except (Exception, SystemExit) as error:  # it is a lab's own code, which may do anything
        del sys.modules[spec.name]
        raise ValueError(f"{path}: {_error_text(error)}") from error
    own = {name: value for name, value in vars(module).items() if getattr(value, "__module__", "") == module.__name__}
    laws: dict[str, Any] = {k: v for k, v in own.items() if isinstance(v, type) and "__call__" in vars(v)}
    laws = laws or {name: value for name, value in own.items() if isfunction(value) and name[0] != "_"}
    if wanted in own and not wanted.startswith("_"):
        laws = {wanted: own[wanted]}
    if len(laws) != 1 or (wanted and wanted not in laws):
        known = ", ".join(laws) or "none: it has neither a function nor a class with __call__"
        raise ValueError(f"{path}: which law? {path.name}:NAME{meant(wanted, laws)}, of {known}")
    return _tried(laws[wanted] if wanted else next(iter(laws.values())), options)


def _tried(maker: Any, options: Mapping[str, Any]) -> Callable[[], ControlLaw]:
    """The maker with these options, after it has made a law once; ValueError. A function may be the law itself."""
    made = _made_of(maker) if _is_law(maker, options) else maker
    _called(made, **options)
    return partial(printing_to_stderr, partial(made, **options))


def _is_law(maker: Any, options: Mapping[str, Any]) -> bool:
    """Whether it is a function that needs a situation beside its options."""
    if not isfunction(maker):
        return False
    try:
        signature(maker).bind(**options)
    except TypeError:
        return len(signature(maker).parameters) > len(options)
    return False


def _made_of(law: Any) -> Any:
    """The maker of a law that is a plain function."""

    @wraps(law)
    def make(**options: Any) -> Any:
        signature(law).bind(None, **options)  # TypeError for options that it does not have
        return partial(law, **options)

    return make


def printing_to_stderr(call: Callable[[], T]) -> T:
    """The result of `call`, a lab's own code; what it prints goes to standard error: a result is read on the other."""
    with redirect_stdout(sys.stderr):
        return call()


def law_package(name: str) -> str:
    """Which package registers the law, and its version, as a log says it; empty where none does."""
    found = [point.dist for point in entry_points(group=LAWS, name=name) if point.dist is not None]
    return f"{found[0].name} {found[0].version}" if found else ""


def _load(group: str, name: str) -> Any:
    found = entry_points(group=group, name=name)
    if not found:
        known = sorted(point.name for point in entry_points(group=group))
        if name.endswith(".py"):
            raise ValueError(
                f"a file is flown by `gcs-log whatif --law` and `gcs-sim league`; {_PACKAGED}; known: {known}"
            )
        near = meant(name, known)
        raise ValueError(f"no package here registers {name!r} in {group}{near}; known: {', '.join(known) or 'none'}")
    return _loaded(next(iter(found)))


def _loaded(point: EntryPoint) -> Any:
    try:
        return printing_to_stderr(point.load)
    except (Exception, SystemExit) as error:  # it is a lab's own code, which may do anything
        raise ValueError(f"{point.name!r} of {_whose(point)} cannot be loaded: {_error_text(error)}") from error


def _called(maker: Any, **options: Any) -> Any:
    """The product of a maker; ValueError whatever it raises, its own and those about the options as they are."""
    try:
        return printing_to_stderr(partial(maker, **options))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{_name(maker)}: {error}") from error
    except (Exception, SystemExit) as error:
        raise ValueError(f"{_name(maker)}: {_error_text(error)}") from error


def _error_text(error: BaseException) -> str:
    return str(error) if isinstance(error, ImportError | AttributeError) else f"{type(error).__name__}: {error}"


def _rows(maker: Any, columns: int, **options: Any) -> list[list[float]]:
    """The product of a maker, as rows of finite numbers."""
    made_of = _called(maker, **options)
    try:
        made = np.asarray(made_of, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{_name(maker)}: {error}") from error
    if made.ndim != 2 or made.shape[1] != columns or not np.isfinite(made).all():
        raise ValueError(f"{_name(maker)} made an array of shape {made.shape}: finite rows of {columns} are wanted")
    rows: list[list[float]] = made.tolist()
    return rows


def _whose(point: EntryPoint) -> str:
    return point.dist.name if point.dist is not None else point.value


def _name(maker: Any) -> str:
    return f"{getattr(maker, '__module__', '?')}.{getattr(maker, '__qualname__', maker)}"
