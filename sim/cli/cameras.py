"""`gcs-sim mocap-server`: a camera system in a box, to try a lab's configuration with no cameras."""

import asyncio
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import typer

from formation.exposure import is_loopback
from wire.process.output import dropping_output
from wire.process.program import print_json_error, with_options

MOST_BODIES = 250
Protocol = Literal["vrpn", "chingmu", "natnet", "qtm", "vicon"]


@dataclass(frozen=True, slots=True)
class BoxOptions:
    """What is served, and how."""

    protocol: Annotated[Protocol | None, typer.Option(help="The vendor's protocol; of --lab if not given.")] = None
    lab: Annotated[Path | None, typer.Option(help="A lab file: its bodies, names, axes, unit and ports.")] = None
    bodies: Annotated[int, typer.Option(min=1, max=MOST_BODIES, help="How many, without --lab.")] = 3
    still: Annotated[bool, typer.Option("--still", help="Nothing moves.")] = False
    csv: Annotated[
        Path | None, typer.Option(help="The first body moves as recorded (CSV: EuRoC, TUM, Motive, Vicon).")
    ] = None
    mcap: Annotated[Path | None, typer.Option(help="All bodies move as in a flight's log.")] = None
    cameras: Annotated[
        str,
        typer.Option(
            metavar="KEY=VALUE,...",
            help="rate_hz, jitter_s, noise_m, noise_rad, delay_s, delay_jitter_s, lost_share, occluded_share, burst: "
            "as in a scenario's [mocap].",
        ),
    ] = ""
    restart_every: Annotated[float | None, typer.Option(min=2.0, help="The server restarts so often, s.")] = None
    rename_every: Annotated[float | None, typer.Option(min=1.0, help="A body's name changes so often, s.")] = None
    host: Annotated[str | None, typer.Option(help="Our address: 127.0.0.1, for NatNet 127.0.0.2.")] = None
    port: Annotated[int | None, typer.Option(min=1, max=65535, help="The vendor's own if not given.")] = None
    insecure: Annotated[
        bool, typer.Option("--insecure", help="Serve other machines; camera protocols know no keys.")
    ] = False
    seed: Annotated[int, typer.Option(min=0, help="Decides all luck.")] = 1
    as_json: Annotated[bool, typer.Option("--json", help="Events and errors as lines of JSON.")] = False
    speed: Annotated[float, typer.Option(min=0.01, max=1.0, hidden=True)] = 1.0


def register(app: typer.Typer) -> None:
    """Add the command to `gcs-sim`."""
    app.command("mocap-server")(mocap_server)


@with_options(BoxOptions)
@dropping_output()
def mocap_server(options: BoxOptions) -> None:
    """Serve moving bodies in a camera system's own protocol, until Ctrl-C."""
    from sim.cameras.box import Interruptions
    from sim.cli.mocap_server import NotRight, box

    def print_text(text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    def print_text_json(text: str) -> None:
        print(json.dumps({"text": text}), flush=True)

    try:
        if options.host is not None and not (options.insecure or is_loopback(options.host)):
            raise NotRight(f"--host {options.host} is not this machine, and camera protocols know no keys: --insecure")
        running = box(options)
        interruptions = Interruptions(options.restart_every, options.rename_every)
        asyncio.run(running.serve(interruptions, print_text_json if options.as_json else print_text))
    except KeyboardInterrupt:
        return
    except (NotRight, OSError) as error:
        print_json_error(str(error))
        print(f"gcs-sim: {error}", file=sys.stderr)
        raise typer.Exit(2) from error
