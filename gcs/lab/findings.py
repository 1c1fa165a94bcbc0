"""Findings about a lab file for `gcs check` and `gcs run`, delay margins included, and how they are printed."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from formation.config import LabConfig, MocapConfig
from formation.vehicle.profile import PROFILES, VehicleProfile
from gcs.finding import STYLES, Finding, Grade
from gcs.lab.judge import SECURITY, judge
from wire.config_file import Lines, lines_of
from wire.process.program import configuration, fail
from wire.process.system import NOT_RIGHT


def findings_of(config: LabConfig) -> tuple[Finding, ...]:
    """All errors and warnings of a lab, including the files that it names."""
    files = []
    if config.mocap.file is not None and config.mocap.source == "csv":
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


def judge_margins(config: LabConfig) -> list[Finding]:
    """A failure for each kind of commanded vehicle that would not fly steadily; takes seconds for one not shipped."""
    kinds = {config.vehicles[i].profile: config.profile_of(config.vehicles[i]) for i in config.commanded}
    unknown = [kind for kind in kinds.values() if not _is_known(config, kind)]
    found: list[Finding] = []
    if unknown:
        from wire.process.progress import compile_all  # loads the control, which a check of usual vehicles does without

        compile_all("gcs", lambda: found.extend(each for kind in unknown for each in _judge(config, kind)), sys.stderr)
    return found


def _judge(config: LabConfig, kind: VehicleProfile) -> list[Finding]:
    from formation.control.margin import delay_margin, is_carried
    from formation.control.presets import preset_for

    gains = preset_for(config.control_preset, kind, config.mocap)
    if is_carried(kind, gains, config.mocap):
        return []
    key, value = "control_preset", f'"{config.control_preset}"'
    for k, own in enumerate(config.profiles):
        if own.name == kind.name:
            key, value = f"profiles[{k}].response_lag_s", f"{kind.response_lag_s:g}"
    wanted = "a shorter response_dead_time_s, response_lag_s or mocap.delay_s, or slower gains"
    why = f"would not fly steadily: {delay_margin(kind, gains, config.mocap)}"
    return [Finding(key, "delay", Grade.FAIL, value, wanted, why)]


def _is_known(config: LabConfig, kind: VehicleProfile) -> bool:
    """Whether it is a shipped vehicle with the gains and cameras that all of those are tested to carry."""
    usual = MocapConfig()
    is_usual = config.mocap.delay_s <= usual.delay_s and config.mocap.rate_hz >= usual.rate_hz
    return is_usual and config.control_preset == "default" and PROFILES.get(kind.name) == kind
