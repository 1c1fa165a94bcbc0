"""The end of every run: its log becomes numbers and a page."""

from dataclasses import replace
from pathlib import Path

from analysis import metrics, report
from analysis.load import Flight, load_checked
from analysis.metrics import Summary
from sim.script import Outcome

GOOD = ("landed", "held")


def conclude(mcap: Path, outcome: Outcome, realtime_factor: float | None = None) -> tuple[Flight, Summary]:
    """Write the report beside the log; the flight and its numbers.

    What the host saw fail wins over what the log can tell.
    """
    page = mcap.with_name("report.html")
    flight, checked = load_checked(mcap)
    summary = metrics.summarise(flight, mcap=mcap, report=page, realtime_factor=realtime_factor)
    if outcome.result == "starved" or (outcome.result not in GOOD and summary.outcome in GOOD):
        summary = replace(summary, outcome=f"{outcome.result}: {outcome.reason}")
    report.write(flight, summary, page, "" if checked.complete else checked.damage)
    return flight, summary
