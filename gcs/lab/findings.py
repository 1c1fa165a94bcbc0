"""Findings about a lab file, for all programs that judge one."""

import json
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from formation.config import LabConfig
from gcs.finding import STYLES, Finding, Grade
from gcs.lab.judge import SECURITY, judge
from wire.config_file import Lines, lines_of
from wire.process.program import configuration, fail
from wire.process.system import NOT_RIGHT


def findings_of(config: LabConfig) -> tuple[Finding, ...]:
    """All errors and warnings of a lab, including the files that it names."""
    files = []
    if config.mocap.file is not None and config.mocap.source in ("csv", "mcap"):
        files.append(("mocap.file", config.mocap.file, "paths count from where the ground is started"))
    button = config.operator.stop_button
    if button is not None:
        files.append(("operator.stop_button.device", button.device, "`gcs buttons` names the device of a press"))
    missing = (
        Finding(key, "files", Grade.WARN, f'"{file}"', why=f"no such file here; {cure}")
        for key, file, cure in files
        if not Path(file).exists()
    )
    return (*judge(config), *missing)


def line(finding: Finding, at: Lines) -> str:
    """`file:line key = value: reason, wanted ...` in one line. at: of the file that is judged."""
    value = f" = {finding.found}" if finding.found else ""
    wanted = f"; wanted {finding.wanted}" if finding.wanted else ""
    return f"{at.of(finding.subject)}{value}: {finding.why}{wanted}"


def of_grade(findings: Sequence[Finding], grade: Grade) -> list[Finding]:
    """Those of one grade."""
    return [finding for finding in findings if finding.grade is grade]


def approved(path: Path, as_json: bool, *, insecure: bool = False) -> LabConfig:
    """Load a lab file and print its warnings; ends the program if the lab is rejected.

    insecure: links that other machines reach need no keys.
    """
    config = configuration(path)
    findings = [found for found in findings_of(config) if not (insecure and found.check == SECURITY)]
    at = lines_of(path)
    if errors := of_grade(findings, Grade.FAIL):
        fail("\n".join(line(finding, at) for finding in errors), NOT_RIGHT)
    for finding in of_grade(findings, Grade.WARN):
        if as_json:
            print(json.dumps({"severity": "WARNING", "source": str(path), "text": line(finding, at)}), flush=True)
        else:
            print_line(line(finding, at), Grade.WARN)
    return config


def print_line(text: str, grade: Grade, console: Console | None = None) -> None:
    """Print one line in the grade's style; to stderr by default."""
    console = console or Console(stderr=True)
    console.print(text, style=STYLES[grade], highlight=False, markup=False, soft_wrap=True)
