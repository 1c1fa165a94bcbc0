"""The interface of every camera system's client, and where its frames go.

A client speaks one protocol and computes the exposure time of each frame as well as that system reports it. Names,
units and everything after them are the same for all, and are handled here.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from formation.messages import Event, RawFrame, Severity
from formation.mocap_config import MocapConfig
from formation.model import LONGEST_NAME
from wire.clock import Clock
from wire.process.daemon import EventSink
from wire.rejections import RejectionLog
from wire.text import plain

LONGEST_TEXT = 200


@dataclass(frozen=True, slots=True)
class SourceStatus:
    """How a source is doing, for `gcs mocap` and the log.

    server: what it says of itself, or its address; lost: frames that were numbered or stamped and never came.
    latency_s: from exposure to receipt of the newest frames; uncertainty_s: of the capture times; None until known.
    latency_measured: whether the constant part of the latency is measured; else it is configured (VRPN, QTM:
    `mocap.latency_s`) and its error adds to uncertainty_s.
    bodies: what it sends, by the names of the lab.
    """

    server: str = ""
    connected: bool = False
    lost: int = 0
    latency_s: float | None = None
    uncertainty_s: float | None = None
    latency_measured: bool = False
    bodies: tuple[str, ...] = ()


class Source(Protocol):
    """A camera system's client."""

    async def run(self) -> None:
        """Receive frames until cancelled. Report whatever the server does, and reconnect."""

    def status(self) -> SourceStatus:
        """How it is doing."""


class Feed:
    """One source's interface to the mocap process: frames, names, events, rejected inputs, the time."""

    def __init__(
        self,
        config: MocapConfig,
        deliver: Callable[[RawFrame], None],
        report: EventSink,
        reject_log: RejectionLog,
        clock: Clock,
    ) -> None:
        self.clock = clock
        self.unit_m = config.unit_m
        self.deliver = deliver
        """Receives one exposure, stamped on our clock, bodies by `name`; any numbers at all: they are judged later."""
        self._report = report
        self._reject_log = reject_log
        self._source = config.source
        self._names = config.names

    def name(self, theirs: str) -> str:
        """The lab's name of the body that the source calls `theirs`."""
        return self._names.get(theirs) or plain(theirs, LONGEST_NAME)

    def report(self, severity: Severity, text: str) -> None:
        """Report an event to the operator."""
        self._report(Event(severity, self._source, plain(text, LONGEST_TEXT)))

    def reject(self, reason: str, count: int = 1) -> None:
        """Count a rejected input; `reason` is one of few fixed texts."""
        self._reject_log.note(self._source, reason, self.clock.monotonic_ns(), count)


def seconds(ns: int | None) -> float | None:
    """Nanoseconds in seconds; None for what is not known."""
    return None if ns is None else ns * 1e-9


def as_json(status: SourceStatus) -> dict[str, Any]:
    """For the state that the mocap process publishes; times in ms."""
    return {
        "server": status.server,
        "connected": status.connected,
        "lost": status.lost,
        "latency_ms": None if status.latency_s is None else 1e3 * status.latency_s,
        "uncertainty_ms": None if status.uncertainty_s is None else 1e3 * status.uncertainty_s,
        "latency_measured": status.latency_measured,
        "bodies": list(status.bodies),
    }
