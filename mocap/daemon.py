"""The mocap process: a source's frames in, aligned and checked frames onto the lab's bus. It decides nothing.

A process of its own, so that poses reach the drones whatever becomes of the ground.
"""

import json
import os
import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import degrees
from typing import Any

import numpy as np
import uvloop
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from formation.config import LabConfig
from formation.messages import Event, RawFrame, Severity
from formation.requests import GCS_NAME
from mocap import figures
from mocap.core import SOURCE, MocapCore, warm_up
from mocap.figures import FrameWindow
from mocap.service import ServiceError, configuration_name
from mocap.sources import source
from mocap.sources.csv_file import MocapFileError
from mocap.sources.registry import open_source
from mocap.sources.source import Feed, SourceStatus
from wire.clock import Clock
from wire.ground_state import decode
from wire.process.daemon import (
    GROUND_REMEDY,
    READY,
    EventSink,
    Precondition,
    Stop,
    Watchdog,
    beside,
    bus_at,
    first_of,
    notify,
    report_missing,
)
from wire.process.output import dropping_output
from wire.process.program import COLOURS, fail, print_event, print_event_json
from wire.process.progress import compile_all
from wire.process.system import NOT_RIGHT, REJECTED, prefer_process
from wire.rejections import RejectionLog
from wire.security.protection import LOOPBACK_ONLY, Protection
from wire.transport.mocap_bus import MocapBus
from wire.transport.zenoh_bus import ZenohBus


class Certainty:
    """Reports the capture times' uncertainty when it is first known, and when it has halved or doubled."""

    def __init__(self) -> None:
        self._reported_s: float | None = None
        self._reported_ns = 0

    def events(self, status: SourceStatus, now_ns: int) -> tuple[Event, ...]:
        """The event that is due now, at most one every 10 s; empty otherwise."""
        found_s = status.uncertainty_s
        if found_s is None or status.latency_s is None or not self._is_news(max(found_s, 1e-5), now_ns):
            return ()
        self._reported_s, self._reported_ns = max(found_s, 1e-5), now_ns
        constant = "" if status.latency_measured else ", apart from the constant that latency_s says"
        text = f"capture times are certain to {1e3 * found_s:.2f} ms{constant}; latency {1e3 * status.latency_s:.1f} ms"
        is_poor = found_s > 2e-3  # a drone's fastest turns are degrees by then
        return (Event(Severity.WARNING if is_poor else Severity.INFO, "mocap", text),)

    def _is_news(self, found_s: float, now_ns: int) -> bool:
        if self._reported_s is None:
            return True
        ratio = found_s / self._reported_s
        return now_ns - self._reported_ns >= 10_000_000_000 and not 0.5 < ratio < 2.0


@dataclass(frozen=True, slots=True)
class Outputs:
    """The process's outputs beside the bus: its events, and its state once a second."""

    event: EventSink
    state: Callable[[dict[str, Any]], None] = lambda _: None


class Mocap:
    """One MocapCore between its source and the bus."""

    def __init__(
        self, config: LabConfig, bus: MocapBus, reject_log: RejectionLog, outputs: Outputs, clock: Clock
    ) -> None:
        self._core = MocapCore(config, reject_log)
        self._bus = bus
        self._outputs = outputs
        self._clock = clock
        self._window = FrameWindow(tuple(v.body for v in config.vehicles))
        self._certainty = Certainty()
        self._name = config.mocap.source
        self._inside_s: deque[float] = deque(maxlen=1000)
        self._needed_ns = self._state_ns = clock.monotonic_ns()
        self._parent = os.getppid()
        self._unknown = 0
        feed = Feed(config.mocap, self.receive_frame, self.report, reject_log, clock)
        self.source = open_source(config, bus, feed)

    def receive_frame(self, frame: RawFrame) -> None:
        """Receive a frame and publish it at once."""
        now_ns = self._clock.monotonic_ns()
        aligned = self._core.receive(frame, now_ns)
        if aligned is not None:
            self._bus.publish_frame(aligned)
            self._inside_s.append((self._clock.monotonic_ns() - now_ns) * 1e-9)
            self._window.add(aligned)

    @property
    def has_frame(self) -> bool:
        """Whether any frame has come."""
        return self._core.frames > 0

    def receive_ground_state(self, state: str) -> None:
        """Receive the ground's published state, of which only which motors are on is used."""
        self._needed_ns = self._clock.monotonic_ns()
        try:
            self._core.note_motors(decode(state).motors_on)
        except ValueError as error:
            self._core.reject_log.note("ground", str(error), self._clock.monotonic_ns())

    async def watch(self, linger_s: float | None) -> None:
        """Publish events and the state; return `linger_s` after who started this and all grounds are gone, if given."""
        watchdog = Watchdog()
        while True:
            now_ns = self._clock.monotonic_ns()
            watchdog.feed(now_ns)
            for event in (*self._core.reject_log.due(now_ns), *self._core.events(now_ns), *self._newly_unknown()):
                self.report(event)
            if now_ns - self._state_ns >= 1_000_000_000:
                self._state_ns = now_ns
                state = self.state(now_ns)
                self._bus.publish_state(state)
                self._outputs.state(state)
                for event in self._certainty.events(self.source.status(), now_ns):
                    self.report(event)
            if os.getppid() == self._parent != 1:  # init takes over who lost its starter, maybe before we began
                self._needed_ns = now_ns
            if linger_s is not None and now_ns - self._needed_ns > linger_s * 1e9:
                return
            await self._clock.sleep_until_ns(now_ns + 100_000_000)

    def report(self, event: Event) -> None:
        """Report an event here, and on the bus, where the ground records it."""
        self._outputs.event(event)
        self._bus.publish_event(event)

    def state(self, now_ns: int) -> dict[str, Any]:
        """The published state; inside_ms: from receipt of a raw frame to its publication."""
        spent_ms = 1e3 * np.array(self._inside_s or [0.0])
        return {
            "source": self._name,
            **source.as_json(self.source.status()),
            **figures.as_json(self._window, now_ns),
            "retimed_scatter_s": self._core.retimed_scatter_s,
            "frames": self._core.frames,
            "refused": self._core.reject_log.count,
            "rejected": self._core.rejections(),
            "unknown_bodies": sorted(self._core.unknown),
            "inside_ms": {"p50": float(np.percentile(spent_ms, 50)), "p99": float(np.percentile(spent_ms, 99))},
        }

    def _newly_unknown(self) -> list[Event]:
        if len(self._core.unknown) == self._unknown:
            return []
        self._unknown = len(self._core.unknown)
        names = ", ".join(sorted(self._core.unknown))
        return [Event(Severity.INFO, SOURCE, f"bodies that are none of the lab's are left out: {names}")]


async def run(
    config: LabConfig,
    linger_s: float | None,
    outputs: Outputs,
    clock: Clock,
    ground: str = GCS_NAME,
    protection: Protection = LOOPBACK_ONLY,
) -> None:
    """Serve the lab until SIGINT or SIGTERM, or for `linger_s` after who started it and every ground are gone.

    ground: the name of the ground whose state says which motors are on.
    Raises BusError, MocapFileError, and ServiceError where another process serves the lab already.
    """
    stop = Stop(outputs.event)
    bus = await ZenohBus.open(config.link.joined, config.name, protection=protection)
    try:
        mocap_bus = MocapBus(bus, clock)
        if await mocap_bus.serving(0.5) is not None:
            raise ServiceError(f"another mocap process serves {config.name!r} already")
        mocap = Mocap(config, mocap_bus, bus.rejections, outputs, clock)
        mocap_bus.announce(configuration_name(config))
        notify(READY)
        bus.on_state(ground, mocap.receive_ground_state)
        awaited = (
            bus_at(config.link.joined.zenoh_connect, lambda: bus.is_joined, GROUND_REMEDY),
            Precondition(f"frames of source {config.mocap.source!r}", lambda: mocap.has_frame, _remedy(config)),
        )
        missing = report_missing(SOURCE, awaited, mocap.report, bus.others)
        async with beside(protection.attend(outputs.event), missing):
            await first_of(mocap.watch(linger_s), mocap.source.run(), stop.wait())
    finally:
        await bus.close()


def _remedy(config: LabConfig) -> str:
    if config.mocap.source == "zenoh":
        return f"nobody publishes on {config.name}/mocap/raw: start your publisher, or `gcs-sim mocap` to try"
    return "are the cameras on and streaming? `gcs mocap discover` finds what there is"


COLUMNS = ("body", "seen", "longest gap", "noise at rest", "x", "y", "z", "yaw", "rejected")


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
        f"{where}: {timing['rate_hz']:.1f} Hz, jitter {1e3 * timing['jitter_s']:.2f} ms, "
        f"longest gap {1e3 * timing['gap_s']:.0f} ms, lost {timing['lost_share']:.1%} ({state['lost']} in all), "
        f"{state['frames']} frames, {state['refused']} refused"
    )


def _clock(state: dict[str, Any]) -> str:
    timing = state["timing"]
    clock = "no exposure times reported: delay_s is used" if state["latency_ms"] is None else ""
    if not clock:
        constant = "" if state["latency_measured"] else ", apart from the constant that latency_s says"
        clock = f"latency {state['latency_ms']:.1f} ms, uncertain by {state['uncertainty_ms'] or 0.0:.2f} ms{constant}"
    delay = "" if timing is None else f"exposure to receipt {1e3 * timing['delay_s']:.1f} ms (median); "
    return delay + clock


def _stamps(state: dict[str, Any]) -> tuple[str, ...]:
    """The line about stamps that are no exposures, if there is one."""
    if state["retimed_scatter_s"] is not None:
        scatter_ms = 1e3 * state["retimed_scatter_s"]
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
    noise = "moves" if body["noise_m"] is None else f"{1e3 * body['noise_m']:.2f} mm"
    yaw = "-" if body["yaw_rad"] is None else f"{degrees(body['yaw_rad']):.1f} deg"
    where = (f"{x:.3f}" for x in body["pos_lab_m"])
    return body["body"], f"{body['seen_share']:.1%}", f"{1e3 * body['gap_s']:.0f} ms", noise, *where, yaw


@dropping_output()
def serve(
    config: LabConfig,
    linger_s: float | None,
    as_json: bool,
    clock: Clock,
    ground: str,
    protection: Protection = LOOPBACK_ONLY,
) -> None:
    """Run the mocap process until SIGINT or SIGTERM, then end the program with its exit code.

    On a terminal a table shows the mocap's state; with as_json a line of JSON is printed each second.
    """
    compile_all("gcs", lambda: warm_up(config), sys.stderr)
    try:
        with _outputs(as_json) as outputs:
            outputs.event(Event(Severity.INFO, SOURCE, f"priority: {prefer_process()}"))
            uvloop.run(run(config, linger_s, outputs, clock, ground, protection))
    except MocapFileError as error:
        fail(str(error), NOT_RIGHT)
    except ServiceError as error:
        fail(str(error), error.code)
    except OSError as error:
        fail(str(error), REJECTED)


@contextmanager
def _outputs(as_json: bool) -> Iterator[Outputs]:
    """The terminal's, for as long as the process serves."""
    console = Console()
    if as_json:
        yield Outputs(print_event_json, lambda state: print(json.dumps(state), flush=True))
    elif console.is_terminal:
        with LiveTable(console) as table:
            yield Outputs(table.print_event, table.show)
    else:
        yield Outputs(print_event)
