"""What the ground's host reports to the core: log, stop button, other grounds on the lab's bus."""

from formation.messages import OVER, Event, HostReport, Severity
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
        before, trouble_before, button_before = self.other_grounds, self.log_trouble, self.button_trouble
        exposed_before = self._report.exposed
        self._report = report
        events = [
            Event(Severity.WARNING, "flight", f"another ground is alive: {name}")
            for name in report.other_grounds
            if name not in before
        ]
        events += _changed("log", trouble_before, self.log_trouble)
        events += _changed("security", exposed_before, report.exposed)
        return events + _changed("stop button", button_before, self.button_trouble)


def _changed(source: str, before: str, after: str) -> list[Event]:
    """A trouble that began, or is over."""
    if after and after != before:
        return [Event(Severity.CRITICAL, source, after, lasts=True)]
    return [Event(Severity.NOTICE, source, f"{OVER}{before}")] if before and not after else []
