"""`gcs live`: a flight live in Foxglove and Rerun."""

import json
from pathlib import Path
from typing import Annotated

import typer

from formation.exposure import TOOL, is_loopback
from formation.requests import GCS_NAME
from wire.errors import ConfigError
from wire.process.output import dropping_output
from wire.process.program import Insecure, Json, LabFile, Name, configuration, fail
from wire.process.system import NOT_RIGHT, REJECTED

FORWARD = "ssh -L {port}:127.0.0.1:{port} USER@THIS-MACHINE from there, or, for simulation only, --insecure"


@dropping_output()
def live(
    lab: LabFile,
    name: Name = GCS_NAME,
    foxglove: Annotated[bool, typer.Option("--foxglove", help="Serve Foxglove, by a WebSocket.")] = False,
    rerun: Annotated[bool, typer.Option("--rerun", help="Open Rerun's viewer.")] = False,
    host: Annotated[str, typer.Option(help="Where Foxglove is served.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="And on which port.")] = 8765,
    save: Annotated[Path | None, typer.Option("--save", metavar="FILE.rrd", help="Rerun into a file instead.")] = None,
    as_json: Json = False,
    insecure: Insecure = False,
) -> None:
    """Stream the flight to Foxglove or Rerun while it is flown: the log's own channels, from the bus, until Ctrl-C.

    A process of its own: the ground shares its log while somebody listens, and waits for nobody.
    """
    import asyncio  # here, as below: what an operator's command loads waits for none of it

    from gcs.live.daemon import Foxglove, Rerun, Viewer, ViewerError, run
    from wire.security.protection import lab_protection

    if not (foxglove or rerun or save):
        raise typer.BadParameter("say where to: --foxglove or --rerun")
    if foxglove and not (insecure or is_loopback(host)):
        fail(f"--host {host} is not this machine, and a viewer has no password: {FORWARD.format(port=port)}", NOT_RIGHT)
    config = configuration(lab)
    joined, viewers = config.link.joined, list[Viewer]()
    try:
        protection = lab_protection(config.security, lab, TOOL, insecure=insecure)
        protection.bus.demand((*joined.zenoh_listen, *joined.zenoh_connect))  # before a viewer is opened
        if foxglove:
            viewers.append(Foxglove(host, port))
            typer.echo(f"Foxglove: open connection ws://{host}:{viewers[-1].port}", err=True)  # type: ignore[attr-defined]
        if rerun or save:
            viewers.append(Rerun(None if save is None else str(save), [vehicle.body for vehicle in config.vehicles]))
    except (ViewerError, ConfigError) as error:
        fail(str(error), NOT_RIGHT)
    except OSError as error:
        fail(str(error), REJECTED)
    try:
        count = asyncio.run(
            run(config.link, config.name, name, viewers, lambda text: typer.echo(text, err=True), protection)
        )
    except OSError as error:
        fail(str(error), REJECTED)
    typer.echo(json.dumps({"messages": count}) if as_json else f"{count} messages streamed")
