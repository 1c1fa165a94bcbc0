"""The end of every run: its log becomes numbers, a page, a summary on the terminal and, if asked, a JSON file."""

from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.table import Table

from analysis import load, metrics, report
from analysis.metrics import Summary
from sim.script import Outcome
from wire.mcap_log import check_log


def conclude(mcap: Path, outcome: Outcome, realtime_factor: float | None = None) -> Summary:
    """Write the report beside the log; the run's numbers. What the host saw fail wins over what the log can tell."""
    page = mcap.with_name("report.html")
    flight = load.load(mcap)
    summary = metrics.summarise(flight, mcap=mcap, report=page, realtime_factor=realtime_factor)
    if outcome.result == "aborted" and not summary.outcome.startswith("aborted"):
        summary = replace(summary, outcome=f"aborted: {outcome.reason}")
    checked = check_log(mcap)
    report.write(flight, summary, page, "" if checked.complete else checked.damage)
    return summary


def show(summary: Summary, console: Console) -> None:
    """Print the summary for a person."""
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    rows = {
        "outcome": summary.outcome,
        "scenario": f"{summary.scenario}, seed {summary.seed}, link {summary.link}",
        "flight": f"{summary.duration_s:.1f} s, {summary.followers} followers, {summary.frames} frames",
        "formation error": f"{_mm(summary.formation_rms_m)} RMS, {_mm(summary.formation_max_m)} at most",
        "vibration": _mm(summary.vibration_m),
        "altitude": f"{_mm(summary.altitude_rms_m)} RMS",
        "separation": "-" if summary.min_separation_m is None else f"{summary.min_separation_m:.3f} m at least",
        "late ticks": str(summary.late_ticks),
    }
    if summary.latency_ms is not None:
        latency = summary.latency_ms
        rows["latency"] = f"{latency.p50:.2f} ms median, {latency.p99:.2f} ms p99, {latency.max:.2f} ms max"
    if summary.age_ms is not None:
        rows["age at the drones"] = f"{summary.age_ms.p50:.1f} ms median, {summary.age_ms.p99:.1f} ms p99"
    if summary.realtime_factor is not None:
        rows["speed"] = f"{summary.realtime_factor:.1f} times real time"
    rows |= {"commands": summary.command_hash, "log": str(summary.mcap), "report": str(summary.report)}
    for name, value in rows.items():
        table.add_row(name, value)
    console.print(table)


def _mm(metres: float | None) -> str:
    return "-" if metres is None else f"{1e3 * metres:.2f} mm"
