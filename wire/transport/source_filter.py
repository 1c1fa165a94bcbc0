"""Which of several publishers on one key is believed: the first, until it falls silent. Pure; time is an argument."""

from dataclasses import dataclass

SILENT_NS = 250_000_000
"""A publisher silent for so long is replaced: before a body unseen for 0.4 s makes the swarm land."""


@dataclass(slots=True)
class SourceFilter:
    """The publisher of one key. An open bus proves nobody's name, but two that publish at once are found out."""

    current: bytes | None = None
    _heard_ns: int = 0

    def rejects(self, publisher: bytes, now_ns: int) -> bool:
        """Whether another one was heard just now."""
        return self.current is not None and publisher != self.current and now_ns - self._heard_ns < SILENT_NS

    def accept(self, publisher: bytes, now_ns: int) -> None:
        """What it published was sound and is used."""
        self.current, self._heard_ns = publisher, now_ns
