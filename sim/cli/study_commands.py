"""What the studies of `gcs-sim` do: many lockstep flights, a table, files for scripts."""

import json
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from analysis.console import print_summary
from formation.control.presets import Preset, preset_for
from formation.vehicle.profile import VehicleProfile
from formation.vehicle.profile import profile as shipped_profile
from sim import lockstep
from sim.cli.bench_tables import against_table, bench_tables
from sim.cli.conclude import conclude
from sim.cli.flights import compile_everything
from sim.cli.steady_push_table import steady_push_table
from sim.scenario import load as load_scenario
from sim.shipped import shipped
from sim.studies import (
    bench,
    false_rejections,
    gain_search,
    paper,
    paper_page,
    performance_bound,
    robustness,
    steady_push,
)
from sim.studies.experiments import CONTROLLERS, Experiment, Job, scenario_of
from sim.studies.robustness import Draw, Sample
from sim.studies.runner import Runner
from sim.studies.scale import against
from sim.studies.tune import Candidate, Task, tune
from wire.config_file import ConfigError, dump, dump_profile, load_profile
from wire.files import make_folder
from wire.process.program import print_json_error

if TYPE_CHECKING:
    from sim.studies.hummingbird.flights import Benchmark

FAILED, NOT_RIGHT = 1, 2


def run_paper(
    out: Path, seeds: int, vehicle: str, only: list[str], calibrate: bool, bound: bool, as_json: bool
) -> None:
    """The paper's gust, line and circle, and a steady push."""
    console = Console(stderr=as_json, markup=False)
    profile = _vehicle(vehicle, console)
    if calibrate:
        _calibrate(profile, console, as_json)
        return
    if bound:
        _show_bound(profile, console, as_json)
        return
    try:
        flights = paper.jobs(range(1, seeds + 1), profile, tuple(only) or tuple(CONTROLLERS))
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    runner = Runner(console)
    comparison = paper.compare(flights, runner)
    for table in paper_page.console_tables(comparison):
        console.print(table)
    if as_json:
        print(comparison.to_json())
    runner.write(out, {"paper.json": comparison.to_json() + "\n", "paper.html": paper_page.html(comparison)})


def _calibrate(profile: VehicleProfile, console: Console, as_json: bool) -> None:
    """The fan that moves the printed ISTSMC of that vehicle by 0.30 m."""

    def flown(peak: float, deviation_m: float) -> None:
        console.print(f"peak {peak:.3f} m/s²: {1e3 * deviation_m:.1f} mm", highlight=False)

    try:
        peak = paper.calibrate(profile, Runner(console), flown)
    except ValueError as error:
        print_json_error(str(error))
        console.print(f"gcs-sim: {error}", style="red", highlight=False)
        raise typer.Exit(FAILED) from error
    console.print(f"peak_m_s2 = {peak:.2f}", highlight=False)
    if as_json:
        print(json.dumps({"peak_m_s2": peak}))


def run_robustness(
    samples: int, first: int, only: int | None, profile: str, preset: str, as_json: bool, out: Path
) -> None:
    """Vehicles that are not what the controller believes."""
    console = Console(stderr=as_json, markup=False)
    if only is not None:
        flown = [_again(Draw(only, profile, preset), out, console)]
    else:
        draws = [Draw(seed, profile, preset) for seed in range(first, first + samples)]
        flown = Runner(console).run("flights", robustness.fly, draws)
    failures = sum(sample.failed for sample in flown)
    if as_json:
        print(_json(flown))
    console.print(_table(flown))
    median_mm, high_mm = (1e3 * robustness.percentile_m(flown, percent) for percent in (50.0, 95.0))
    console.print(f"{len(flown)} flights, {failures} failed", highlight=False)
    console.print(f"RMS on line and circle: median {median_mm:.2f} mm, 95 % under {high_mm:.2f} mm", highlight=False)
    if failures:
        raise typer.Exit(FAILED)


def run_hummingbird(seeds: int, log: Path | None, as_json: bool) -> None:
    """Line, circle and gust on rotorpy's physics."""
    console = Console(stderr=as_json, markup=False)
    try:
        from sim.studies.hummingbird import flights
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] != "rotorpy":
            raise
        print_json_error("rotorpy is not here: pip install 'mavlink-formation[rotorpy]'")
        console.print("gcs-sim: rotorpy is not here: pip install 'mavlink-formation[rotorpy]'", style="red")
        raise typer.Exit(NOT_RIGHT) from error
    if log is not None:
        make_folder(log)
    with TemporaryDirectory() if log is None else nullcontext(log) as folder:
        jobs = flights.flights(range(1, seeds + 1), Path(folder))
        result = flights.benchmark(jobs, Runner(console).run("flights", flights.fly, jobs))
    if as_json:
        print(result.to_json())
    else:
        console.print(_hummingbird_table(result))
    if result.landed < result.flights:
        raise typer.Exit(FAILED)


def run_steady_push(seeds: int, vehicle: str, controllers: tuple[str, ...], as_json: bool) -> None:
    """Hover in a steady push."""
    console = Console(stderr=as_json, markup=False)
    try:
        jobs = steady_push.jobs(controllers, _vehicle(vehicle, console), range(1, seeds + 1))
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    flown = Runner(console).run("flights", steady_push.fly, jobs)
    console.print(steady_push_table(jobs, flown))
    if as_json:
        rows = [
            {"controller": j.controller, "share": j.share, "motor_lag": j.motor_lag, "seed": j.seed} | asdict(f)
            for j, f in zip(jobs, flown, strict=True)
        ]
        print(json.dumps(_without_nan(rows), indent=2))
    if not all(settling.at_rest for settling in flown):
        raise typer.Exit(FAILED)


def run_false_rejections(hours: float, recording: Path | None, as_json: bool) -> None:
    """Count correct poses that the pose validator rejects."""
    console = Console(stderr=as_json, markup=False)
    scenarios = tuple(name for name in shipped() if not load_scenario(name).needs_leader_file)
    jobs = false_rejections.jobs(hours, scenarios, recording)
    judged = Runner(console).run("sources", false_rejections.judge, jobs)
    totals = false_rejections.totals(judged)
    for one in judged:
        console.print(f"{one.seconds / 3600.0:6.2f} h {one.poses:10d} poses  {one.source}", highlight=False)
        for text in one.rejected:
            console.print(text, style="red", highlight=False)
    if as_json:
        print(json.dumps({"totals": totals, "sources": [asdict(one) for one in judged]}, indent=2))
    hours = totals["seconds"] / 3600.0
    console.print(f"{hours:.1f} h, {totals['poses']} poses, {totals['rejected']} rejected falsely", highlight=False)
    if totals["rejected"]:
        raise typer.Exit(FAILED)


def run_tune(
    vehicle: str, gains: str | None, rate_hz: float, delay_s: float, noise_m: float, out: Path | None, as_json: bool
) -> None:
    """The gain scales of a vehicle's loops, or the gains of a preset for it."""
    console = Console(stderr=as_json, markup=False)
    profile = _vehicle(vehicle, console)
    task = Task(profile, rate_hz, delay_s, noise_m)
    if gains is not None:
        _search_gains(task, gains, console, as_json)
        return

    def show(candidate: Candidate) -> None:
        console.print(f"cost {candidate.cost:7.2f}  {_factors_text(candidate)}", highlight=False)

    first, best = tune(task, Runner(console), show)
    console.print(f"by the rule {first.cost:.2f}, tuned {best.cost:.2f}; {best.margin}", highlight=False)
    tuned = profile.model_copy(update={"gain_scale": best.gain_scale})
    preset = preset_for("default", tuned, task.mocap)
    console.print(f"law {preset.follower}\nobserver {preset.observer}", highlight=False)
    if out is not None:
        out.write_text(dump_profile(tuned), encoding="utf-8")
    else:
        console.print(f"\n\\[profiles.gain_scale]\n{dump(best.gain_scale)}", highlight=False)
    if as_json:
        result = {"by_rule": _cost(first.cost), "tuned": _cost(best.cost), "gain_scale": best.gain_scale.model_dump()}
        print(json.dumps(result | _as_json(preset)))
    if not np.isfinite(best.cost):
        raise typer.Exit(FAILED)


def _as_json(preset: Preset) -> dict[str, Any]:
    """Its followers' gains by name."""
    return {"law": asdict(preset.follower), "observer": asdict(preset.observer)}


def _cost(cost: float) -> float | None:
    """None where nothing flew: JSON has no infinity."""
    return cost if np.isfinite(cost) else None


def _search_gains(task: Task, name: str, console: Console, as_json: bool) -> None:
    """The gains of one preset's followers."""

    def show(found: gain_search.Tried) -> None:
        console.print(f"cost {found.cost:7.2f}  {found.gains.follower}  {found.gains.observer}", highlight=False)

    try:
        best = gain_search.search(task, name, Runner(console), show)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    if as_json:
        print(json.dumps({"tuned": _cost(best.cost)} | _as_json(best.gains)))
    if not np.isfinite(best.cost):
        raise typer.Exit(FAILED)


def run_bench(followers: list[int] | None, revision: str | None, as_json: bool) -> None:
    """What the parts of a flight cost, here or also at another commit."""
    console = Console(stderr=as_json, markup=False)
    compile_everything()
    if revision is not None:
        _bench_against(revision, followers or bench.FOLLOWERS, console, as_json)
        return
    with console.status("starting") as status:
        result = bench.bench(status.update, followers or bench.FOLLOWERS)
    if as_json:
        print(result.to_json())
        return
    for table in bench_tables(result):
        console.print(table)


def _bench_against(revision: str, followers: Sequence[int], console: Console, as_json: bool) -> None:
    try:
        with console.status("starting") as status:
            compared = against.against(revision, followers, status.update)
    except against.AgainstError as error:
        print_json_error(str(error))
        console.print(f"gcs-sim: --against {revision}: {error}", style="red", highlight=False)
        raise typer.Exit(NOT_RIGHT) from error
    if as_json:
        print(compared.to_json())
    else:
        console.print(against_table(compared))


def _vehicle(name_or_path: str, console: Console) -> VehicleProfile:
    """A shipped vehicle, or one of a profile's TOML file; ends the program where there is none."""
    try:
        path = Path(name_or_path)
        return load_profile(path) if path.exists() else shipped_profile(name_or_path)
    except (ConfigError, ValueError) as error:
        print_json_error(str(error))
        console.print(f"gcs-sim: {error}", style="red", markup=False, highlight=False)
        raise typer.Exit(NOT_RIGHT) from error


def _show_bound(profile: VehicleProfile, console: Console, as_json: bool) -> None:
    """The least deviation by the time of reaction: bounds, and last what can be expected at best."""
    scenario = scenario_of(Job("cfc", Experiment.GUST, seed=1, vehicle=profile))
    gust = performance_bound.gust_pass(scenario)
    own_s = performance_bound.reaction_s(scenario)
    seen_s = own_s + performance_bound.seen_s(scenario, gust)
    rows = [(seconds, "") for seconds in performance_bound.REACTIONS_S]
    rows += [
        (own_s, "  this loop: exposed at once, passed on, acted on"),
        (seen_s, "  an estimate: not before the push shows in the mocap's noise"),
    ]
    least_m = [performance_bound.least_deviation_m(gust, seconds) for seconds, _ in rows]
    loop = performance_bound.attitude_loop(scenario)
    loops = {
        "by attitude commands": loop,
        "with an accelerometer": replace(loop, dead_s=loop.dead_s - scenario.mocap.delay_s),  # which no camera delays
    }
    by_attitude_m = [performance_bound.least_deviation_by_attitude_m(gust, each) for each in loops.values()]
    for (seconds, who), metres in zip(rows, least_m, strict=True):
        console.print(f"acts after {1e3 * seconds:4.1f} ms: {1e3 * metres:5.2f} mm at least{who}", highlight=False)
    for (how, each), metres in zip(loops.items(), by_attitude_m, strict=True):
        answer = f"dead for {1e3 * each.dead_s:.0f} ms, lag {1e3 * each.lag_s:.0f} ms"
        console.print(f"{how}: {1e3 * metres:5.2f} mm at least, {answer}", highlight=False)
    if as_json:
        by_time = zip(rows, least_m, strict=True)
        bounds = [{"reaction_s": seconds, "least_deviation_m": metres} for (seconds, _), metres in by_time]
        by_loop = zip(loops.values(), by_attitude_m, strict=True)
        bounds += [{"reaction_s": x.dead_s, "lag_s": x.lag_s, "least_deviation_m": metres} for x, metres in by_loop]
        print(json.dumps(bounds))


def _factors_text(candidate: Candidate) -> str:
    """The factors in words."""
    gain_scale = candidate.gain_scale
    return (
        f"horizontal {gain_scale.horizontal:.2f}, observer {gain_scale.observer:.2f}, "
        f"vertical {gain_scale.vertical:.2f}, "
        f"compensation {gain_scale.compensation:.2f}"
    )


def _again(draw: Draw, out: Path, console: Console) -> Sample:
    """Fly one draw with a log and a report."""
    scenario = robustness.scenario_of(draw)
    folder = out / scenario.name
    make_folder(folder)
    flown = lockstep.run_to_file(scenario, draw.seed, folder / "flight.mcap")
    flight, summary = conclude(folder / "flight.mcap", flown.outcome, flown.realtime_factor)
    print_summary(summary, console)
    return robustness.judge(draw, flown.outcome.result, flight, summary)


def _table(samples: list[Sample]) -> Table:
    """The worst ten and how to fly them again."""
    table = Table(title="the worst; again with --only SEED")
    for heading in ("seed", "experiment", "outcome", "RMS, mm", "largest, mm", "swing, deg"):
        table.add_column(heading, justify="left" if heading in ("experiment", "outcome") else "right")
    for sample in robustness.worst(samples):
        outcome = f"{sample.outcome}, left its fence" if sample.left_fence else sample.outcome
        swing = f"{sample.swing_deg:.2f}" if sample.kind is Experiment.PUSH else ""
        numbers = (f"{1e3 * sample.rms_m:.2f}", f"{1e3 * sample.max_m:.1f}", swing)
        table.add_row(str(sample.draw.seed), sample.kind, outcome, *numbers, style="red" if sample.failed else None)
    return table


def _hummingbird_table(result: "Benchmark") -> Table:
    """What was flown, in millimetres, with what was assumed above it."""
    a = result.assumed
    lines = [
        f"{result.vehicle} on rotorpy's physics, {result.seeds} seed(s), {result.landed} of {result.flights} landed",
        f"cameras {1e3 * a.mocap_delay_s:.0f} ms, link {1e3 * a.link_s:.0f} ms; "
        f"answer {1e3 * a.response_dead_time_s:.0f} ms dead, {1e3 * a.response_lag_s:.0f} ms lag",
    ]
    table = Table(title="\n".join(lines), title_justify="left")
    for heading in ("", "RMS, mm", "vibration, mm", "mean of largest, mm", "largest, mm", "settling, s", "chatter, °"):
        table.add_column(heading, justify="right" if heading else "left")
    table.add_row("line", _mm(result.line_rms_m), _mm(result.line_vibration_m))
    table.add_row("circle", _mm(result.circle_rms_m), _mm(result.circle_vibration_m))
    settle_s, chatter = ("-" if v is None else f"{v:.2f}" for v in (result.gust_settle_s, result.chatter_deg))
    gust = (_mm(result.gust_mean_dev_m), _mm(result.gust_max_dev_m))
    table.add_row(f"gust of {result.wind_m_s:g} m/s", "", "", *gust, settle_s, chatter)
    return table


def _mm(length_m: float | None) -> str:
    return "-" if length_m is None else f"{1e3 * length_m:.2f}"


def _json(samples: list[Sample]) -> str:
    """Every sample and the percentiles; null for what no flight measured."""
    values = {
        "samples": [asdict(sample) | {"failed": sample.failed} for sample in samples],
        "failed": sum(sample.failed for sample in samples),
        "rms_m": {f"p{p:g}": robustness.percentile_m(samples, p) for p in (50.0, 95.0, 100.0)},
    }
    return json.dumps(_without_nan(values), indent=2, allow_nan=False)


def _without_nan(value: object) -> object:
    """The same with None for NaN, which JSON does not have."""
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
