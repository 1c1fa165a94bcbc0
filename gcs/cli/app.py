"""The command line `gcs`: the ground daemon, and the operator's commands that reach it over the lab's bus.

Exit codes: 0 done; 1 refused, failed, or a check failed; 2 the command line, a configuration or a recording is not
right; 3 no ground answers.
"""

import json
import os
import re
import subprocess
import sys
from contextlib import nullcontext
from datetime import datetime
from pathlib import Path
from typing import Annotated, TypeVar

import typer

from formation.exposure import MOCAP, PAGE, TOOL, is_loopback
from formation.names import unknown
from formation.requests import GCS_NAME
from gcs.cli import fly as fly_cli
from gcs.cli import keys as keys_cli
from gcs.cli import operator as operator_cli
from gcs.cli import service as service_cli
from gcs.cli.children import page_process
from gcs.doctor import cli as doctor_cli
from wire import clock
from wire.errors import ConfigError
from wire.files import IN_LOCKSTEP, new_folder, run_folder, write_edited
from wire.process.output import dropping_output
from wire.process.program import (
    DefaultCommand,
    Insecure,
    Json,
    LabFile,
    Name,
    Overwrite,
    Speed,
    configuration,
    fail,
    print_error,
    print_event,
    program,
    refusing,
)
from wire.process.system import NOT_RIGHT, REJECTED, python_command
from wire.text import rows

T = TypeVar("T", str, int)

app = program(
    "Fly a formation: `gcs run lab.toml` is the daemon, the other commands reach it from another terminal.",
    "Exit codes: 0 done; 1 refused, or failed; 2 something given is not right; 3 no ground answers.",
)


@app.command()
@dropping_output()
def run(
    lab: LabFile,
    log: Annotated[Path | None, typer.Option(help="The flight log; without it runs/TIME-LAB/flight.mcap.")] = None,
    overwrite: Overwrite = False,
    name: Name = GCS_NAME,
    tag: Annotated[
        list[str] | None, typer.Option(metavar="KEY=VALUE", help="Metadata for the log; as often as needed.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Fly a preset the delay margin refuses; simulation only.")] = (
        False
    ),
    page: Annotated[bool, typer.Option("--page", help="Serve the operator's page, too, from a process of its own.")] = (
        False
    ),
    as_json: Json = False,
    speed: Speed = 1.0,
    insecure: Insecure = False,
    priority: Annotated[
        bool,
        typer.Option(
            "--priority",
            help="Run in real time, in locked memory, as far as is allowed; without it at nice -10, where allowed.",
        ),
    ] = False,
) -> None:
    """Run the ground: mocap in, control on every frame, setpoints out, everything recorded. Ctrl-C lands and ends."""
    from gcs.daemon import RunOptions, serve  # loads the compiled control, which the other commands do without
    from gcs.lab.findings import approved

    config = approved(lab, as_json, insecure=insecure)

    path = log or run_folder(config.name, clock.unix_us()) / "flight.mcap"
    metadata = {"link": config.link_kinds}
    metadata |= _tags(tag or [])
    with page_process(lab, name, speed, insecure) if page else nullcontext():
        options = RunOptions(
            lab, path, name, metadata, force, as_json, insecure, priority, clock.Clock(speed), overwrite
        )
        serve(config, options)


def _tags(items: list[str]) -> dict[str, str]:
    pairs = [item.partition("=") for item in items]
    for key, equals, _ in pairs:
        if not key or not equals:
            raise typer.BadParameter(f"{key!r} is not KEY=VALUE", param_hint="--tag")
    return {key: value for key, _, value in pairs}


@app.command()
def check(
    lab: LabFile,
    svg: Annotated[Path | None, typer.Option(metavar="FILE", help="Draw the lab from above into an SVG file.")] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Judge a lab file and draw the lab from above; starts nothing. Exit code 1 where `gcs run` would refuse it."""
    from gcs.lab import cli

    cli.check(lab, svg, as_json, overwrite)


@app.command()
def new(
    lab: LabFile,
    source: Annotated[str | None, typer.Option(help="Camera system: vicon, natnet, qualisys, vrpn ...")] = None,
    followers: Annotated[int | None, typer.Option(min=1, max=100, help="How many.")] = None,
    profile: Annotated[str | None, typer.Option(help="Vehicle of every drone.")] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Write a lab file with comments, from three answers: given as options, or asked for on a terminal."""
    from formation.vehicle.profile import PROFILES
    from gcs.lab.new import SOURCES, lab_text

    source = source or _answer(f"Camera system ({', '.join(SOURCES)})", "vicon")
    count = followers or _answer("Number of followers", 2)
    profile = profile or _answer(f"Vehicle ({', '.join(PROFILES)})", "crazyflie_27g")
    for what, name, known in (("source", source, SOURCES), ("profile", profile, PROFILES)):
        if name not in known:
            fail(f"no {what} {unknown(name, known)}", NOT_RIGHT)
    try:
        write_edited(lab, lab_text(source, count, PROFILES[profile]), overwrite)
    except (ConfigError, OSError) as error:
        fail(str(error), NOT_RIGHT)
    text = f"{lab} written: set the cameras' host and the fence, then gcs check {lab}; gcs-sim run {lab}"
    print(json.dumps({"file": str(lab)}) if as_json else text)


def _answer(question: str, usual: T) -> T:
    """The operator's answer, where there is a terminal to ask on, else what is usual."""
    answer: T = typer.prompt(question, default=usual, err=True) if sys.stdin.isatty() else usual
    return answer


@app.command()
def rehearse(
    lab: LabFile,
    out: Annotated[Path | None, typer.Option(help="Folder for its log and report; runs/TIME-LAB if not given.")] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Fly the lab's whole flight in simulation before anybody arms: its vehicles, limits and law. Needs [sim]."""
    from gcs.rehearsal import record

    config = configuration(lab)
    try:
        folder = new_folder(out or run_folder(config.name, clock.unix_us()), overwrite, IN_LOCKSTEP)
    except OSError as error:
        fail(f"{error.filename}: {error.strerror}", NOT_RIGHT)
    # The simulator is known there alone.
    words = [str(lab), "--out", str(folder), *(["--json"] if as_json else [])]
    words += ["--overwrite"] if overwrite else []
    code = subprocess.run(python_command("sim", "run", *words), check=False).returncode
    if (folder / "flight.mcap").exists():
        try:
            record(lab, config, datetime.now().isoformat(timespec="seconds"), passed=code == 0, folder=folder)
        except (ConfigError, OSError) as error:
            print_error(f"the page will not know of it: {error}")
    raise typer.Exit(code)


@app.command()
@dropping_output()
def page(
    lab: LabFile,
    name: Name = GCS_NAME,
    port: Annotated[
        int | None, typer.Option(min=1, max=65535, help="On loopback, 127.0.0.1; without it 8470 or the next free one.")
    ] = None,
    public: Annotated[
        str,
        typer.Option(metavar="URL", help="Serve other machines, too, with a login, behind a proxy at https://HOST."),
    ] = "",
    public_port: Annotated[
        int, typer.Option(min=1, max=65535, help="With --public: the port on loopback that the proxy forwards to.")
    ] = 8480,
    with_parent: Annotated[bool, typer.Option("--with-parent", hidden=True)] = False,
    as_json: Json = False,
    speed: Speed = 1.0,
    insecure: Insecure = False,
) -> None:
    """Serve the operator's page on loopback: the room, every drone, alarms, every command, STOP by the space bar."""
    from gcs.page.door import is_public
    from gcs.page.shell import Public
    from gcs.page.shell import serve as serve_page
    from wire.security.protection import lab_protection

    config = configuration(lab)
    if public and not is_public(public):
        fail(f"--public: {public!r} is not https://HOST or https://HOST:PORT", NOT_RIGHT)
    if public and config.security is None:
        fail(f"{lab}: --public needs [security]: its operators are those who log in", NOT_RIGHT)
    with refusing():
        protection = lab_protection(config.security, lab, PAGE, insecure=insecure)
        door = Public(public, public_port) if public else None
        parent = os.getppid() if with_parent else None
        serve_page(lab, config, name, port, clock.Clock(speed), as_json, protection, door, parent)


@app.command()
def watch(
    lab: operator_cli.Lab = None,
    name: Name = GCS_NAME,
    identity: operator_cli.Identity = "",
    insecure: Insecure = False,
) -> None:
    """Show every drone in this terminal, ten times a second; keys: H hold, L land, space bar STOP, A acknowledge, Q.

    For people alone; a script reads `gcs status --json`.
    """
    from gcs.watch import watch as watch_ground

    watch_ground(lab, name, identity, insecure)


@app.command()
def buttons(as_json: Json = False) -> None:
    """Print each press of a key or button with its input device: the value that `[operator] stop_button` needs."""
    from gcs.stop_button import print_presses

    print_presses(as_json)


mocap_app = typer.Typer(
    cls=DefaultCommand, no_args_is_help=True, rich_markup_mode=None,
    help="Be the lab's mocap process (`gcs mocap lab.toml`), or `discover` camera systems.",
)  # fmt: skip


@mocap_app.command("serve")
def serve_mocap(
    lab: LabFile,
    linger: Annotated[
        float | None,
        typer.Option(
            min=0.0, help="End so many seconds after the process that started it, and every ground, have gone."
        ),
    ] = None,
    as_json: Json = False,
    speed: Speed = 1.0,
    name: Name = GCS_NAME,
    insecure: Insecure = False,
) -> None:
    """Be the lab's mocap process: frames of its source in, aligned and checked frames onto the bus, until Ctrl-C.

    On a terminal it shows how the mocap is doing: rate, jitter, delay, losses; each body's gaps, noise and pose.
    `gcs run` starts one where none serves the lab. One that runs by itself outlives every ground.
    """
    from mocap.daemon import serve  # loads a compiled kernel
    from wire.security.protection import lab_protection

    config = configuration(lab)
    with refusing():
        protection = lab_protection(config.security, lab, MOCAP, insecure=insecure)
    serve(config, linger, as_json, clock.Clock(speed), name, protection)


@mocap_app.command()
def discover(
    hosts: Annotated[list[str] | None, typer.Argument(help="Computers to ask directly, beside the network.")] = None,
    as_json: Json = False,
) -> None:
    """Find camera systems: Motive and QTM answer by themselves; of the others the ports of HOSTS are tried."""
    from mocap.discover import print_discovered

    print_discovered(tuple(hosts or ()), as_json)


FORWARD = "ssh -L {port}:127.0.0.1:{port} USER@THIS-MACHINE from there, or, for simulation only, --insecure"


@app.command()
@dropping_output()
def live(
    lab: LabFile,
    name: Name = GCS_NAME,
    _foxglove: Annotated[bool, typer.Option("--foxglove", hidden=True)] = True,  # of 0.2, where there were two
    host: Annotated[str, typer.Option(help="Where Foxglove is served.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="And on which port.")] = 8765,
    as_json: Json = False,
    insecure: Insecure = False,
) -> None:
    """Stream the flight to Foxglove while it is flown: the log's own channels, from the bus, until Ctrl-C.

    A process of its own: the ground shares its log while somebody listens, and waits for nobody. Rerun opens the log.
    """
    import asyncio  # here, as below: what an operator's command loads waits for none of it

    from gcs.live import Foxglove, ViewerError, run
    from wire.security.protection import lab_protection

    if not (insecure or is_loopback(host)):
        fail(f"--host {host} is not this machine, and a viewer has no password: {FORWARD.format(port=port)}", NOT_RIGHT)
    config = configuration(lab)
    joined = config.link.joined
    with refusing(ViewerError):
        protection = lab_protection(config.security, lab, TOOL, insecure=insecure)
        protection.bus.demand((*joined.zenoh_listen, *joined.zenoh_connect))  # before a viewer is served
        viewer = Foxglove(host, port)
        typer.echo(f"Foxglove: open connection ws://{host}:{viewer.port}", err=True)
        count = asyncio.run(
            run(config.link, config.name, name, viewer, lambda text: typer.echo(text, err=True), protection)
        )
    typer.echo(json.dumps({"messages": count}) if as_json else f"{count} messages streamed")


ROUTER = "tcp/127.0.0.1:7447"
"""Where ROS 2's `rmw_zenohd` of this machine listens: a ROS graph has no keys."""


@app.command()
@dropping_output()
def metrics(
    lab: LabFile,
    name: Name = GCS_NAME,
    host: Annotated[str, typer.Option(help="Where it is served.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="And on which port.")] = 9108,
    insecure: Insecure = False,
    _json: Json = False,
) -> None:
    """Serve the flight's state as OpenMetrics for Prometheus, at http://HOST:PORT/metrics, until Ctrl-C.

    JSON: its errors. A process of its own: the ground waits for nobody.
    """
    import uvloop  # here, as below: what an operator's command loads waits for none of it

    from gcs.metrics import run
    from wire.security.protection import lab_protection

    if not (insecure or is_loopback(host)):
        fail(f"--host {host} is not this machine, and metrics have no password: scrape them here", NOT_RIGHT)
    config = configuration(lab)
    try:
        protection = lab_protection(config.security, lab, TOOL, insecure=insecure)
        typer.echo(f"metrics: http://{host}:{port}/metrics", err=True)
        uvloop.run(run(config.link, config.name, name, (host, port), print_event, protection))
    except (ConfigError, ValueError) as error:
        fail(str(error), NOT_RIGHT)
    except OSError as error:
        fail(f"{host}:{port}: {error.strerror or error}", REJECTED)


@app.command()
@dropping_output()
def ros2(
    lab: LabFile,
    name: Name = GCS_NAME,
    domain: Annotated[int, typer.Option(min=0, max=232, help="ROS_DOMAIN_ID of the graph.")] = 0,
    namespace: Annotated[str, typer.Option(help="Before every topic and service but /tf and /diagnostics.")] = "",
    dds: Annotated[
        bool, typer.Option("--dds", help="The graph is on DDS (Humble too), by zenoh-bridge-ros2dds.")
    ] = False,
    identity: Annotated[str, typer.Option(help="In a lab with keys, as whom hold and land are asked for.")] = TOOL,
    as_json: Json = False,
    insecure: Insecure = False,
    speed: Speed = 1.0,
) -> None:
    """Publish poses, estimates, targets and alarms in a ROS 2 graph by rmw_zenoh (Jazzy or later), until Ctrl-C.

    Needs no ROS on this machine. Whoever is in the graph may ask for `hold` and `land`, and for nothing else.
    A process of its own: the ground waits for nobody.
    """
    import uvloop  # here, as below: what an operator's command loads waits for none of it

    from gcs.ros2 import run
    from wire.ros2.node import Graph
    from wire.security.protection import lab_protection

    path = namespace.strip("/")
    if path and re.fullmatch(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", path, re.ASCII) is None:
        raise typer.BadParameter(
            f"{namespace!r} is no namespace of ROS 2: letters, digits and _", param_hint="--namespace"
        )
    config = configuration(lab)
    graph = Graph(ROUTER, domain, f"/{path}" if path else "", dds=dds)
    with refusing(ValueError):
        protection = lab_protection(config.security, lab, identity, insecure=insecure)
        count = uvloop.run(run(config, name, graph, print_event, protection, clock.Clock(speed)))
    typer.echo(json.dumps({"messages": count}) if as_json else f"{count} messages published")


operator_cli.register(app)
app.add_typer(mocap_app, name="mocap")
app.add_typer(keys_cli.app, name="keys")
app.add_typer(service_cli.app, name="service")
app.add_typer(fly_cli.app, name="fly")
app.command()(doctor_cli.doctor)
app.command()(doctor_cli.logs)


@app.command()
def rules(as_json: Json = False) -> None:
    """Print phases, safety rules and the pose validator's checks as Markdown tables."""
    from formation.safety.phases import table_markdown
    from formation.safety.rules_table import rules_markdown
    from mocap.validator import checks_markdown

    tables = {"phases": table_markdown(), "rules": rules_markdown(), "validator": checks_markdown()}
    texts = json.dumps({name: rows(table) for name, table in tables.items()}), "\n\n".join(tables.values())
    print(texts[0] if as_json else texts[1])
