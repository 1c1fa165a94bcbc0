"""The work of `gcs-sim campaign`: flights with faults on every core, verdicts, a table."""

import json
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path

import typer
from rich.console import Console
from rich.table import Table

from formation.vehicle.profile import PROFILES
from mavlink_formation.installation import install_command
from sim import lockstep
from sim.cli.flights import compile_everything, fail
from sim.proof import campaign, controls
from sim.proof.campaign import Cluster, Workers
from sim.proof.draw import FAMILIES_DRAWN, Draw, run_of
from sim.proof.flight import fly
from sim.proof.oracle import Verdict
from sim.runner import Runner
from sim.world import T0_NS
from wire.logs.mcap_write import LogWriter
from wire.process.system import NOT_RIGHT, REJECTED


def run_campaign(draw: Draw, runs: range, flights: int, scheduler: str | None, as_json: bool) -> None:
    """Runs with random faults, and so many flights of each positive control."""
    console = Console(stderr=as_json, markup=False)
    crew = _workers(scheduler, console)
    compile_everything()
    result = campaign.fly(draw, runs, crew)
    jobs = controls.jobs(draw.seed, flights)
    shares = controls.shares(jobs, crew.run("positive controls", controls.fly_control, jobs)) if jobs else {}
    if as_json:
        with_it = {name: share.with_it for name, share in shares.items()}
        print(result.to_json({name: share.without for name, share in shares.items()}, with_it))
    for failure in result.failures:
        console.print(f"{failure.again}    {failure.reason}", style="red", highlight=False, soft_wrap=True)
        for fault in failure.faults:
            console.print(f"    {fault.text()}", highlight=False, soft_wrap=True)
    per_core_s = 1.0 / max(result.core_s, 1e-9)
    if result.runs:
        console.print(
            f"{result.runs} flights, {len(result.failures)} not contained: {result.separation_violations} of "
            f"separation, {result.fence_violations} of the fence; {result.virtual_s * per_core_s:.1f} s of flight a "
            f"second and core ({result.simulated_s * per_core_s:.1f} integrated)",
            highlight=False,
        )
    for near in result.nearest:
        line = f"nearest to a limit: {near.margin.used:.0%}, {near.margin.text}    {near.draw.again(near.number)}"
        console.print(line, style="dim", highlight=False, soft_wrap=True)
    for name, share in shares.items():
        line = f"without {name}: {share.without:.0%} of {flights} flights failed, with it {share.with_it:.0%}"
        console.print(line, style=None if share.shows else "red", highlight=False)
    for name, behind in controls.REDUNDANT.items() if shares else ():
        console.print(f"without {name}: no control, {behind}", style="dim", highlight=False)
    if result.failures or not all(share.shows for share in shares.values()):
        raise typer.Exit(REJECTED)


def drawn_by(seed: int, families: tuple[str, ...], vehicle: str) -> Draw:
    """The draw of a campaign; families: by their names, none for all; vehicle: the profile's name."""
    if vehicle not in PROFILES:
        fail(f"--profile {vehicle}: no vehicle's; there are: {', '.join(PROFILES)}", NOT_RIGHT)
    known = {str(family): family for family in FAMILIES_DRAWN}
    if unknown := [name for name in families if name not in known]:
        fail(f"--family {unknown[0]}: no family of faults; there are: {', '.join(known)}", NOT_RIGHT)
    return Draw(seed, tuple(known[name] for name in families) or FAMILIES_DRAWN, vehicle)


def run_again(run: str, draw: Callable[[int], Draw], log: Path | None, as_json: bool, overwrite: bool = False) -> None:
    """One run of a campaign; draw: by its seed."""
    seed, _, number = run.partition(":")
    if not (seed.isdecimal() and number.isdecimal()):
        fail(f"--replay {run}: expected SEED:NUMBER", NOT_RIGHT)
    console = Console(stderr=as_json, markup=False)
    scenario = run_of(draw(int(seed)), int(number))
    for fault in scenario.faults:
        console.print(fault.text(), highlight=False)
    with ExitStack() as files:
        record = None
        if log is not None:
            metadata = lockstep.metadata(scenario, scenario.seed, "memory", T0_NS)
            record = files.enter_context(LogWriter(log, metadata, threaded=False, overwrite=overwrite)).write
        verdict = fly(scenario, scenario.seed, record).verdict
    if as_json:
        print(json.dumps(asdict(verdict), indent=2))
    console.print(_page(run, verdict))
    for violation in verdict.violations:
        console.print(f"{violation.t_s:7.2f} s  {violation.kind}: {violation.text}", highlight=False)
    if not verdict.contained:
        raise typer.Exit(REJECTED)


def _workers(scheduler: str | None, console: Console) -> Workers:
    if scheduler is None:
        return Runner(console)
    try:
        return Cluster(scheduler, console)
    except ModuleNotFoundError as error:
        text = f"needs {error.name}, which is not installed: {install_command('research')}"
        fail(f"--scheduler {scheduler}: {text}", NOT_RIGHT)
    except OSError as error:
        fail(f"--scheduler {scheduler}: {error}", NOT_RIGHT)


def _page(run: str, verdict: Verdict) -> Table:
    page = Table(title="how it ends")
    for heading in ("run", "ends", "reported after, s", "drift, m", "first report"):
        numeric = heading.endswith((" s", " m"))
        page.add_column(heading, justify="right" if numeric else "left", no_wrap=numeric or heading == "run")
    ends = "contained" if verdict.contained else "; ".join(violation.text for violation in verdict.violations[:2])
    detection_s = "-" if verdict.detection_s is None else f"{verdict.detection_s:.2f}"
    drift = "-" if verdict.onset_s is None else f"{verdict.drift_m:.2f}"
    page.add_row(run, ends, detection_s, drift, verdict.cause, style=None if verdict.contained else "red")
    return page
