"""The command line `gcs`: the ground daemon, and the operator's commands that reach it over the lab's bus.

Exit codes: 0 done; 1 refused, failed, or a check failed; 2 the command line, a configuration or a recording is not
right; 3 no ground answers.
"""

import json
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from formation.exposure import PAGE
from formation.requests import GCS_NAME
from gcs.cli import keys as keys_cli
from gcs.cli import mocap as mocap_cli
from gcs.cli import operator as operator_cli
from gcs.cli import service as service_cli
from gcs.cli.children import page_process
from gcs.doctor import cli as doctor_cli
from gcs.live import cli as live_cli
from wire import clock
from wire.errors import ConfigError
from wire.files import run_folder
from wire.process.output import dropping_output
from wire.process.program import Insecure, Json, LabFile, Name, Speed, configuration, fail, program
from wire.process.system import NOT_RIGHT, REJECTED
from wire.text import rows

app = program(
    "Fly a formation: `gcs run lab.toml` is the daemon, the other commands reach it from another terminal.",
    "Exit codes: 0 done; 1 refused, or failed; 2 something given is not right; 3 no ground answers.",
)


@app.command()
@dropping_output()
def run(
    lab: LabFile,
    log: Annotated[Path | None, typer.Option(help="The flight log; without it runs/TIME-LAB/flight.mcap.")] = None,
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
    from gcs.cli.ground import Run, serve  # loads the compiled control, which the other commands do without
    from gcs.lab.findings import approved

    config = approved(lab, as_json, insecure=insecure)

    path = log or run_folder(config.name, clock.unix_us()) / "flight.mcap"
    metadata = {"link": config.link_kinds}
    metadata |= _tags(tag or [])
    with page_process(lab, name, speed, insecure) if page else nullcontext():
        serve(config, Run(lab, path, name, metadata, force, as_json, insecure, priority, clock.Clock(speed)))


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
    as_json: Json = False,
) -> None:
    """Judge a lab file and draw the lab from above; starts nothing. Exit code 1 where `gcs run` would refuse it."""
    from gcs.lab import cli

    cli.check(lab, svg, as_json)


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
    try:
        protection = lab_protection(config.security, lab, PAGE, insecure=insecure)
        door = Public(public, public_port) if public else None
        serve_page(config, name, port, clock.Clock(speed), as_json, protection, door)
    except ConfigError as error:
        fail(str(error), NOT_RIGHT)
    except OSError as error:
        fail(str(error), REJECTED)


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


operator_cli.register(app)
app.add_typer(mocap_cli.app, name="mocap")
app.add_typer(keys_cli.app, name="keys")
app.add_typer(service_cli.app, name="service")
app.command()(live_cli.live)
app.command()(doctor_cli.doctor)
app.command()(doctor_cli.logs)


@app.command()
def rules(as_json: Json = False) -> None:
    """Print phases, safety rules and the pose validator's checks as Markdown tables."""
    from formation.safety.phases import table_markdown
    from formation.safety.rules_table import rules_markdown
    from mocap.validator import checks_markdown

    tables = {"phases": table_markdown(), "rules": rules_markdown(), "validator": checks_markdown()}
    if as_json:
        print(json.dumps({name: rows(table) for name, table in tables.items()}))
    else:
        print("\n\n".join(tables.values()))
