"""The example package of examples/, as pip leaves it."""

import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import invalidate_caches
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[2] / "examples" / "own_package"


@contextmanager
def installed_in(folder: Path) -> Iterator[None]:
    """While inside, its modules are there, and its entry points beside them."""
    groups = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]["entry-points"]
    told = folder / "site" / "own_formation-1.0.dist-info"
    told.mkdir(parents=True)
    (told / "METADATA").write_text("Metadata-Version: 2.1\nName: own-formation\nVersion: 1.0\n")
    lines = [f"[{group}]\n" + "".join(f"{k} = {v}\n" for k, v in made.items()) for group, made in groups.items()]
    (told / "entry_points.txt").write_text("\n".join(lines))
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(told.parent)
        patch.syspath_prepend(EXAMPLE)
        invalidate_caches()
        try:
            yield
        finally:
            for name in [name for name in sys.modules if name.partition(".")[0] == "own_formation"]:
                del sys.modules[name]
    invalidate_caches()
