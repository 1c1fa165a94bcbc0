"""`gcs-sim check`: a scenario judged with the lab that it flies, without being flown."""

from collections.abc import Iterator
from pathlib import Path

from formation.config import LabConfig
from formation.guidance.shape import shape_for
from formation.guidance.shape_request import parse
from formation.messages import Verb
from gcs.finding import Finding, Grade
from gcs.lab import cli
from mocap.sources.csv_file import MocapFileError
from sim.scenario import Opened, Scenario, find, recorded_leader
from wire.config_file import ConfigError


def check(file: Path, svg: Path | None, as_json: bool) -> None:
    """Judge and draw; ends the program with its exit code, as `gcs check` does."""
    try:
        opened = find(str(file))
    except ConfigError as error:
        cli.not_right(Path(error.source or file), error, as_json)
        return
    cli.judge_lab(file, _lab(opened), svg, as_json, tuple(_findings(opened.scenario)))


def _lab(opened: Opened) -> LabConfig:
    """The lab as its file has it, real links and all."""
    return opened.scenario.lab if opened.lab is None else opened.lab


def _findings(scenario: Scenario) -> Iterator[Finding]:
    """What the scenario itself asks for that its lab does not have."""
    for k, step in enumerate(scenario.script):
        try:
            if step.verb is Verb.TRAJECTORY:
                scenario.lab.flying(step.argument)
            elif step.verb is Verb.SHAPE:
                shape_for(scenario.lab, parse(step.argument))
        except ValueError as error:
            key, value = f"script[{k}].argument", f'"{step.argument}"'
            yield Finding(key, "script", Grade.FAIL, value, why=str(error))
    try:
        recorded_leader(scenario)
    except (MocapFileError, ValueError) as error:
        yield Finding("leader.file", "files", Grade.FAIL, f'"{scenario.leader.file}"', why=str(error))
