"""What the ground's host reports to the core: log, stop button, other grounds on the lab's bus."""

from formation.messages import Event, EventCode, HostReport, Severity
from gcs.safety.monitors import LOG_TROUBLE


class Host:
    """The newest report of the host. It forbids arming and touches no output of the control."""

    def __init__(self, without: frozenset[str]) -> None:
        self._without = without
        self._report = HostReport()

    @property
    def other_grounds(self) -> tuple[str, ...]:
        """Other grounds that are alive on the lab's bus."""
        return self._report.other_grounds

    @property
    def log_trouble(self) -> str:
        """What is wrong with the log, in words; empty while it is written in time."""
        return "" if LOG_TROUBLE in self._without else self._report.log_trouble

    @property
    def button_trouble(self) -> str:
        """What is wrong with the stop button, in words; empty while it is there, or none is configured."""
        return self._report.button_trouble

    def receive(self, report: HostReport) -> list[Event]:
        """Receive a report; return events for what is new in it."""
        grounds, before = self.other_grounds, self._troubles
        self._report = report
        events = [
            Event(
                Severity.WARNING,
                "flight",
                f"another ground is alive: {name}",
                code=EventCode.OTHER_GROUND,
                subject=name,
            )
            for name in report.other_grounds
            if name not in grounds
        ]
        for old, new in zip(before, self._troubles, strict=True):
            if new.text and new != old:
                events.append(new)
            elif old.text and not new.text:
                events.append(old.over())
        return events

    @property
    def _troubles(self) -> tuple[Event, ...]:
        """What may be wrong, as events; the text of one that is not is empty."""
        troubles = (
            ("log", self.log_trouble, EventCode.LOG),
            ("security", self._report.exposed, EventCode.INSECURE),
            ("stop button", self.button_trouble, EventCode.STOP_BUTTON),
        )
        return tuple(Event(Severity.CRITICAL, source, text, lasts=True, code=code) for source, text, code in troubles)
