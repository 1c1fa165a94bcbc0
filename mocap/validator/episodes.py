"""Events of rejections: one when a body's rejections begin, one with the counts when they end. Pure."""

from collections import Counter
from dataclasses import dataclass, field

from formation.messages import Event, LabFrame, Severity
from formation.rejection import Rejection
from mocap.validator.checks import name_of

SOURCE = "mocap"
QUIET_NS = 500_000_000
"""Rejections with shorter gaps form one episode, so that a flickering body does not fill the log."""


@dataclass(slots=True)
class _Episode:
    began_ns: int
    last_ns: int
    counts: Counter[Rejection] = field(default_factory=Counter)


class Episodes:
    """Those of a lab's bodies. `counts` holds all rejections since the start, by body and reason."""

    def __init__(self, bodies: tuple[str, ...]) -> None:
        self.counts: dict[str, Counter[Rejection]] = {body: Counter() for body in bodies}
        self._open: dict[str, _Episode] = {}
        self._events: list[Event] = []

    def note(self, frame: LabFrame, now_ns: int, detail: str = "") -> None:
        """Note the rejected poses of one frame; detail: what is known beside the reason."""
        for body, code in zip(frame.bodies, frame.rejected.tolist(), strict=True):
            if code:
                self._note(body, Rejection(code), now_ns, detail)

    def note_swaps(self, count: int, now_ns: int) -> None:
        """Note identity swaps that were corrected; count: pairs of bodies."""
        for _ in range(count):
            self._note("", Rejection.SWAP, now_ns)

    def due(self, now_ns: int) -> tuple[Event, ...]:
        """Events that are due."""
        if self._open:
            for body in [b for b, e in self._open.items() if now_ns - e.last_ns >= QUIET_NS]:
                self._close(body, self._open.pop(body))
        events, self._events = tuple(self._events), []
        return events

    def _note(self, body: str, reason: Rejection, now_ns: int, detail: str = "") -> None:
        if body:
            self.counts[body][reason] += 1
        if not name_of(reason):  # no valid pose: MocapCore's reject_log reports it
            return
        episode = self._open.get(body)
        if episode is None:
            episode = self._open[body] = _Episode(now_ns, now_ns)
            self._events.append(Event(Severity.WARNING, SOURCE, _began(body, reason, detail)))
        episode.last_ns = now_ns
        episode.counts[reason] += 1

    def _close(self, body: str, episode: _Episode) -> None:
        lasted_s = (episode.last_ns - episode.began_ns) * 1e-9
        counts = ", ".join(f"{count} x {name_of(reason)}" for reason, count in episode.counts.items())
        text = f"{body} is believed again" if body else "no bodies are swapped any more"
        self._events.append(Event(Severity.NOTICE, SOURCE, f"{text}: over {lasted_s:.2f} s, {counts}"))


def _began(body: str, reason: Rejection, detail: str) -> str:
    if not body:
        return f"{name_of(reason)}: two bodies were swapped; their poses are reassigned"
    return f"{body} is rejected, {name_of(reason)}: {detail or reason.text}"
