"""Who of several viewers of a page may command: one at a time, and everybody sees who. Pure.

A stop is everybody's, always.
"""

from dataclasses import dataclass, field


@dataclass(slots=True)
class Control:
    """Viewers by name, in order of their coming; the first has the control until it leaves or another takes it."""

    holder: str | None = None
    previous: str | None = None
    """Who had the control before the holder took it over."""
    viewers: list[str] = field(default_factory=list)

    def come(self, viewer: str, *, may_command: bool = True) -> None:
        """A viewer has opened the page; may_command: whether its role allows more than a stop."""
        if viewer not in self.viewers:
            self.viewers.append(viewer)
        if self.holder is None and may_command:
            self.holder = viewer

    def leave(self, viewer: str) -> None:
        """A viewer has gone; if it had the control, nobody has it: somebody must take it."""
        if viewer in self.viewers:
            self.viewers.remove(viewer)
        if self.holder == viewer:
            self.holder = None

    def take_control(self, viewer: str) -> None:
        """A viewer takes the control over."""
        if self.holder not in (None, viewer):
            self.previous = self.holder
        self.holder = viewer

    def status_text(self, viewer: str) -> str:
        """The status text for a viewer; empty for one that is alone and has the control."""
        if self.holder == viewer:
            others = len(self.viewers) - 1
            return "" if others < 1 else f"{others} more {'viewer looks' if others == 1 else 'viewers look'} on"
        if self.holder is None:
            return "Nobody has the control: this page is read-only until you take it"
        handover = f"{self.holder} has taken the control over from {viewer}. " if self.previous == viewer else ""
        return f"{handover}Read-only: {self.holder} has the control"
