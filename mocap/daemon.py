"""The mocap process: a source's frames in, aligned and checked frames onto the lab's bus. It decides nothing.

A process of its own, so that poses reach the drones whatever becomes of the ground.
"""

import asyncio
import gc
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from formation import topics
from formation.config import LabConfig
from formation.messages import Event, Severity
from formation.requests import GCS_NAME
from formation.topics import Topic
from mocap import figures
from mocap.core import SOURCE, MocapCore
from mocap.figures import FrameWindow
from mocap.service import ServiceError, configuration_name
from mocap.sources import source
from mocap.sources.recordings import Frame
from mocap.sources.registry import open_source
from mocap.sources.source import Feed, SourceStatus
from wire.clock import Clock
from wire.ground_state import decode
from wire.process.daemon import GROUND_REMEDY, Awaited, EventSink, Stop, bus_at, report_missing
from wire.process.service_manager import READY, Watchdog, notify
from wire.rejections import RejectionLog
from wire.security.protection import LOOPBACK_ONLY, Protection
from wire.transport.mocap_bus import MocapBus
from wire.transport.zenoh_bus import ZenohBus

EVERY_NS = 10_000_000_000
CHANGED = 2.0
POOR_S = 2e-3
"""More than this turns a drone's fastest turns into degrees."""


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
        return (Event(Severity.WARNING if found_s > POOR_S else Severity.INFO, "mocap", text),)

    def _is_news(self, found_s: float, now_ns: int) -> bool:
        if self._reported_s is None:
            return True
        ratio = found_s / self._reported_s
        return now_ns - self._reported_ns >= EVERY_NS and not 1.0 / CHANGED < ratio < CHANGED


WATCH_NS = 100_000_000
STATE_NS = 1_000_000_000
REMEMBERED = 1000
OTHERS_S = 0.5


@dataclass(frozen=True, slots=True)
class Outputs:
    """The process's outputs beside the bus: its events, its state once a second, its records."""

    event: EventSink
    state: Callable[[dict[str, Any]], None] = lambda _: None
    record: Callable[[Topic, object, int], None] = lambda _topic, _message, _t_ns: None


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
        self._inside_s: deque[float] = deque(maxlen=REMEMBERED)
        self._listener_ns = self._state_ns = clock.monotonic_ns()
        self._unknown = 0
        feed = Feed(config.mocap, self.receive_frame, self.report, reject_log, clock)
        self.source = open_source(config, bus, feed, self.receive_frame)

    def receive_frame(self, frame: Frame) -> None:
        """Receive a frame and publish it at once."""
        now_ns = self._clock.monotonic_ns()
        aligned = self._core.receive(frame, now_ns)
        if aligned is not None:
            self._bus.publish_frame(aligned)
            self._inside_s.append((self._clock.monotonic_ns() - now_ns) * 1e-9)
            self._window.add(aligned)
            self._outputs.record(topics.MOCAP, aligned, now_ns)

    @property
    def has_frame(self) -> bool:
        """Whether any frame has come."""
        return self._core.frames > 0

    def receive_ground_state(self, state: str) -> None:
        """Receive the ground's published state, of which only which motors are on is used."""
        try:
            self._core.note_motors(decode(state).motors_on)
        except ValueError as error:
            self._core.reject_log.note("ground", str(error), self._clock.monotonic_ns())

    async def watch(self, linger_s: float | None) -> None:
        """Publish events and the state; return when nobody has listened for `linger_s`, if given."""
        watchdog = Watchdog()
        while True:
            now_ns = self._clock.monotonic_ns()
            watchdog.feed(now_ns)
            for event in (*self._core.reject_log.due(now_ns), *self._core.events(now_ns), *self._newly_unknown()):
                self.report(event)
            if now_ns - self._state_ns >= STATE_NS:
                self._state_ns = now_ns
                state = self.state(now_ns)
                self._bus.publish_state(state)
                self._outputs.state(state)
                for event in self._certainty.events(self.source.status(), now_ns):
                    self.report(event)
            if self._bus.has_subscribers:
                self._listener_ns = now_ns
            if linger_s is not None and now_ns - self._listener_ns > linger_s * 1e9:
                return
            await self._clock.sleep_until_ns(now_ns + WATCH_NS)

    def report(self, event: Event) -> None:
        """Report an event here, and on the bus, where the ground records it."""
        self._outputs.event(event)
        self._outputs.record(topics.EVENT, event, self._clock.monotonic_ns())
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
    """Serve the lab until SIGINT or SIGTERM, or until nobody has listened for `linger_s`.

    ground: the name of the ground whose state says which motors are on.
    Raises BusError, MocapFileError, and ServiceError where another process serves the lab already.
    """
    stop = Stop()
    awaited_task: asyncio.Task[None] | None = None
    attending = asyncio.create_task(protection.attend(outputs.event))
    bus = await ZenohBus.open(config.link.joined, config.name, protection=protection)
    try:
        mocap_bus = MocapBus(bus, clock)
        if await mocap_bus.serving(OTHERS_S) is not None:
            raise ServiceError(f"another mocap process serves {config.name!r} already")
        mocap = Mocap(config, mocap_bus, bus.rejections, outputs, clock)
        mocap_bus.announce(configuration_name(config))
        notify(READY)
        bus.on_state(ground, mocap.receive_ground_state)
        gc.collect()
        gc.freeze()  # what start-up made lives as long as the process: collections between frames need not look at it
        awaited = (
            bus_at(config.link.joined.zenoh_connect, lambda: bus.is_joined, GROUND_REMEDY),
            Awaited(f"frames of source {config.mocap.source!r}", lambda: mocap.has_frame, _remedy(config)),
        )
        awaited_task = asyncio.create_task(report_missing(SOURCE, awaited, mocap.report, bus.others))
        await _first_of(mocap.watch(linger_s), mocap.source.run(), stop.wait())
    finally:
        attending.cancel()
        if awaited_task is not None:
            awaited_task.cancel()
        await bus.close()


def _remedy(config: LabConfig) -> str:
    if config.mocap.source == "zenoh":
        return f"nobody publishes on {config.name}/mocap/raw: start your publisher, or `gcs-sim mocap` to try"
    return "are the cameras on and streaming? `gcs mocap discover` finds what there is"


async def _first_of(*parts: Any) -> None:
    """Return with the first part that ends, or raise what it raised; the others are cancelled."""
    tasks = [asyncio.ensure_future(part) for part in parts]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
