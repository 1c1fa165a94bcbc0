"""`gcs doctor` and `gcs logs`: the terminal around the survey."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gcs.cli.common import NOT_RIGHT, REFUSED, Json, LabFile, configuration, fail, tell, tell_red

if TYPE_CHECKING:
    from formation.config import LabConfig
    from gcs.doctor.survey import Survey
    from gcs.finding import Finding, Refit

SETTLE_S = 3.0
WIDTH = 150  # of a table that is not for a terminal


def doctor(
    lab: LabFile,
    seconds: Annotated[float, typer.Option(min=0.0, help="How long to listen to mocap and drones.")] = 5.0,
    still: Annotated[bool, typer.Option("--still", help="Skip the moves by hand that prove axes and names.")] = False,
    fix: Annotated[
        bool, typer.Option("--fix", help="Offer to write each parameter, or profile, that would do.")
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="With --fix: write without asking.")] = False,
    as_json: Json = False,
) -> None:
    """Check mocap, axes, links, clocks and parameters before a motor turns. Exit code 1 if any check fails."""
    config = configuration(lab)
    import uvloop

    from gcs.finding import as_dicts, failed
    from gcs.mocap.service import ServiceError

    try:
        findings = uvloop.run(_doctor(config, lab, seconds, still, as_json, _Fixing(fix, yes)))
    except ServiceError as error:
        fail(str(error), error.code)
    except ValueError as error:
        fail(str(error), NOT_RIGHT)
    except OSError as error:
        fail(str(error), REFUSED)
    if as_json:
        print(json.dumps(as_dicts(findings)))
    if failed(findings):
        raise typer.Exit(REFUSED)


def logs(
    lab: LabFile,
    out: Annotated[Path, typer.Option(help="Where to put them.")] = Path("logs"),
    newest: Annotated[int, typer.Option(min=1, help="How many of each drone, from the newest on.")] = 1,
    sysid: Annotated[list[int] | None, typer.Option(help="Only this drone; as often as needed.")] = None,
) -> None:
    """Download the drones' own flight logs."""
    config = configuration(lab)
    import uvloop

    from gcs.mocap.service import ServiceError
    from wire.private_files import make_folder

    make_folder(out)
    try:
        problems = uvloop.run(_logs(config, lab, out, newest, sysid))
    except ServiceError as error:
        fail(str(error), error.code)
    except (OSError, ValueError) as error:
        fail(str(error), NOT_RIGHT)
    for problem in problems:
        tell_red(problem)
    if problems:
        raise typer.Exit(REFUSED)


class _Fixing:
    """Whether to write what would put findings right, and whether to ask first."""

    def __init__(self, wanted: bool, unasked: bool) -> None:
        self.wanted = wanted
        self._unasked = unasked

    def agreed(self, question: str) -> bool:
        """Whether it is to be written."""
        return self._unasked or typer.confirm(question, err=True)


async def _doctor(
    config: "LabConfig", lab_file: Path, seconds: float, still: bool, as_json: bool, fixing: _Fixing
) -> Sequence["Finding"]:
    from rich.console import Console

    from gcs.doctor.survey import examine, surveying  # loads MAVSDK
    from gcs.finding import show

    async with surveying(config, lab_file, tell) as survey:
        findings = await examine(config, max(seconds, SETTLE_S), None if still else _prompt, survey)
        if not as_json:
            show(findings, Console(width=None if sys.stdout.isatty() else WIDTH))
        if fixing.wanted:
            await _write(survey, findings, fixing)
        return findings


async def _write(survey: "Survey", findings: Sequence["Finding"], fixing: _Fixing) -> None:
    """Write what is agreed to; what was found stays found until the doctor is asked again."""
    written = 0
    for finding in findings:
        name, fix, refit = finding.subject, finding.fix, finding.refit
        if fix is not None and fixing.agreed(f"{name}: write {fix.parameter} = {fix.value:g} (is {finding.found})?"):
            taken = await survey.write(fix)
            written += taken
            words = "written" if taken else "NOT taken"
            print(f"{name}: {fix.parameter} {words}", file=sys.stderr)
        if refit is not None and fixing.agreed(
            f"{name}: write a profile that hovers at {finding.found} to a file here?"
        ):
            print(f"{name}: {write_profile(refit, Path())}", file=sys.stderr)
    if written:
        print("Restart the autopilots, some parameters count from there; then ask the doctor again.", file=sys.stderr)


def write_profile(refit: "Refit", folder: Path) -> str:
    """Write it; what to tell of that. The lab file itself is its owner's: nobody but a person changes it."""
    try:
        path = refit.write(folder)
    except FileExistsError as error:
        return f"{error.filename} is there already, NOT written"
    return f'{path} written: append it to the lab file as it is, and write profile = "{refit.name}" in its entry'


async def _logs(config: "LabConfig", lab_file: Path, out: Path, newest: int, only: list[int] | None) -> list[str]:
    import asyncio

    from gcs.doctor.mavsdk_drone import DroneError
    from gcs.doctor.survey import surveying  # loads MAVSDK

    problems = []
    async with surveying(config, lab_file, tell) as survey:
        await asyncio.sleep(SETTLE_S)
        for vehicle in config.vehicles:
            if vehicle.sysid is None or (only and vehicle.sysid not in only):
                continue
            try:
                await survey.fetch_logs(vehicle.sysid, out, newest, print)
            except DroneError as error:
                problems.append(str(error))
    return problems


async def _prompt(text: str) -> None:
    """Say what to do, wait for Enter; ValueError where nobody is there to press it."""
    import asyncio

    print(f"{text}, then press Enter.", file=sys.stderr, flush=True)
    if not await asyncio.to_thread(sys.stdin.readline):
        raise ValueError("nobody is there to move the drones: use --still")
