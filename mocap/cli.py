"""What `gcs mocap` does around the daemon: the terminal, the recording, exit codes."""

import json
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import uvloop
from rich.console import Console

from formation.config import LabConfig
from formation.messages import Event, Severity
from mocap.core import SOURCE
from mocap.daemon import Outputs, run
from mocap.service import ServiceError
from mocap.sources.csv_file import MocapFileError
from mocap.table import LiveTable
from mocap.warm_up import warm_up
from wire import version
from wire.clock import Clock
from wire.logs.mcap_write import LogWriter
from wire.process.output import dropping_output
from wire.process.program import fail, print_event, print_event_json
from wire.process.progress import compile_all
from wire.process.system import NOT_RIGHT, REJECTED, machine, prefer_process
from wire.security.protection import LOOPBACK_ONLY, Protection


@dropping_output()
def serve(
    config: LabConfig,
    linger_s: float | None,
    record: Path | None,
    as_json: bool,
    clock: Clock,
    ground: str,
    protection: Protection = LOOPBACK_ONLY,
) -> None:
    """Run the mocap process until SIGINT or SIGTERM, then end the program with its exit code.

    On a terminal a table shows the mocap's state; with as_json a line of JSON is printed each second.
    """
    if config.mocap.source == "mavlink":
        fail('source "mavlink" has no cameras: the ground hears the poses from the drones themselves', NOT_RIGHT)
    compile_all("gcs", lambda: warm_up(config), sys.stderr)
    try:
        with _outputs(config, record, as_json, clock) as outputs:
            outputs.event(Event(Severity.INFO, SOURCE, f"priority: {prefer_process()}"))
            uvloop.run(run(config, linger_s, outputs, clock, ground, protection))
    except MocapFileError as error:
        fail(str(error), NOT_RIGHT)
    except ServiceError as error:
        fail(str(error), error.code)
    except OSError as error:
        fail(str(error), REJECTED)


@contextmanager
def _outputs(config: LabConfig, record: Path | None, as_json: bool, clock: Clock) -> Iterator[Outputs]:
    """Terminal and recording, for as long as the process serves."""
    with ExitStack() as open_ones:
        console = Console()
        if as_json:
            outputs = Outputs(print_event_json, lambda state: print(json.dumps(state), flush=True))
        elif console.is_terminal:
            table = open_ones.enter_context(LiveTable(console))
            outputs = Outputs(table.print_event, table.show)
        else:
            outputs = Outputs(print_event)
        if record is not None:
            metadata = {"lab": config.model_dump_json(), "versions": version.text(), "machine": machine()}
            outputs = replace(
                outputs, record=open_ones.enter_context(LogWriter(record, metadata, start=clock.pair())).write
            )
        yield outputs
