"""The work of `gcs-sim fly`, `run`, `mocap`, `check` and `compile`: a scenario becomes a flight, its log a page."""

import asyncio
import os
import signal
import sys
from collections.abc import Coroutine, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryFile
from types import TracebackType
from typing import TYPE_CHECKING, Any, NoReturn, Self, TypeVar

import typer
import uvloop
from rich.console import Console
from rich.text import Text

from analysis.console import print_summary
from analysis.metrics import Requirement, Summary, parse_requirement, unmet
from formation.codes import FlightResult, Outcome
from formation.config import LabConfig
from formation.guidance.shape import shape_for
from formation.guidance.shape_request import parse
from formation.messages import Verb
from formation.model import UNIT_WITHIN, QuatTuple
from formation.requests import GCS_NAME
from formation.security_config import SecurityConfig
from gcs.finding import Finding, Grade
from gcs.lab import cli as lab_cli
from gcs.lab.findings import line
from gcs.lab.judge import SECURITY, judge
from mocap.sources.csv_file import MocapFileError
from sim import lockstep
from sim.cameras import daemon as mocap_daemon
from sim.cameras.systems import lab_with
from sim.fly import Files
from sim.fly import fly as fly_processes
from sim.fly import practise as practise_processes
from sim.lab_file import stand_ins
from sim.ports import private_link
from sim.processes import ProcessDied
from sim.scenario import Scenario, ScenarioFile, find, load, recorded_leader, with_leader_file
from wire import clock
from wire.config_file import lines_of
from wire.errors import ConfigError
from wire.files import BY_PROCESSES, IN_LOCKSTEP, new_folder, partial, run_folder
from wire.logs.mcap_scan import LogError
from wire.process.daemon import LATE_NS, STARVED, StarvedError
from wire.process.output import dropping_output
from wire.process.program import print_json_error
from wire.process.progress import compile_all
from wire.process.system import NOT_RIGHT
from wire.security.private_keys import keys_folder

if TYPE_CHECKING:
    from sim.cli.app import FlyOptions

T = TypeVar("T")
ABORTED, INTERRUPTED = 1, 130
TIMED_S = 10.0
"""Flight in lockstep by which the machine is timed, s: a second's work where it has nothing else to do."""
REAL_TIME_FACTOR = 5.0
"""How much faster than time lockstep is where real processes keep up: measured, three drones in six processes take 6.8
times its CPU time (0.78 and 0.115 s a second), on two cores of which a third is left."""
SLOWEST = 0.1
"""No flight is slowed further unasked: it lasts minutes then, and a machine that pauses for seconds fails it anyway."""
LOG_BYTES = 32 << 20
"""Log and report of a flight of two minutes."""


@dataclass(frozen=True, slots=True)
class RunOutput:
    """The output of a run: how its numbers are printed, its folder if given, the requirements on them, whether the
    folder may hold another run's."""

    as_json: bool
    out: Path | None
    required: tuple[Requirement, ...]
    overwrite: bool = False


def fly(options: "FlyOptions") -> None:
    """In real time, or slower; ends the process with its exit code."""
    ending = RunOutput(options.as_json, options.out, required(options.require), options.overwrite)
    summary, aborted_code = _fly(_opened(options), options, ending)
    _end(summary, ending, aborted_code)


def _opened(options: "FlyOptions") -> ScenarioFile:
    return scenario_of(options.name, options.leader_csv, options.leader_alignment)


@dropping_output()
def practise(options: "FlyOptions") -> None:
    """Cameras and drones alone, on ports of their own, until Ctrl-C; ends the process where one of them ends."""
    grounds = {
        "--watch": options.watch, "--force": options.force, "--require": options.require, "--json": options.as_json,
    }  # fmt: skip
    if unused := [option for option, value in grounds.items() if value]:
        text = f"--practice starts no ground, and has no {', '.join(unused)}: `gcs run` has --page, --force and --json"
        fail(text, NOT_RIGHT)
    opened = _opened(options)
    scenario, files = opened.scenario, _files(options.out, opened.scenario, options.overwrite, BY_PROCESSES)
    compile_for(scenario)
    with _own_link(opened, options) as lab:
        scenario, speed = scenario.model_copy(update={"lab": lab}), clock.Clock(options.speed or 1.0)
        practice = practise_processes(scenario, _seed(options.seed, scenario), files, typer.echo, speed, options.hosts)
        try:
            asyncio.run(_interruptible(practice))
        except ProcessDied as error:
            fail(f"{error} (see {files.folder})", ABORTED)


@contextmanager
def _own_link(opened: ScenarioFile, options: "FlyOptions") -> Iterator[LabConfig]:
    """The lab as it is flown: on links of its own, by the cameras and with the keys of the options."""
    lab = opened.scenario.lab
    if options.mocap and opened.lab is not None:  # what the lab file says of its own cameras
        lab = lab.model_copy(update={"mocap": opened.lab.mocap})
    if options.signed and options.hosts is not None:
        fail("--hosts: drones with keys are processes of their own", NOT_RIGHT)
    if options.signed:
        lab = lab.model_copy(update={"security": _security(opened)})
    with private_link(options.link, (v.sysid for v in lab.vehicles if v.sysid is not None)) as link:
        lab = lab.model_copy(update={"link": link.model_copy(update={"imu_rate_hz": lab.link.imu_rate_hz})})
        yield lab_with(lab, options.mocap) if options.mocap else lab


@dropping_output()
def _fly(opened: ScenarioFile, options: "FlyOptions", ending: RunOutput) -> tuple[Summary, int]:
    scenario = opened.scenario
    files = _files(ending.out, scenario, ending.overwrite, BY_PROCESSES)
    compile_for(scenario)
    speed = _speed(options.speed, scenario)
    with (
        _own_link(opened, options) as lab,
        Display(Console(stderr=ending.as_json), scenario.name) as display,
    ):
        scenario = scenario.model_copy(update={"lab": lab})
        flown = asyncio.run(
            _interruptible(
                fly_processes(
                    scenario,
                    _seed(options.seed, scenario),
                    files,
                    display.progress,
                    options.force,
                    speed,
                    options.watch,
                    options.hosts,
                )
            )
        )
    outcome = flown or Outcome(FlightResult.ABORTED, "interrupted")
    try:
        flown_at = speed.speed if flown and not scenario.mocap.stall_s else None  # what is held back on purpose is late
        return _conclude(files, outcome, speed=flown_at), ABORTED if flown else INTERRUPTED
    except (FileNotFoundError, LogError):
        fail(f"nothing was logged: {outcome.reason} (see {files.folder})", ABORTED)


def fitting_speed(scenario: Scenario) -> float:
    """The speed at which the machine keeps up beside all else that it does, by the beginning of the flight in lockstep.

    As slow as its share of the CPU asks for, and as its longest pause does, twice as long, for no simulator to be late.
    """
    at_ns = []
    flown = lockstep.fly(
        scenario.model_copy(update={"longest_s": TIMED_S}),
        scenario.seed,
        lambda _topic, _message, _t_ns: None,
        lambda _t_s, _phase: at_ns.append(clock.monotonic_ns()),
    )
    pause_ns = max(end - start for start, end in pairwise(at_ns))
    return round(max(SLOWEST, min(1.0, flown.realtime_factor / REAL_TIME_FACTOR, 0.5 * LATE_NS / pause_ns)), 2)


def _speed(asked: float | None, scenario: Scenario) -> clock.Clock:
    """As the user says, else as the machine keeps up, which is said where it is slower than time."""
    speed = fitting_speed(scenario) if asked is None else asked
    if asked is None and speed < 1.0:
        text = f"gcs-sim: flying at {speed:g} of real time, so that this machine keeps up (--speed 1: in real time)"
        print(text, file=sys.stderr, flush=True)
    return clock.Clock(speed)


def run(scenario: Scenario, seed: int | None, ending: RunOutput) -> None:
    """In lockstep; ends the process with its exit code."""
    _end(_run(scenario, seed, ending), ending)


@dropping_output()
def _run(scenario: Scenario, seed: int | None, ending: RunOutput) -> Summary:
    files = _files(ending.out, scenario, ending.overwrite, IN_LOCKSTEP)
    compile_for(scenario)
    with Display(Console(stderr=ending.as_json), scenario.name) as display:
        seed = _seed(seed, scenario)
        flown = lockstep.run_to_file(scenario, seed, files.mcap, display.progress, overwrite=files.overwrite)
    return _conclude(files, flown.outcome, flown.realtime_factor)


def _conclude(
    files: Files, outcome: Outcome, realtime_factor: float | None = None, speed: float | None = None
) -> Summary:
    """The numbers of a log whose report is written; ends the process where the disk does not take it."""
    from sim.cli.conclude import conclude  # its plots; the emulated mocap needs none

    try:
        return conclude(files.mcap, outcome, realtime_factor, speed, files.overwrite)[1]
    except FileNotFoundError:
        raise
    except OSError as error:
        fail(f"no report: {error.filename or files.folder}: {error.strerror}", ABORTED)


def mocap(scenario: Scenario, seed: int | None, speed: float) -> None:
    """The emulated mocap, until a signal ends it."""
    try:
        uvloop.run(mocap_daemon.serve(scenario, _seed(seed, scenario), GCS_NAME, clock.Clock(speed)))
    except OSError as error:
        fail(str(error), NOT_RIGHT)
    except StarvedError as error:
        fail(str(error), STARVED)


def _security(opened: ScenarioFile) -> SecurityConfig:
    """Where the keys of the lab file that is flown are; ends the program where it has none."""
    lab, file = opened.lab, opened.lab_file
    if lab is None or file is None or lab.security is None:
        fail("--signed: fly a lab file that has [security]", NOT_RIGHT)
    keys = keys_folder(lab.security.keys, file.resolve())
    return lab.security.model_copy(update={"keys": str(keys)})


async def _interruptible(flight: Coroutine[Any, Any, T]) -> T | None:
    """The flight's outcome, None where SIGINT or SIGTERM ended it; the second signal does not wait for a landing."""
    flying = asyncio.create_task(flight)
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, flying.cancel)
    try:
        return await flying
    except asyncio.CancelledError:
        return None


def scenario_of(name: str, leader_csv: Path | None = None, alignment: str | None = None) -> ScenarioFile:
    """The scenario with the leader given; ends the process where either is not right, or `gcs run` refuses its lab."""
    try:
        opened = find(name)
        check_lab(opened)
        file = None if leader_csv is None else str(leader_csv.absolute())
        scenario = with_leader_file(opened.scenario, file, None if alignment is None else _quaternion(alignment))
        if scenario.needs_leader_file and scenario.leader.file is None:
            raise ValueError(f"{scenario.name} needs a recorded leader: --leader-csv FILE")
        recorded_leader(scenario)
    except (ConfigError, MocapFileError, ValueError) as error:
        fail(str(error), NOT_RIGHT)
    if opened.lab is not None:
        stand_ins_text = f"{opened.lab_file}: {stand_ins(opened.lab)}"
        Console(stderr=True).print(stand_ins_text, highlight=False, markup=False, soft_wrap=True)
    return replace(opened, scenario=scenario)


def check_lab(opened: ScenarioFile) -> None:
    """ConfigError where the scenario flies a lab file that `gcs run` refuses; its links are simulated, on loopback."""
    if opened.lab is not None and opened.lab_file is not None:
        found = (finding for finding in judge(opened.lab) if finding.check != SECURITY)
        failed = [finding for finding in found if finding.grade is Grade.FAIL]
        if failed:
            at = lines_of(opened.lab_file)
            raise ConfigError([line(finding, at) for finding in failed])


def compile_for(scenario: Scenario) -> None:
    """Everything that any process of the scenario runs; the processes find it in the cache on disk."""
    compile_all("gcs-sim", lambda: lockstep.warm_up(scenario), sys.stderr, beside=lockstep.warm_up_ground)


def compile_everything() -> None:
    """Compile what any flight runs."""
    compile_for(load(lockstep.ANY_SCENARIO))


def _quaternion(text: str) -> QuatTuple:
    """Unit quaternion of "w,x,y,z"; ValueError for anything else."""
    try:
        w, x, y, z = (float(part) for part in text.split(","))
    except ValueError as error:
        raise ValueError(f"--leader-alignment {text}: expected four numbers W,X,Y,Z") from error
    norm = (w * w + x * x + y * y + z * z) ** 0.5
    if not abs(norm - 1.0) < UNIT_WITHIN:
        raise ValueError(f"--leader-alignment {text}: its length is {norm:.3g}, not 1")
    return w / norm, x / norm, y / norm, z / norm


def _seed(requested: int | None, scenario: Scenario) -> int:
    return scenario.seed if requested is None else requested


def _files(out: Path | None, scenario: Scenario, overwrite: bool, names: Sequence[str]) -> Files:
    """A folder for this run, in which its log has room; ends the process where there is none."""
    folder = out or run_folder(scenario.name, clock.unix_us())
    try:
        folder = new_folder(folder, overwrite, names)
        files = Files(folder, overwrite=overwrite)
        for old in (files.mcap, partial(files.mcap)):  # a ground that is killed leaves no other's log as its own
            old.unlink(missing_ok=True)
        with TemporaryFile(dir=folder) as probe:
            os.posix_fallocate(probe.fileno(), 0, LOG_BYTES)
    except OSError as error:
        fail(f"{folder}: no flight can be recorded here: {error.strerror}", NOT_RIGHT)
    return files


def _end(summary: Summary, ending: RunOutput, aborted_code: int = ABORTED) -> None:
    """Show the run's numbers; end with `aborted_code` where it did not land, ABORTED where it missed a requirement."""
    if ending.as_json:
        print(summary.to_json())
    else:
        print_summary(summary, Console())
    if summary.outcome.result is FlightResult.STARVED:
        _print_error(str(summary.outcome))
        raise typer.Exit(STARVED)
    if not summary.outcome.is_good:
        _print_error(str(summary.outcome))
        raise typer.Exit(aborted_code)
    if unmet_requirements := unmet(ending.required, summary):
        _print_error("; ".join(unmet_requirements))
        raise typer.Exit(ABORTED)


def required(texts: Sequence[str] | None) -> tuple[Requirement, ...]:
    """The requirements of `--require`; ends the process where it is not understood."""
    try:
        return tuple(parse_requirement(text) for text in texts or ())
    except ValueError as error:
        fail(f"--require: {error}", NOT_RIGHT)


def fail(text: str, code: int) -> NoReturn:
    """End the program with a word and an exit code."""
    print_json_error(text)
    _print_error(text)
    raise typer.Exit(code)


def _print_error(text: str) -> None:
    Console(stderr=True).print(f"gcs-sim: {text}", style="red", highlight=False, markup=False, soft_wrap=True)


class Display:
    """A context in which `progress` keeps a status line up to date and leaves a line for each phase."""

    def __init__(self, console: Console, title: str) -> None:
        self._console = console
        self._title = title
        self._status = console.status(Text(title))
        self._phase = ""

    def __enter__(self) -> Self:
        self._status.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._status.stop()

    def update(self, text: str) -> None:
        """Show what is going on, without a time."""
        self._status.update(Text(f"{self._title}: {text}"))

    def progress(self, t_s: float, phase: str) -> None:
        """The flight is in `phase`, `t_s` after its beginning."""
        if phase != self._phase:
            self._phase = phase
            self._console.print(f"{t_s:7.1f} s  {phase}", highlight=False, markup=False)
        self._status.update(Text(f"{self._title}: {phase}, {t_s:.1f} s"))


def check(file: Path, as_json: bool) -> None:
    """Judge and draw; ends the program with its exit code, as `gcs check` does."""
    try:
        opened = find(str(file))
    except ConfigError as error:
        lab_cli.not_right(Path(error.source or file), error, as_json)
        return
    lab_cli.judge_lab(file, _lab(opened), as_json, tuple(_findings(opened.scenario)))


def _lab(opened: ScenarioFile) -> LabConfig:
    """The lab as its file has it, real links and all."""
    return opened.scenario.lab if opened.lab is None else opened.lab


def _findings(scenario: Scenario) -> Iterator[Finding]:
    """Findings where the scenario itself asks for what its lab does not have."""
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
