"""Findings about a lab file, for all programs that judge one."""

import json
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from formation.config import LabConfig
from gcs.finding import STYLES, Finding, Grade, graded
from gcs.lab.exposed import SECURITY
from gcs.lab.judge import judge
from wire.process.console import NOT_RIGHT, configuration, fail


def findings_of(config: LabConfig) -> tuple[Finding, ...]:
    """All errors and warnings of a lab, including the files that it names."""
    file = config.mocap.file
    if file is None or config.mocap.source not in ("csv", "mcap"):
        return judge(config)
    why = "no such file here; paths count from where the ground is started"
    found = graded("mocap.file", "files", f'"{file}"', "", Path(file).is_file(), why, fair=True)
    return (*judge(config), *([found] if found.grade is Grade.WARN else []))


def line(finding: Finding) -> str:
    """`key = value: reason, wanted ...` in one line."""
    value = f" = {finding.found}" if finding.found else ""
    wanted = f"; wanted {finding.wanted}" if finding.wanted else ""
    key = f"{finding.subject}{value}"
    return f"{key}: {finding.why}{wanted}" if key else f"{finding.why}{wanted}"


def of_grade(findings: Sequence[Finding], grade: Grade) -> list[Finding]:
    """Those of one grade."""
    return [finding for finding in findings if finding.grade is grade]


def approved(path: Path, as_json: bool, *, insecure: bool = False) -> LabConfig:
    """Load a lab file and print its warnings; ends the program if the lab is rejected.

    insecure: links that other machines reach need no keys.
    """
    config = configuration(path)
    findings = [found for found in findings_of(config) if not (insecure and found.check == SECURITY)]
    if errors := of_grade(findings, Grade.FAIL):
        fail("\n".join(f"{path}: {line(finding)}" for finding in errors), NOT_RIGHT)
    for finding in of_grade(findings, Grade.WARN):
        if as_json:
            print(json.dumps({"severity": "WARNING", "source": str(path), "text": line(finding)}), flush=True)
        else:
            print_line(f"{path}: {line(finding)}", Grade.WARN)
    return config


def print_line(text: str, grade: Grade, console: Console | None = None) -> None:
    """Print one line in the grade's style; to stderr by default."""
    console = console or Console(stderr=True)
    console.print(text, style=STYLES[grade], highlight=False, markup=False, soft_wrap=True)
