"""What every camera system's client is, and where what it receives goes.

A client speaks one protocol and knows the exposure of each frame as well as that system can tell it. Names, units and
everything after them are the same for all, and are seen to here.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from formation.maths.arrays import Bool, Float
from formation.messages import Event, RawFrame, Severity
from formation.mocap_config import MocapConfig
from wire.clock import Clock
from wire.plain_text import plain
from wire.process.lifetime import Tell
from wire.refusals import Refusals

LONGEST_NAME, LONGEST_TEXT = 64, 200


@dataclass(frozen=True, slots=True)
class SourceStatus:
    """How a source is doing, for `gcs mocap` and the log.

    server: what it says of itself, or its address; lost: frames that were numbered or stamped and never came.
    latency_s: from exposure to receipt of the newest frames; uncertainty_s: how far the capture times may be off, apart
    from a constant where `constant_told` is False (VRPN, QTM: what `mocap.latency_s` says). None before it is known.
    bodies: what it sends, by the names of the lab.
    """

    server: str = ""
    connected: bool = False
    lost: int = 0
    latency_s: float | None = None
    uncertainty_s: float | None = None
    constant_told: bool = False
    bodies: tuple[str, ...] = ()


class Source(Protocol):
    """A camera system's client."""

    async def run(self) -> None:
        """Take frames until cancelled. Whatever the server does, it is told of, and connected to again."""

    def status(self) -> SourceStatus:
        """How it is doing."""


class Feed:
    """One source's way into the mocap process: frames, names, words, refusals, the time."""

    def __init__(
        self,
        config: MocapConfig,
        deliver: Callable[[RawFrame], None],
        say: Tell,
        refusals: Refusals,
        clock: Clock,
    ) -> None:
        self.clock = clock
        self.unit_m = config.unit_m
        self._deliver = deliver
        self._say = say
        self._refusals = refusals
        self._source = config.source
        self._names = config.names

    def name(self, theirs: str) -> str:
        """What the lab calls the body that the source calls `theirs`."""
        return self._names.get(theirs) or plain(theirs, LONGEST_NAME)

    def frame(self, seq: int, t_capture_ns: int, bodies: tuple[str, ...], pos_m: Float, q: Float, seen: Bool) -> None:
        """One exposure: positions (n, 3), marker frames (n, 4) w x y z, seen (n,), bodies by `name`.

        t_capture_ns: on our clock. Any numbers at all: they are judged afterwards, body by body.
        """
        self._deliver(RawFrame(seq, t_capture_ns, bodies, pos_m, q, seen))

    def say(self, severity: Severity, text: str) -> None:
        """Tell the operator."""
        self._say(Event(severity, self._source, plain(text, LONGEST_TEXT)))

    def refuse(self, reason: str, count: int = 1) -> None:
        """Something that came was not taken; `reason` is one of few, in words of ours."""
        self._refusals.note(self._source, reason, self.clock.monotonic_ns(), count)


def seconds(ns: int | None) -> float | None:
    """Of nanoseconds; None of what is not known."""
    return None if ns is None else ns * 1e-9


def as_json(status: SourceStatus) -> dict[str, Any]:
    """For the state that the mocap process publishes; times in ms."""
    return {
        "server": status.server,
        "connected": status.connected,
        "lost": status.lost,
        "latency_ms": None if status.latency_s is None else 1e3 * status.latency_s,
        "uncertainty_ms": None if status.uncertainty_s is None else 1e3 * status.uncertainty_s,
        "constant_told": status.constant_told,
        "bodies": list(status.bodies),
    }
