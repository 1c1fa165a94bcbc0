"""Where the machine code of kernels is kept on disk: by content, in a folder of this installation."""

import atexit
import hashlib
import os
import re
import shutil
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numba
from numba.core.caching import UserProvidedCacheLocator

_TEMPORARY = "mavlink-formation-"
_FOLDER = f"kernels-{sys.implementation.cache_tag}"
_PACKAGES = Path(__file__).absolute().parents[2]
_IMPORT = re.compile(r"^ *(?:from ([\w.]+) import (\([^)]*\)|[^\n]*)|import ([\w.]+))", re.MULTILINE)
_NAME = re.compile(r"\w+")
_NUMBAS_OWN = "UserProvidedCacheLocator,InTreeCacheLocator,UserWideCacheLocator,IPythonCacheLocator,ZipCacheLocator"
_USERS_FOLDER: str = numba.config.CACHE_DIR  # type: ignore[attr-defined]


class ByContent(UserProvidedCacheLocator):
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
        if not _USERS_FOLDER:
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


def use_cache() -> None:
    """Have numba keep what it compiles here, by its settings `CACHE_DIR` and `CACHE_LOCATOR_CLASSES`.

    What is no file of ours on disk, as a cell of a notebook, is kept where numba keeps it.
    """
    folder = Path(_USERS_FOLDER) / _FOLDER if _USERS_FOLDER else _cache_of_this_installation()
    others = numba.config.CACHE_LOCATOR_CLASSES or _NUMBAS_OWN  # type: ignore[attr-defined]
    numba.config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]
    numba.config.CACHE_LOCATOR_CLASSES = f"{__name__}.{ByContent.__name__},{others}"  # type: ignore[attr-defined]
