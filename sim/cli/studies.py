"""The studies of `gcs-sim`, `paper`, `tune`, `league` and `foretell`: many flights, a table, files for scripts.

What they need is loaded when they are called: asking for help waits for no compiler.
"""

import json
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from wire.errors import ConfigError
from wire.process.program import Overwrite
from wire.process.system import NOT_RIGHT

if TYPE_CHECKING:
    from formation.control.presets import Preset
    from formation.vehicle.profile import VehicleProfile
    from sim.research.gain_search import Tried
    from sim.research.host import Host
    from sim.research.league import Result, Row
    from sim.research.tune import Candidate, Task
    from sim.runner import Runner

FAILED = 1
PAPER_SEEDS = 10
OutFolder = Annotated[Path, typer.Option(help="Where the files go.")]
Full = Annotated[
    bool, typer.Option("--full", help="Fly in lockstep, with MAVLink, guards and autopilots: some ten times as long.")
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else there.")]


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command("paper")(compare)
    app.command("tune")(tune_vehicle)
    app.command("league")(play_league)
    app.command("foretell")(foretell_flight)


def compare(
    out: OutFolder = Path(),
    seeds: Annotated[int, typer.Option(min=1, help="How many seeds, from 1.")] = PAPER_SEEDS,
    vehicle: Annotated[
        str, typer.Option(help="What is flown: a shipped vehicle's name, or a profile's TOML file.")
    ] = "paper_40g",
    only: Annotated[list[str] | None, typer.Option(help="Fly this controller alone; can be given again.")] = None,
    full: Full = False,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Fly the paper's gust, line and circle with seven controllers.

    Writes paper.json and .html, and the paper's figures (PDF, SVG) and tables (LaTeX) into the folder figures.
    """
    from sim.research import paper, paper_page
    from sim.research.experiments import CONTROLLERS
    from sim.runner import Runner
    from wire.files import new_folder

    console = Console(stderr=as_json, markup=False)
    try:
        flights = paper.jobs(range(1, seeds + 1), vehicle_profile(vehicle), tuple(only or CONTROLLERS), host_of(full))
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    runner = Runner(console)
    comparison = paper.compare(flights, runner)
    for table in paper_page.console_tables(comparison):
        console.print(table)
    if as_json:
        print(comparison.to_json())
    runner.write(out, {"paper.json": comparison.to_json() + "\n", "paper.html": paper_page.html(comparison)}, overwrite)
    paper_page.publish(comparison, new_folder(out / "figures", overwrite))


def tune_vehicle(
    vehicle: Annotated[
        str, typer.Argument(metavar="PROFILE", help="A shipped vehicle's name, or a profile's TOML file.")
    ],
    law: Annotated[
        str | None,
        typer.Option(
            metavar="LAW", help="Search this law's own gains instead: a control preset, an own law, its file."
        ),
    ] = None,
    rate_hz: Annotated[float, typer.Option("--rate", help="Mocap frames a second.")] = 100.0,
    delay_s: Annotated[float, typer.Option("--delay", help="Mocap delay, s.")] = 0.008,
    full: Full = False,
    out: Annotated[
        Path | None,
        typer.Option(help="Write the tuned profile here, to go under [[profiles]]; with --law its options."),
    ] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Find the gain scales of a vehicle's loops: gains, observer bandwidth and compensation, judged in flight."""
    from formation.control.presets import preset_for
    from sim.research.tune import Task, tune
    from sim.runner import Runner
    from wire.config_file import dump, dump_profile
    from wire.files import write_edited

    console = Console(stderr=as_json, markup=False)
    profile = vehicle_profile(vehicle)
    task = Task(profile, rate_hz, delay_s, host_of(full))
    if law is not None:
        _search_law(task, law, out, overwrite, console, as_json)
        return
    if out is not None:
        _demand_absent(out, overwrite)  # before the minutes of flights

    def show(candidate: "Candidate") -> None:
        scale = candidate.gain_scale
        text = (
            f"horizontal {scale.horizontal:.2f}, observer {scale.observer:.2f}, vertical {scale.vertical:.2f}, "
            f"compensation {scale.compensation:.2f}"
        )
        console.print(f"cost {candidate.cost:7.2f}  {text}", highlight=False)

    by_rule, best = tune(task, Runner(console), show)
    costs_by = f"by the rule {by_rule.cost:.2f}, tuned {best.cost:.2f}, flown {task.host.text}"
    console.print(f"{costs_by}; {best.margin}", highlight=False)
    tuned = profile.model_copy(update={"gain_scale": best.gain_scale})
    preset = preset_for("default", tuned, task.mocap)
    console.print(f"law {preset.follower}\nobserver {preset.observer}", highlight=False)
    if out is not None and isfinite(best.cost):
        write_edited(out, dump_profile(tuned), overwrite)
    else:
        console.print(f"\n\\[profiles.gain_scale]\n{dump(best.gain_scale)}", highlight=False)
    if as_json:
        costs = {"by_rule": _cost(by_rule.cost), "tuned": _cost(best.cost)}
        print(json.dumps(costs | {"gain_scale": best.gain_scale.model_dump()} | _gains_of(preset)))
    if not isfinite(best.cost):
        raise typer.Exit(FAILED)


def _search_law(task: "Task", name: str, out: Path | None, overwrite: bool, console: Console, as_json: bool) -> None:
    """The gains of a preset's followers, or the options of an own law; these are appended to the file `out`, under
    the law's name and the vehicle's."""
    import tomli_w

    from formation.control.presets import Preset
    from sim.cli.flights import fail
    from sim.research import gain_search
    from sim.research.laws import chosen
    from sim.runner import Runner
    from wire.files import read_toml

    def show(found: "Tried") -> None:
        gains = ", ".join(f"{key} = {value:.4g}" for key, value in gain_search.gains_of(found.law).items())
        observer = f", {found.law.observer}" if isinstance(found.law, Preset) else ""
        console.print(f"cost {found.cost:7.2f}  {gains}{observer}", highlight=False)

    law = chosen(name)
    try:
        values = read_toml(out) if out is not None and out.exists() else {}
        if out is not None and task.profile.name in values.get(law.label, {}):
            _demand_absent(out, overwrite)
        best = gain_search.search(task, law, Runner(console), show)
    except (OSError, ValueError) as error:
        raise typer.BadParameter(str(error)) from error
    if not isfinite(best.cost):
        fail(f"{law.label}: it failed, or did not fly to its end, so there is nothing to write", FAILED)
    options = {key: float(f"{value:.4g}") for key, value in gain_search.gains_of(best.law).items()}
    new = {law.label: {task.profile.name: options}}
    if out is not None and task.profile.name in values.get(law.label, {}):
        values[law.label] |= new[law.label]
        out.write_text(tomli_w.dumps(values), encoding="utf-8")
    elif out is not None:
        with out.open("a", encoding="utf-8") as file:
            file.write(tomli_w.dumps(new))
    if as_json:
        found = _gains_of(best.law) if isinstance(best.law, Preset) else {"options": options}
        print(json.dumps({"tuned": best.cost} | found))


def play_league(
    laws: Annotated[
        list[str] | None,
        typer.Argument(metavar="LAW", help="Control presets, own laws' names or files; none: the built-in ones."),
    ] = None,
    scene: Annotated[list[str] | None, typer.Option(help="Fly this scene alone; again for more.")] = None,
    vehicle: Annotated[list[str] | None, typer.Option(help="With this vehicle alone; again for more.")] = None,
    gains: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="Options of own laws, as `gcs-sim tune --law` writes them; none: gains.toml beside each law's file.",
        ),
    ] = None,
    neural_fly: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="In five winds, too: Neural-Fly's recordings, custom_figure8_*.csv."),
    ] = None,
    check: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Fly a result file's rows again: the same to the bit?")
    ] = None,
    out: OutFolder = Path(),
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Fly laws over one table of scenes and vehicles; writes league.json and .html. Exit code 1: a law failed or,
    with --check, not the same."""
    from formation.codes import FlightResult
    from sim.cli.flights import fail
    from sim.research import league, league_page
    from sim.research.laws import chosen
    from sim.research.neural_fly import flown_rms_m
    from sim.runner import Runner
    from wire.files import read_toml

    console = Console(stderr=as_json, markup=False)
    runner = Runner(console)
    try:
        if check is not None:
            known = league.known_rows(check.read_text(encoding="utf-8"), str(check), neural_fly)
            _check_league(known, runner, console, as_json)
            return
        flown_by = [chosen(name) for name in laws or league.BUILT_IN]
        for law in flown_by:
            law.check()
        tuned = league.gains_beside(flown_by) if gains is None else read_toml(gains)
        jobs = league.rows(flown_by, tuple(scene or ()), tuple(vehicle or league.VEHICLES), tuned, neural_fly)
        recorded_m = {} if neural_fly is None else flown_rms_m(neural_fly)
        results = list(zip(jobs, runner.run("flights", league.fly, jobs), strict=True))
    except (OSError, ValueError) as error:
        fail(str(error), NOT_RIGHT)
    for table in league_page.console_tables(results):
        console.print(table)
    text = league.to_json(results, recorded_m)
    if as_json:
        print(text)
    runner.write(out, {"league.json": text + "\n", "league.html": league_page.html(results, recorded_m)}, overwrite)
    if any(result.outcome == FlightResult.LAW_FAILED for _, result in results):
        raise typer.Exit(FAILED)


def foretell_flight(
    source: Annotated[Path, typer.Argument(metavar="FLIGHT.MCAP", help="An imported log with a reference position.")],
    vehicle: Annotated[
        str | None,
        typer.Option(
            "--profile", help="A shipped vehicle's name or a profile's TOML file; none: identified of this log."
        ),
    ] = None,
    law: Annotated[
        str, typer.Option(metavar="LAW", help="What flew: a law's file.py or name; a control preset: what it would do.")
    ] = "default",
    as_json: Json = False,
) -> None:
    """Fly a recorded flight's reference with its vehicle and law, put flown and foretold side by side, and say within
    what the simulator is to be trusted."""
    from analysis.identify.vehicle import KNOWN_WITHIN, identify
    from analysis.load import load
    from sim.cli.flights import fail
    from sim.research import foretell
    from sim.research.laws import chosen

    try:
        flight = load(source)
        flown = identify(flight).drones if vehicle is None else ()
        if vehicle is None and not flown:
            fail(f"{source}: no vehicle to identify: --profile says which", NOT_RIGHT)
        profile = flown[0].profile(KNOWN_WITHIN) if vehicle is None else vehicle_profile(vehicle)
        found = foretell.foretell(flight, profile, chosen(law))
    except (OSError, ValueError) as error:
        fail(str(error), NOT_RIGHT)
    if as_json:
        print(found.to_json())
        return
    console = Console(markup=False)
    console.print(foretell.table(found))
    console.print(found.text, highlight=False)


def _check_league(known: "list[tuple[Row, Result]]", runner: "Runner", console: Console, as_json: bool) -> None:
    """Fly the rows again; ends the program with exit code 1 where one is not the same to the bit."""
    from sim.research import league

    again = runner.run("flights", league.fly, [row for row, _ in known])
    unlike = {
        f"{row.law.label}, {row.scene}, {row.vehicle}": found
        for (row, there), here in zip(known, again, strict=True)
        if (found := league.differences(there, here))
    }
    for name, found in unlike.items():
        console.print(f"{name}: {'; '.join(found)}", highlight=False)
    console.print(f"{len(known) - len(unlike)} of {len(known)} flights are the same to the bit", highlight=False)
    if as_json:
        print(json.dumps({"flights": len(known), "different": unlike}))
    if unlike:
        raise typer.Exit(FAILED)


def _demand_absent(out: Path, overwrite: bool) -> None:
    """End the program where a file is there that may not be written over."""
    from sim.cli.flights import fail
    from wire.files import demand_absent

    try:
        demand_absent(out, overwrite)
    except ConfigError as error:
        fail(str(error), NOT_RIGHT)


def vehicle_profile(name_or_path: str) -> "VehicleProfile":
    """A shipped vehicle, or one of a profile's TOML file; ends the program where there is none."""
    from sim.cli.flights import fail
    from wire import config_file

    try:
        return config_file.vehicle_profile(name_or_path)
    except ConfigError as error:
        fail(str(error), NOT_RIGHT)


def host_of(full: bool) -> "Host":
    """What flies a study."""
    from sim.research.host import Host

    return Host.LOCKSTEP if full else Host.STUDY


def _gains_of(preset: "Preset") -> dict[str, Any]:
    """Its followers' gains by name."""
    return {"law": asdict(preset.follower), "observer": asdict(preset.observer)}


def _cost(cost: float) -> float | None:
    """None where nothing flew: JSON has no infinity."""
    return cost if isfinite(cost) else None
