"""`gcs doctor` and `gcs logs`: the terminal around the survey."""

import json
import sys
from collections.abc import Coroutine, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from formation.exposure import GROUND
from wire.process.program import (
    Insecure,
    Json,
    LabFile,
    configuration,
    fail,
    print_error,
    print_event,
    print_json_error,
    refusing,
)
from wire.process.system import REJECTED

if TYPE_CHECKING:
    from formation.config import LabConfig
    from gcs.doctor.survey import Survey
    from gcs.finding import Finding, Fix, Refit
    from wire.security.protection import Protection

T = TypeVar("T")
SETTLE_S = 3.0


def doctor(
    lab: LabFile,
    still: Annotated[bool, typer.Option("--still", help="Skip the moves by hand that prove axes and names.")] = False,
    fix: Annotated[
        bool, typer.Option("--fix", help="Offer to write each parameter, or profile, that would do.")
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="With --fix: write without asking.")] = False,
    as_json: Json = False,
    insecure: Insecure = False,
) -> None:
    """Check mocap, axes, links, clocks and parameters before a motor turns. Exit code 1 if any check fails."""
    config = configuration(lab)
    options = _FixOptions(fix, yes)
    findings = _run(_doctor(config, lab, still, as_json, options, insecure))
    from gcs.finding import as_dicts, failed

    if as_json:
        print(json.dumps(as_dicts(findings)))
    if failed(findings):
        raise typer.Exit(REJECTED)


def logs(
    lab: LabFile,
    out: Annotated[Path, typer.Option(help="Where to put them.")] = Path("logs"),
    sysid: Annotated[list[int] | None, typer.Option(help="Only this drone; as often as needed.")] = None,
    as_json: Json = False,
    insecure: Insecure = False,
) -> None:
    """Download the newest flight log of each drone."""
    config = configuration(lab)
    from wire.files import make_folder

    make_folder(out)
    problems = _run(_logs(config, lab, out, sysid, as_json, insecure))
    for problem in problems:
        print_error(problem)
    if problems:
        raise typer.Exit(REJECTED)


def _run(work: Coroutine[Any, Any, T]) -> T:
    """Its result; ends the program where the mocap, the links or an operator's wish are not right."""
    import uvloop

    from mocap.service import ServiceError

    try:
        with refusing(ValueError):
            return uvloop.run(work)
    except ServiceError as error:
        fail(str(error), error.code)


class _FixOptions:
    """Whether to write what would put findings right, and whether to ask first."""

    def __init__(self, wanted: bool, unasked: bool) -> None:
        self.wanted = wanted
        self.unasked = unasked

    def agreed(self, question: str) -> bool:
        """Whether it is to be written."""
        return self.unasked or typer.confirm(question, err=True)


async def _doctor(
    config: "LabConfig",
    lab_file: Path,
    still: bool,
    as_json: bool,
    fixing: _FixOptions,
    insecure: bool,
) -> Sequence["Finding"]:
    from gcs.doctor.restart_record import read_record
    from gcs.doctor.survey import examine, surveying  # loads MAVSDK

    recorded = read_record(lab_file)
    async with surveying(config, lab_file, print_event, _protection(config, lab_file, insecure)) as survey:
        survey.recall(recorded)
        findings = await examine(config, None if still else _prompt, survey)
        note_fixes(lab_file, (f.fix for f in findings if f.fix is not None and survey.reads_at_boot(f.fix)))
        if not as_json:
            _show(findings)
        if fixing.wanted:
            await _write(survey, lab_file, findings, fixing)
        return findings


def _show(findings: Sequence["Finding"]) -> None:
    from rich.console import Console

    from gcs.finding import show

    show(findings, Console(width=None if sys.stdout.isatty() else 150))


async def _write(survey: "Survey", lab_file: Path, findings: Sequence["Finding"], fixing: _FixOptions) -> None:
    """Write what is agreed to; what was found stays found until the doctor is asked again."""
    written: list[Fix] = []
    for finding in findings:
        name, fix, refit = finding.subject, finding.fix, finding.refit
        if fix is not None and fixing.agreed(f"{name}: write {fix.parameter} = {fix.value:g} (is {finding.found})?"):
            accepted = await survey.write(fix)
            if accepted:
                written.append(fix)
            if accepted and survey.reads_at_boot(fix):
                note_fixes(lab_file, [fix])
            words = "written" if accepted else "NOT accepted"
            print(f"{name}: {fix.parameter} {words}", file=sys.stderr)
        if refit is not None and fixing.agreed(
            f"{name}: write a profile that hovers at {finding.found} to a file here?"
        ):
            print(f"{name}: {write_profile(refit, Path())}", file=sys.stderr)
    if written:
        await _detect_restarts(survey, lab_file, written, fixing)


async def _detect_restarts(survey: "Survey", lab_file: Path, written: "Sequence[Fix]", fixing: _FixOptions) -> None:
    """Wait until what was written is saved and, where an operator is there, restarted; then read it back."""
    import asyncio

    from gcs.doctor.restart_record import drop_met
    from wire.clock import REAL_TIME

    print("Waiting until the autopilots have saved it ...", file=sys.stderr)
    await asyncio.sleep(SETTLE_S)
    sysids = {fix.sysid for fix in written}
    if fixing.unasked or not sys.stdin.isatty():
        print("Restart the autopilots, some parameters count from there; then ask the doctor again.", file=sys.stderr)
        return
    since_ns = REAL_TIME.monotonic_ns()
    print("Restart the autopilots now; Ctrl-C: later, then ask the doctor again.", file=sys.stderr)
    await survey.detect_restarts(sysids, since_ns)
    drop_met(lab_file, survey.booted_ns, REAL_TIME)
    for fix in written:
        found = await survey.read(fix)
        is_saved = found is not None and abs(found - fix.value) < 1e-3
        words = "kept" if is_saved else "NOT kept: " + ("no answer" if found is None else f"{found:g}")
        print(f"{survey.drones[fix.sysid].name}: {fix.parameter} {words}", file=sys.stderr)


def note_fixes(lab_file: Path, fixes: "Iterable[Fix]") -> None:
    """Record that these were not as wanted until now: what is set right counts from the next boot on."""
    from gcs.doctor.restart_record import note_unmet
    from wire.clock import unix_us

    for fix in fixes:
        note_unmet(lab_file, fix.sysid, fix.parameter, unix_us() * 1e-6)


def write_profile(refit: "Refit", folder: Path) -> str:
    """Write the profile to a file and return a text about it. The doctor never changes the lab file itself."""
    try:
        path = refit.write(folder)
    except FileExistsError as error:
        return f"{error.filename} is there already, NOT written"
    return f'{path} written: append it to the lab file as it is, and write profile = "{refit.name}" in its entry'


async def _logs(
    config: "LabConfig",
    lab_file: Path,
    out: Path,
    only: list[int] | None,
    as_json: bool,
    insecure: bool,
) -> list[str]:
    import asyncio

    from gcs.doctor.mavsdk_drone import DroneError
    from gcs.doctor.survey import surveying  # loads MAVSDK

    def report(text: str) -> None:
        print(json.dumps({"text": text}) if as_json else text, flush=True)

    problems = []
    async with surveying(config, lab_file, print_event, _protection(config, lab_file, insecure)) as survey:
        await asyncio.sleep(SETTLE_S)
        for vehicle in config.vehicles:
            if vehicle.sysid is None or (only and vehicle.sysid not in only):
                continue
            try:
                await survey.fetch_log(vehicle.sysid, out, report)
            except DroneError as error:
                problems.append(str(error))
                print_json_error(str(error))
    return problems


def _protection(config: "LabConfig", lab_file: Path, insecure: bool) -> "Protection":
    """The doctor is on the links as the ground is. ConfigError."""
    from wire.security.protection import lab_protection

    return lab_protection(config.security, lab_file, GROUND, insecure=insecure)


async def _prompt(text: str) -> None:
    """Print the instruction and wait for Enter; ValueError without an operator."""
    import asyncio

    print(f"{text}, then press Enter.", file=sys.stderr, flush=True)
    if not await asyncio.to_thread(sys.stdin.readline):
        raise ValueError("nobody is there to move the drones: use --still")
