"""The source filter of one key: it accepts the first of several publishers until that is silent. Pure."""

from dataclasses import dataclass

SILENT_NS = 250_000_000
"""A publisher silent for so long may be replaced; less than the 0.4 s after which a lost body lands the swarm."""


@dataclass(slots=True)
class SourceFilter:
    """The publisher of one key. The bus does not authenticate publishers, but two at once are detected."""

    current: bytes | None = None
    _received_ns: int = 0

    def rejects(self, publisher: bytes, now_ns: int) -> bool:
        """Whether another publisher is current: its last frame is less than SILENT_NS old."""
        return self.current is not None and publisher != self.current and now_ns - self._received_ns < SILENT_NS

    def accept(self, publisher: bytes, now_ns: int) -> None:
        """Make this publisher the current one: its frame was valid."""
        self.current, self._received_ns = publisher, now_ns
