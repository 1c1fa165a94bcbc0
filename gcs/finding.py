"""The finding of a check, or about a key of the lab file; how findings are shown, counted, turned into an exit code."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from enum import Enum, StrEnum
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from formation.config import LabConfig


class Grade(StrEnum):
    """How a check ended."""

    PASS = "pass"
    WARN = "warn"
    FAIL = "fail"


@dataclass(frozen=True, slots=True)
class Fix:
    """A parameter that would put a finding right."""

    sysid: int
    parameter: str
    value: float


@dataclass(frozen=True, slots=True)
class Refit:
    """A profile that would put a finding right, as TOML, and its name."""

    sysid: int
    name: str
    toml: str

    def write(self, folder: Path) -> Path:
        """Put it into a file of its own in `folder`; returns which. OSError, FileExistsError where there is one."""
        path = folder / f"profile-{self.sysid}.toml"
        with path.open("x", encoding="utf-8") as file:
            file.write(self.toml)
        return path


@dataclass(frozen=True, slots=True)
class Finding:
    """One check of one subject: what was found, what is wanted and why.

    fix, refit: where a parameter of the autopilot, or another profile in the lab file, would put it right.
    """

    subject: str
    check: str
    grade: Grade
    found: str
    wanted: str = ""
    why: str = ""
    fix: Fix | None = None
    refit: Refit | None = None


MILLIMETRES_M = 50.0
"""A length in a room beyond this is one in millimetres."""
STYLES = {Grade.PASS: "green", Grade.WARN: "yellow", Grade.FAIL: "bold red"}


def graded(subject: str, check: str, found: str, wanted: str, good: bool, why: str = "", fair: bool = False) -> Finding:
    """A pass where `good`, else a warning where `fair`, else a failure."""
    grade = Grade.PASS if good else Grade.WARN if fair else Grade.FAIL
    return Finding(subject, check, grade, found, wanted, "" if good else why)


def unmeasured(subject: str, check: str, wanted: str, why: str, grade: Grade = Grade.WARN) -> Finding:
    """A check that had nothing to measure: never a pass."""
    return Finding(subject, check, grade, "not measured", wanted, why)


def failed(findings: Sequence[Finding]) -> bool:
    """Whether any check failed."""
    return any(finding.grade is Grade.FAIL for finding in findings)


def show(findings: Sequence[Finding], console: Console) -> None:
    """The table for people."""
    table = Table(box=None, pad_edge=False)
    for column in ("", "of", "check", "found", "wanted", "why"):
        table.add_column(column, overflow="fold")
    for f in findings:
        words = map(Text, (f.subject, f.check, f.found, f.wanted, f.why))  # what drones said is never markup
        table.add_row(Text(f.grade, STYLES[f.grade]), *words)
    console.print(table)
    count = {grade: sum(f.grade is grade for f in findings) for grade in Grade}
    console.print(", ".join(f"{count[grade]} {grade}" for grade in Grade))


def as_dicts(findings: Sequence[Finding]) -> list[dict[str, object]]:
    """The findings for scripts."""
    return [asdict(finding) for finding in findings]


def vehicle_key(i: int, name: str) -> str:
    """The key of vehicle i's own `name`."""
    return f"leader.{name}" if i == 0 else f"followers[{i - 1}].{name}"


class Keys:
    """The lab's keys, and what is to be said of them: `Finding.subject` is the key, `found` its value."""

    def __init__(self, config: LabConfig) -> None:
        self._config = config

    def reject(self, key: str, check: str, why: str, wanted: str = "") -> Finding:
        """An error: the lab cannot be flown with this value."""
        return Finding(key, check, Grade.FAIL, self.value(key), wanted, why)

    def warn(self, key: str, check: str, why: str, wanted: str = "") -> Finding:
        """A warning: the lab can be flown, but the value is unusual."""
        return Finding(key, check, Grade.WARN, self.value(key), wanted, why)

    def value(self, key: str) -> str:
        """The value at `followers[0].offset_m`, as TOML would have it; nothing for one that is a table."""
        found: Any = self._config
        rest = key
        while rest:
            name, found = _step(found, rest)
            rest = rest[len(name) :].lstrip(".")
        return written(found)


def _step(table: Any, key: str) -> tuple[str, Any]:
    """The first part of a key, and what is there; names of shapes may have dots of their own."""
    if key.startswith("["):
        index = key[: key.index("]") + 1]
        return index, table[int(index[1:-1])]
    if isinstance(table, dict):
        name = key.rpartition("[")[0] if "[" in key else key
        return name, table[name]
    name = key.partition(".")[0].partition("[")[0]
    return name, getattr(table, name)


def written(value: object) -> str:
    """A value as in a TOML file, numbers short; nothing for a table."""
    match value:
        case bool():
            return "true" if value else "false"
        case int() | float():
            return f"{value:.6g}"
        case Enum() | str():
            return f'"{value}"'
        case list() | tuple():
            return _list(value)
        case _:
            return ""


def _list(values: Iterable[object]) -> str:
    items = [written(item) for item in values]
    return f"[{', '.join(items)}]" if all(items) and len(items) <= 8 else ""
