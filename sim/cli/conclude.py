"""The end of every run: its log becomes numbers and a page."""

from dataclasses import replace
from pathlib import Path

from analysis import load, metrics, report
from analysis.metrics import Summary
from sim.script import Outcome
from wire.logs.mcap_log import check_log


def conclude(mcap: Path, outcome: Outcome, realtime_factor: float | None = None) -> Summary:
    """Write the report beside the log; the run's numbers. What the host saw fail wins over what the log can tell."""
    page = mcap.with_name("report.html")
    flight = load.load(mcap)
    summary = metrics.summarise(flight, mcap=mcap, report=page, realtime_factor=realtime_factor)
    if outcome.result == "starved" or (outcome.result == "aborted" and not summary.outcome.startswith("aborted")):
        summary = replace(summary, outcome=f"{outcome.result}: {outcome.reason}")
    checked = check_log(mcap)
    report.write(flight, summary, page, "" if checked.complete else checked.damage)
    return summary
