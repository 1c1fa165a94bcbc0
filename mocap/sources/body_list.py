"""Which of the lab's bodies a server names."""

from formation.messages import Severity
from mocap.sources.source import Feed


class BodyList:
    """Reports to the operator, whenever the server's list changes, which of the lab's bodies are not on it."""

    def __init__(self, lab: tuple[str, ...], feed: Feed) -> None:
        self._lab = lab
        self._feed = feed
        self.bodies: tuple[str, ...] = ()
        """What the server sends, by the names of the lab."""
        self._reported: tuple[str, ...] | None = None

    def receive(self, theirs: tuple[str, ...]) -> tuple[str, ...]:
        """Receive the server's list of names; return the bodies by the names of the lab."""
        self.bodies = tuple(self._feed.name(name) for name in theirs)
        if self.bodies != self._reported:
            self._reported = self.bodies
            self._report()
        return self.bodies

    def _report(self) -> None:
        listed = ", ".join(self.bodies) or "nothing"
        missing = [body for body in self._lab if body not in self.bodies]
        if missing:
            self._feed.report(Severity.WARNING, f"the server does not name {', '.join(missing)}; it names {listed}")
        else:
            self._feed.report(Severity.INFO, f"the server names {listed}")
