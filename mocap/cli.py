"""What `gcs mocap` does around the daemon: the terminal, with a table of the stream, the recording, exit codes."""

import json
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import uvloop
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from formation.config import LabConfig
from formation.messages import Event, Severity
from mocap.core import SOURCE, warm_up
from mocap.daemon import Outputs, run
from mocap.service import ServiceError
from mocap.sources.csv_file import MocapFileError
from wire import version
from wire.clock import Clock
from wire.logs.mcap_write import LogWriter
from wire.process.output import dropping_output
from wire.process.program import COLOURS, fail, print_event, print_event_json
from wire.process.progress import compile_all
from wire.process.system import NOT_RIGHT, REJECTED, machine, prefer_process
from wire.security.protection import LOOPBACK_ONLY, Protection

COLUMNS = ("body", "seen", "longest gap", "noise at rest", "x", "y", "z", "yaw", "rejected")
_MS, _MM, _DEGREES = 1e3, 1e3, 57.29577951308232


class LiveTable:
    """A context: `show` the state that the mocap process publishes, `tell` its events above it."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live = Live(console=console, auto_refresh=False, transient=False)

    def __enter__(self) -> "LiveTable":
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def print_event(self, event: Event) -> None:
        """One line that stays."""
        style = COLOURS.get(event.severity.name, "")
        self._console.print(Text(f"{event.source}: {event.text}", style), highlight=False)

    def show(self, state: dict[str, Any]) -> None:
        """The newest."""
        self._live.update(mocap_view(state), refresh=True)


def mocap_view(state: dict[str, Any]) -> Group:
    """The published state for people."""
    return Group(Text(_stream(state)), Text(_clock(state)), *map(Text, _stamps(state)), _bodies(state))


def _stream(state: dict[str, Any]) -> str:
    where = f"{state['source']} {state['server']}".strip()
    timing = state["timing"]
    if timing is None:
        return f"{where}: no frames"
    return (
        f"{where}: {timing['rate_hz']:.1f} Hz, jitter {_MS * timing['jitter_s']:.2f} ms, "
        f"longest gap {_MS * timing['gap_s']:.0f} ms, lost {timing['lost_share']:.1%} ({state['lost']} in all), "
        f"{state['frames']} frames, {state['refused']} refused"
    )


def _clock(state: dict[str, Any]) -> str:
    timing = state["timing"]
    clock = "no exposure times reported: delay_s is used" if state["latency_ms"] is None else ""
    if not clock:
        constant = "" if state["latency_measured"] else ", apart from the constant that latency_s says"
        clock = f"latency {state['latency_ms']:.1f} ms, uncertain by {state['uncertainty_ms'] or 0.0:.2f} ms{constant}"
    delay = "" if timing is None else f"exposure to receipt {_MS * timing['delay_s']:.1f} ms (median); "
    return delay + clock


def _stamps(state: dict[str, Any]) -> tuple[str, ...]:
    """The line about stamps that are no exposures, if there is one."""
    if state["retimed_scatter_s"] is not None:
        scatter_ms = _MS * state["retimed_scatter_s"]
        return (f"stamps are arrival times: frames are re-timed, with a scatter of {scatter_ms:.2f} ms",)
    timing = state["timing"]
    return () if timing is None or not timing["arrival_stamps"] else ("stamps are arrival times",)


def _bodies(state: dict[str, Any]) -> Table:
    table = Table(box=None, pad_edge=False)
    for column in COLUMNS:
        table.add_column(column, no_wrap=True, justify="left" if column == "body" else "right")
    rejected = state["rejected"]
    for body in state["body_figures"]:
        table.add_row(*map(Text, (*_figures(body), str(sum(rejected.get(body["body"], {}).values())))))
    return table


def _figures(body: dict[str, Any]) -> tuple[str, ...]:
    if body["pos_lab_m"] is None:
        return body["body"], "not seen", *["-"] * 6
    noise = "moves" if body["noise_m"] is None else f"{_MM * body['noise_m']:.2f} mm"
    yaw = "-" if body["yaw_rad"] is None else f"{_DEGREES * body['yaw_rad']:.1f} deg"
    where = (f"{x:.3f}" for x in body["pos_lab_m"])
    return body["body"], f"{body['seen_share']:.1%}", f"{_MS * body['gap_s']:.0f} ms", noise, *where, yaw


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
