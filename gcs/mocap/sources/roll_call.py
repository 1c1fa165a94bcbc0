"""Which of the lab's bodies a server names."""

from formation.messages import Severity
from gcs.mocap.sources.source import Feed


class RollCall:
    """Tells the operator, whenever the server's list changes, which of the lab's bodies are not on it."""

    def __init__(self, lab: tuple[str, ...], feed: Feed) -> None:
        self._lab = lab
        self._feed = feed
        self.bodies: tuple[str, ...] = ()
        """What the server sends, by the names of the lab."""
        self._told: tuple[str, ...] | None = None

    def take(self, theirs: tuple[str, ...]) -> tuple[str, ...]:
        """The server's list has come, as it writes the names; the same by the names of the lab."""
        self.bodies = tuple(self._feed.name(name) for name in theirs)
        if self.bodies != self._told:
            self._told = self.bodies
            self._tell()
        return self.bodies

    def _tell(self) -> None:
        listed = ", ".join(self.bodies) or "nothing"
        missing = [body for body in self._lab if body not in self.bodies]
        if missing:
            self._feed.say(Severity.WARNING, f"the server does not name {', '.join(missing)}; it names {listed}")
        else:
            self._feed.say(Severity.INFO, f"the server names {listed}")
