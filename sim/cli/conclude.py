"""The end of every run: its log becomes numbers and a page."""

from dataclasses import replace
from pathlib import Path

from analysis import metrics, report
from analysis.load import Flight, load_checked
from analysis.metrics import Summary
from analysis.outcome import GOOD
from sim.script import Outcome


def conclude(mcap: Path, outcome: Outcome, realtime_factor: float | None = None) -> tuple[Flight, Summary]:
    """Write the report beside the log; the flight and its numbers.

    The outcome has the failures that the host saw beside those in the log.
    """
    page = mcap.with_name("report.html")
    flight, checked = load_checked(mcap)
    summary = metrics.summarise(flight, mcap=mcap, report=page, realtime_factor=realtime_factor)
    summary = replace(summary, outcome=_joined(outcome, summary.outcome))
    report.write(flight, summary, page, "" if checked.complete else checked.damage)
    return flight, summary


def _joined(host: Outcome, log: str) -> str:
    """The outcome by the host and by the log: the worse of the two, with both reasons."""
    kind, _, reason = log.partition(": ")
    if host.result == "starved" or (host.result not in GOOD and log in GOOD):
        return f"{host.result}: {host.reason}"
    if host.result == "aborted" and kind in ("lost", "cut"):
        return f"{kind}: {host.reason}; {reason}"
    return log
