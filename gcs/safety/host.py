"""What the ground's host tells the core of itself: the log, other grounds on the lab's bus."""

from formation.messages import Event, HostReport, Severity
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

    def take(self, report: HostReport) -> list[Event]:
        """Take a report in; what is new in it."""
        before, trouble_before = self.other_grounds, self.log_trouble
        self._report = report
        events = [
            Event(Severity.WARNING, "flight", f"another ground is alive: {name}")
            for name in report.other_grounds
            if name not in before
        ]
        trouble = self.log_trouble
        if trouble and trouble != trouble_before:
            events.append(Event(Severity.CRITICAL, "log", trouble))
        elif trouble_before and not trouble:
            events.append(Event(Severity.NOTICE, "log", f"over: {trouble_before}"))
        return events
