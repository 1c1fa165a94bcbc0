"""`gcs`: the ground daemon, and the operator's commands that reach it over the lab's bus.

Exit codes: 0 done; 1 refused, or the ground failed; 2 the command line, a configuration or a recording is not right;
3 no ground answers.
"""

import json
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, NoReturn

import typer
import uvloop
from rich.console import Console
from rich.table import Table

from formation.config import LabConfig
from formation.messages import Event, OperatorReply, OperatorRequest, Severity, Verb
from formation.phase import table_markdown
from formation.safety import rules_markdown
from gcs.daemon import GCS_NAME, Ended, GroundFailure
from gcs.daemon import run as run_ground
from gcs.mocap.csv_file import MocapFileError
from gcs.warm_up import warm_up
from wire import clock
from wire.config_file import ConfigError, load
from wire.zenoh_bus import BusError, ZenohBus

REFUSED, NOT_RIGHT, NO_GROUND = 1, 2, 3
ARMING_S, ANSWER_S = 20.0, 3.0
STYLES = {
    Severity.WARNING: "yellow",
    Severity.ERROR: "red",
    Severity.CRITICAL: "bold red",
    Severity.EMERGENCY: "bold red",
}

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    no_args_is_help=True,
    help="Fly a formation: `gcs run lab.toml` is the daemon, the other commands reach it from another terminal.",
    epilog="Exit codes: 0 done; 1 refused, or the ground failed; 2 something given is not right; 3 no ground answers.",
)

Lab = Annotated[Path | None, typer.Option("--lab", help="lab.toml, for its name and bus; without it the defaults.")]
Name = Annotated[str, typer.Option("--name", help="Which ground of the lab.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON, for scripts.")]
Timeout = Annotated[float, typer.Option("--timeout", help="Seconds to wait for the answer.")]
LabFile = Annotated[Path, typer.Argument(metavar="LAB.TOML", help="The lab: bodies, drones, limits, links, mocap.")]


@app.command()
def run(
    lab: LabFile,
    log: Annotated[Path | None, typer.Option(help="The flight log; without it runs/LAB-TIME.mcap.")] = None,
    name: Name = GCS_NAME,
    tag: Annotated[
        list[str] | None, typer.Option(metavar="KEY=VALUE", help="Said of the run in its log; as often as needed.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Be the ground: mocap in, control on every frame, setpoints out, everything recorded. Ctrl-C lands and ends."""
    config = _configuration(lab)
    path = log or Path("runs") / f"{config.name}-{clock.unix_us() // 1_000_000}.mcap"
    tell = _tell_json if as_json else _tell
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        warm_up(config)
        metadata = {"link": config.link.kind, "versions": f"mavlink-formation {version('mavlink-formation')}"}
        metadata |= {key: value for key, _, value in (item.partition("=") for item in tag or ())}
        ended = uvloop.run(run_ground(config, path, name, metadata, tell))
    except (MocapFileError, ValueError) as error:
        _fail(str(error), NOT_RIGHT)
    except OSError as error:
        _fail(str(error), REFUSED)
    except GroundFailure as error:
        _fail(f"the ground has failed and ends, the drones land by themselves: {error}", REFUSED)
    _report(ended, path, as_json)


@app.command()
def status(lab: Lab = None, name: Name = GCS_NAME, as_json: Json = False, timeout: Timeout = ANSWER_S) -> None:
    """Show the phase, every drone, and what keeps them from arming."""
    reply = _ask(Verb.STATUS, "", lab, name, timeout)
    if as_json:
        print(reply.text)
    else:
        print_status(reply.text, Console())


@app.command()
def shape(
    shape_name: Annotated[str, typer.Argument(metavar="NAME", help="The formation's name.")],
    lab: Lab = None,
    name: Name = GCS_NAME,
    as_json: Json = False,
    timeout: Timeout = ANSWER_S,
) -> None:
    """Change the formation's shape, in flight too."""
    _command(Verb.SHAPE, shape_name, lab, name, as_json, timeout)


@app.command()
def rules() -> None:
    """Print the phase table and the safety rules, as Markdown: the tables that the ground itself runs on."""
    print(table_markdown())
    print()
    print(rules_markdown())


def _register(verb: Verb, words: str, usual_timeout_s: float = ANSWER_S) -> None:
    """The command of one verb that takes no argument."""

    def ask(lab: Lab = None, name: Name = GCS_NAME, as_json: Json = False, timeout: Timeout = usual_timeout_s) -> None:
        _command(verb, "", lab, name, as_json, timeout)

    app.command(verb.value, help=words)(ask)


_register(Verb.ARM, "Bring every drone to off-board mode and arm it; refused with every reason there is.", ARMING_S)
_register(Verb.TAKEOFF, "Take off to the configured height, then hold.")
_register(Verb.START, "Take up the formation; a commanded leader then flies its trajectory.")
_register(Verb.HOLD, "Brake and stay where each drone is.")
_register(Verb.LAND, "Land where each drone is, and disarm there.")
_register(Verb.STOP, "EMERGENCY: cut the motors of every drone now, wherever it is. Restart the ground to fly again.")


def _command(verb: Verb, argument: str, lab: Path | None, name: str, as_json: bool, timeout_s: float) -> None:
    reply = _ask(verb, argument, lab, name, timeout_s)
    if as_json:
        print(json.dumps({"accepted": reply.accepted, "text": reply.text}))
    elif reply.accepted:
        print(reply.text)
    else:
        Console(stderr=True).print("refused: " + reply.text.replace("; ", "\n         "), style="red", highlight=False)
    if not reply.accepted:
        raise typer.Exit(REFUSED)


def _ask(verb: Verb, argument: str, lab: Path | None, name: str, timeout_s: float) -> OperatorReply:
    config = None if lab is None else _configuration(lab)
    request = OperatorRequest(clock.unix_us(), verb, argument)
    try:
        return uvloop.run(_ask_bus(config, name, request, timeout_s))
    except TimeoutError as error:
        _fail(f"no ground answers: {error}", NO_GROUND)
    except BusError as error:
        _fail(str(error), NOT_RIGHT)


async def _ask_bus(config: LabConfig | None, name: str, request: OperatorRequest, timeout_s: float) -> OperatorReply:
    link = LabConfig.model_fields["link"].get_default() if config is None else config.link
    lab = LabConfig.model_fields["name"].get_default() if config is None else config.name
    bus = await ZenohBus.open(link.model_copy(update={"zenoh_listen": ()}), lab)
    try:
        return await bus.ask(name, request, timeout_s)
    finally:
        await bus.close()


def print_status(text: str, console: Console) -> None:
    """The status for people."""
    told = json.loads(text)
    console.print(f"[bold]{told['phase']}[/] ({told['cause']}), shape {told['shape']}")
    table = Table(box=None, pad_edge=False)
    for column in ("drone", "body", "autopilot", "mode", "armed", "x", "y", "z", "battery", "heartbeat", "pose"):
        table.add_column(column)
    for drone in told["drones"]:
        table.add_row(
            str(drone["sysid"]), drone["body"], drone["autopilot"] or "-", drone["mode"],
            "armed" if drone["armed"] else "-", *(f"{x:.2f}" for x in drone["pos_lab_m"]),
            _percent(drone["battery"]), _age(drone["heartbeat_age_s"]), _age(drone["age_s"]),
        )  # fmt: skip
    console.print(table)
    for refusal in told["refusals"]:
        console.print(f"not ready: {refusal}", style="yellow", highlight=False)


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{value:.0%}"


def _age(value: float | None) -> str:
    return "never" if value is None else f"{value:.2f} s"


def _configuration(path: Path) -> LabConfig:
    try:
        return load(path, LabConfig)
    except ConfigError as error:
        _fail(str(error), NOT_RIGHT)


def _tell(event: Event) -> None:
    style = STYLES.get(event.severity, "")
    Console(stderr=True).print(f"{event.source}: {event.text}", style=style, highlight=False, markup=False)


def _tell_json(event: Event) -> None:
    print(json.dumps({"severity": event.severity.name, "source": event.source, "text": event.text}), flush=True)


def _report(ended: Ended, path: Path, as_json: bool) -> None:
    timing = ended.timing
    told = {
        "phase": ended.phase.name, "ticks": timing.ticks, "late_ticks": timing.late,
        "worst_latency_ms": round(timing.worst_s * 1e3, 2), "lost_records": ended.lost_records, "mcap": str(path),
    }  # fmt: skip
    if as_json:
        print(json.dumps(told))
    else:
        print(f"{told['ticks']} ticks, {told['late_ticks']} late, worst {told['worst_latency_ms']} ms; log {path}")


def _fail(text: str, code: int) -> NoReturn:
    Console(stderr=True).print(f"gcs: {text}", style="red", highlight=False, markup=False, soft_wrap=True)
    raise typer.Exit(code)


def main() -> None:
    """The console script."""
    app()


if __name__ == "__main__":
    main()
