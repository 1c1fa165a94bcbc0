"""`python -m bench.timings --against REV`: the figures of another commit, measured in the same run.

Each is measured in a process of its own, the other commit first. What calls cost differs from day to day on a shared
machine, so that only figures of one run can be compared; numbers of calls can always be.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rich import box
from rich.table import Table

ROOT = Path(__file__).parents[1]
NO_FIGURE = frozenset({"count", "followers"})
"""What says how a figure came about."""
Progress = Callable[[str], None]


class AgainstError(RuntimeError):
    """The other commit cannot be had, or does not run; the text says why."""


@dataclass(frozen=True, slots=True)
class Compared:
    """Figures by name, as `Result.to_json` nests them: here, and at the other commit; those that both have."""

    revision: str
    here: Mapping[str, float]
    there: Mapping[str, float]

    def ratio(self, name: str) -> float | None:
        """Here over there; None where there is none."""
        return self.here[name] / self.there[name] if self.there[name] else None

    def to_json(self) -> str:
        """Indented JSON: of each figure here, there and their ratio."""
        rows = {
            name: {"here": here, "there": self.there[name], "ratio": self.ratio(name)}
            for name, here in self.here.items()
        }
        return json.dumps({"against": self.revision, "figures": rows}, indent=2, allow_nan=False)

    def tables(self) -> Iterator[Table]:
        """A row a figure: here, at the other commit, and their ratio."""
        table = Table(title="the same figures of another commit", title_justify="left", box=box.SIMPLE_HEAD)
        for heading in ("", self.revision, "here", "ratio"):
            table.add_column(heading, justify="right" if heading else "left")
        for name, here in self.here.items():
            ratio = self.ratio(name)
            table.add_row(name, f"{self.there[name]:,.6g}", f"{here:,.6g}", "" if ratio is None else f"{ratio:.2f}")
        yield table


def against(revision: str, followers: Sequence[int], progress: Progress) -> Compared:
    """Measure both; AgainstError."""
    with checkout(revision) as folder:
        progress(f"{revision}: its figures, after its kernels have been compiled")
        there = figures(_measured(folder, followers))
    progress("the figures here")
    here = figures(_measured(ROOT, followers))
    both = here.keys() & there.keys()
    return Compared(
        revision, {name: value for name, value in here.items() if name in both}, {name: there[name] for name in both}
    )


@contextmanager
def checkout(revision: str, repository: Path = ROOT) -> Iterator[Path]:
    """The files of a commit of the repository, for a while; AgainstError."""
    with TemporaryDirectory() as folder:
        archive = Path(folder) / "commit.tar"
        tree = Path(folder) / "tree"
        tree.mkdir()
        _run(["git", "-C", str(repository), "archive", "--output", str(archive), revision])
        _run(["tar", "-x", "-f", str(archive), "-C", str(tree)])
        yield tree


def figures(values: Any, name: str = "") -> dict[str, float]:
    """Every number in nested JSON, by the path to it; swarms by their number of followers."""
    if isinstance(values, Mapping):
        items = [(key, value) for key, value in values.items() if key not in NO_FIGURE]
    elif isinstance(values, list):
        items = [(str(value["followers"]), value) for value in values]
    else:
        return {name: float(values)}
    found: dict[str, float] = {}
    for key, value in items:
        found |= figures(value, f"{name}.{key}" if name else key)
    return found


def _measured(folder: Path, followers: Sequence[int]) -> Any:
    sizes = [word for count in followers for word in ("--followers", str(count))]
    program = ("bench.timings",) if (folder / "bench" / "timings.py").exists() else ("sim", "bench")  # before bench/
    command = (sys.executable, "-P", "-m", *program, "--json", *sizes)  # PYTHONPATH before this installation
    return json.loads(_run(command, os.environ | {"PYTHONPATH": str(folder)}))


def _run(command: Sequence[str], environment: Mapping[str, str] | None = None) -> str:
    """Its output; AgainstError with its last words where it fails."""
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout
    except OSError as error:
        raise AgainstError(f"{command[0]}: {error.strerror or error}") from error
    except subprocess.CalledProcessError as error:
        words = error.stderr.strip().splitlines()[-1:] or [f"exit code {error.returncode}"]
        raise AgainstError(words[0]) from error
