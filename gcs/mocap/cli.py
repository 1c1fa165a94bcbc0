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
from gcs.cli.common import NOT_RIGHT, REFUSED, fail, tell, tell_json
from gcs.mocap.daemon import Told, run
from gcs.mocap.service import ServiceError
from gcs.mocap.sources.csv_file import MocapFileError
from gcs.mocap.table import LiveTable
from gcs.mocap.warm_up import warm_up
from wire import version
from wire.clock import Clock
from wire.logs.mcap_log import LogWriter
from wire.process.machine import machine
from wire.process.progress import compile_all


def serve(
    config: LabConfig, linger_s: float | None, record: Path | None, as_json: bool, clock: Clock, ground: str
) -> None:  # fmt: skip
    """Be the mocap process until told to end; ends the program with its exit code.

    On a terminal a table shows how the mocap is doing, with as_json a line of JSON a second.
    """
    if config.mocap.source == "mavlink":
        fail('source "mavlink" has no cameras: the ground hears the poses from the drones themselves', NOT_RIGHT)
    compile_all("gcs", lambda: warm_up(config), sys.stderr)
    try:
        with _told(config, record, as_json, clock) as told:
            uvloop.run(run(config, linger_s, told, clock, ground))
    except MocapFileError as error:
        fail(str(error), NOT_RIGHT)
    except ServiceError as error:
        fail(str(error), error.code)
    except OSError as error:
        fail(str(error), REFUSED)


@contextmanager
def _told(config: LabConfig, record: Path | None, as_json: bool, clock: Clock) -> Iterator[Told]:
    """Terminal and recording, for as long as the process serves."""
    with ExitStack() as open_ones:
        console = Console()
        if as_json:
            told = Told(tell_json, lambda state: print(json.dumps(state), flush=True))
        elif console.is_terminal:
            table = open_ones.enter_context(LiveTable(console))
            told = Told(table.tell, table.show)
        else:
            told = Told(tell)
        if record is not None:
            metadata = {"lab": config.model_dump_json(), "versions": version.text(), "machine": machine()}
            told = replace(told, record=open_ones.enter_context(LogWriter(record, metadata, start=clock.pair())).write)
        yield told
