"""No command writes over what it did not write itself: each, run twice, leaves its first output as it is."""

import hashlib
import inspect
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_type_hints

import pytest
import tomli_w
import typer
from typer.testing import CliRunner, Result

from formation.messages import Tick
from formation.topics import TICK
from formation.vehicle.profile import PAPER_40G, GainScale
from gcs.cli.app import app as gcs_app
from sim.cli.app import app as sim_app
from sim.cli.log import app as log_app
from tests.analysis.synthetic_flight import METADATA, Recipe, written
from tests.gcs.security.test_keys import LAB
from tests.sim.short_scenario import SHORT
from wire.logs.mcap_write import LogWriter

PROGRAMS = {"gcs": gcs_app, "gcs-sim": sim_app, "gcs-log": log_app}
INPUTS = {
    "lab",
    "leader_csv",
    "name",
    "csv",
    "gains",
    "neural_fly",
    "check",
    "file",
    "source",
    "first",
    "second",
    "flights",
}
ELSEWHERE = {
    "gcs-log list": "--sqlite: the newest catalogue is one table of a database that stays",
    "gcs-log import": "a log that is there is refused: tests/analysis/imports/test_import.py",
    "gcs-log join": "as by import",
    "gcs keys install": "keys that are there are refused: tests/gcs/security/test_keys.py",
    "gcs logs": "a drone's logs have numbers of their own: gcs.doctor.mavsdk_drone.fetch_log",
}
NUMBERED, REFUSED = 0, 2
RUNS: dict[str, tuple[str, int]] = {
    "gcs run": ("lab.toml --log runs/flight.mcap", NUMBERED),
    "gcs check": ("lab.toml --svg lab.svg", NUMBERED),
    "gcs rehearse": ("lab.toml --out rehearsed", NUMBERED),
    "gcs keys pack": ("drone-2 --out drone-2.keys", REFUSED),
    "gcs keys token": ("anna --out anna.token", REFUSED),
    "gcs service install": ("lab.toml --user root --to .", REFUSED),
    "gcs-sim fly": ("short.toml --out flown", NUMBERED),
    "gcs-sim run": ("short.toml --out first", NUMBERED),
    "gcs-sim campaign": ("--replay 1:0 --log again.mcap", NUMBERED),
    "gcs-sim paper": ("--out tables --seeds 1", NUMBERED),
    "gcs-sim tune": ("paper_40g --out tuned.toml", REFUSED),
    "gcs-sim league": ("default --out tables", NUMBERED),
    "gcs-log whatif": ("flight.mcap", NUMBERED),
    "gcs-log report": ("flight.mcap", NUMBERED),
    "gcs-log picture": ("flight.mcap", NUMBERED),
    "gcs-log compare": ("flight.mcap flight.mcap", NUMBERED),
    "gcs-log layout": ("flight.mcap", NUMBERED),
    "gcs-log export": ("flight.mcap --csv", NUMBERED),
    "gcs-log identify": ("flight.mcap --write left.toml", REFUSED),
    "gcs-log paper": ("flight.mcap", NUMBERED),
}
"""Every command that writes where it is told, or beside a log: its words, and how its second run ends."""


def commands(command: Any, words: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    if not hasattr(command, "commands"):
        yield " ".join(words), command
        return
    for name, part in command.commands.items():
        yield from commands(part, (*words, name))


def test_every_path_that_a_command_takes_is_read_or_stands_in_the_table() -> None:
    for program, app in PROGRAMS.items():
        for words, command in commands(typer.main.get_command(app), (program,)):
            hints = get_type_hints(inspect.unwrap(command.callback))
            read = INPUTS | ({"log", "folder"} if program == "gcs-log" else set())
            outputs = {name for name, kind in hints.items() if "Path" in str(kind)} - read
            assert not outputs or words in {*RUNS, *ELSEWHERE}, f"{words} writes {outputs}: add it to RUNS"
            assert words not in RUNS or "overwrite" in hints, words


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log, a lab with its keys, and a scenario."""
    folder = tmp_path_factory.mktemp("given")
    written(folder / "flight.mcap", Recipe(), METADATA)
    (folder / "lab.toml").write_text(tomli_w.dumps(LAB))
    (folder / "short.toml").write_text(SHORT)
    CliRunner().invoke(gcs_app, ["keys", "new", str(folder / "lab.toml")])
    return folder


@pytest.fixture
def here(given: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with these; what takes minutes, or needs drones, is played."""
    shutil.copytree(given, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)

    def log_at(path: Path, overwrite: bool = False) -> Path:
        path.parent.mkdir(exist_ok=True)
        with LogWriter(path, {}, threaded=False, overwrite=overwrite) as log:
            log.write(TICK, Tick(0), 0)
        return log.path

    flown = SimpleNamespace(outcome=SimpleNamespace(result="held", is_good=True), realtime_factor=1.0)
    study = SimpleNamespace(
        to_json=str,
        comes_back=True,
        result="held",
        violations=(),
    )
    study.verdict = SimpleNamespace(contained=True, violations=())
    best = SimpleNamespace(cost=1.0, margin="", gain_scale=GainScale())
    drone = SimpleNamespace(vehicle=SimpleNamespace(sysid=2), profile=lambda _share: PAPER_40G, unknown=lambda: ())
    identified = SimpleNamespace(drones=(drone,))
    played: dict[str, Callable[..., Any]] = {
        "gcs.daemon.serve": lambda _config, options: log_at(options.log, options.overwrite),
        "gcs.lab.findings.approved": lambda *_, **_more: SimpleNamespace(name="lab", link_kinds=""),
        "gcs.cli.app.subprocess": SimpleNamespace(run=rehearsed),
        "sim.cli.flights.compile_for": lambda *_: None,
        "sim.cli.flights.fly_processes": lambda _scenario, _seed, files, *_: later(log_at(files.mcap)),
        "sim.cli.flights._conclude": lambda *_, **_more: flown,
        "sim.cli.flights._end": lambda *_: None,
        "sim.lockstep.run_to_file": lambda _scenario, _seed, path, *_, overwrite=False: (
            log_at(path, overwrite) and flown
        ),
        "sim.cli.conclude.conclude": lambda *_, **_more: (None, None),
        "analysis.console.print_summary": lambda *_: None,
        "sim.cli.campaign.fly": lambda _scenario, _seed, record: record(TICK, Tick(0), 0) or study,
        "sim.cli.campaign._page": lambda *_: "",
        "sim.research.paper.jobs": lambda *_: [],
        "sim.research.paper.compare": lambda *_: study,
        "sim.research.paper_page.console_tables": lambda *_: (),
        "sim.research.paper_page.html": lambda *_: "",
        "sim.research.paper_page.publish": lambda _of, folder: (folder / "table-1.tex").write_text(""),
        "sim.research.league.rows": lambda *_: [],
        "sim.runner.Runner.run": lambda *_: [],
        "sim.research.league_page.console_tables": lambda *_: (),
        "sim.research.league_page.html": lambda *_: "",
        "sim.research.tune.tune": lambda *_: (best, best),
        "sim.research.whatif.what_if": lambda *_: study,
        "sim.research.whatif_page.html": lambda *_: "",
        "sim.research.whatif_page.print_what_if": lambda *_: None,
        "analysis.report.html": lambda *_: "",
        "analysis.identify.vehicle.identify": lambda *_: identified,
        "analysis.identify.report.print_identification": lambda *_: None,
    }
    for name, does in played.items():
        monkeypatch.setattr(name, does)
    return tmp_path


def rehearsed(words: list[str], check: bool) -> SimpleNamespace:
    """As `gcs-sim run` writes into the folder that it is given."""
    log = Path(words[words.index("--out") + 1]) / "flight.mcap"
    with LogWriter(log, {}, threaded=False, overwrite="--overwrite" in words):
        return SimpleNamespace(returncode=int(check))


async def later(value: Any) -> Any:
    return value


def hashes(folder: Path) -> dict[str, str]:
    """Of every file below it but the lab's own records: its keys' folder, its last rehearsal."""
    files = (
        path
        for path in folder.rglob("*")
        if path.is_file() and "keys" not in path.parts and path.name != "lab-rehearsal.toml"
    )
    return {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.mark.parametrize("words", RUNS)
def test_a_second_run_changes_nothing_of_the_first_by_a_bit(words: str, here: Path) -> None:
    (options, ends), (program, *command) = RUNS[words], words.split()

    def run(*more: str) -> Result:
        return CliRunner().invoke(PROGRAMS[program], [*command, *options.split(), *more])

    was = hashes(here)
    first = run()
    before = hashes(here)
    assert first.exit_code == 0, (first.output, first.exception)
    assert before.items() >= was.items()
    assert len(before) > len(was)
    second = run()
    after = hashes(here)
    assert (second.exit_code, after.items() >= before.items()) == (ends, True), second.output
    if ends == REFUSED:
        assert after == before
        assert "is there already: --overwrite writes over it" in second.stderr
    else:
        assert len(after) > len(before)
        assert "the name is in use, so this is " in second.stderr
        assert "-2" in second.stderr
    over = run("--overwrite")
    assert over.exit_code == 0, (over.output, over.exception)
    assert hashes(here).keys() == after.keys()
