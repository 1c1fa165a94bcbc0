"""The finding of a check, and how findings are shown, counted and turned into an exit code."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text


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
