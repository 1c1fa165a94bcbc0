"""`gcs mocap`: the lab's mocap process, and what camera systems there are on the network."""

from pathlib import Path
from typing import Annotated

import typer

from formation.exposure import MOCAP
from formation.requests import GCS_NAME
from wire import clock
from wire.errors import ConfigError
from wire.process.program import DefaultCommand, Insecure, Json, LabFile, Name, Speed, configuration, fail
from wire.process.system import NOT_RIGHT

app = typer.Typer(
    cls=DefaultCommand, no_args_is_help=True, rich_markup_mode=None,
    help="Be the lab's mocap process (`gcs mocap lab.toml`), or `discover` camera systems.",
)  # fmt: skip


@app.command()
def serve(
    lab: LabFile,
    linger: Annotated[
        float | None, typer.Option(min=0.0, help="End when nobody has listened for this many seconds.")
    ] = None,
    record: Annotated[
        Path | None, typer.Option(metavar="FILE.mcap", help='Record the frames: a file for source "mcap".')
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
    from mocap.daemon import serve as serve_mocap  # loads a compiled kernel
    from wire.security.protection import lab_protection

    config = configuration(lab)
    try:
        protection = lab_protection(config.security, lab, MOCAP, insecure=insecure)
    except ConfigError as error:
        fail(str(error), NOT_RIGHT)
    serve_mocap(config, linger, record, as_json, clock.Clock(speed), name, protection)


@app.command()
def discover(
    hosts: Annotated[list[str] | None, typer.Argument(help="Computers to ask directly, beside the network.")] = None,
    wait: Annotated[float, typer.Option(min=0.1, max=30.0, help="How long answers are waited for, s.")] = 2.0,
    as_json: Json = False,
) -> None:
    """Find camera systems: Motive and QTM answer by themselves; of the others the ports of HOSTS are tried."""
    from mocap.discover import print_discovered

    print_discovered(tuple(hosts or ()), wait, as_json)
