"""A summary as a person reads it in a terminal."""

from rich.console import Console
from rich.table import Table
from rich.text import Text

from analysis.metrics import Summary
from analysis.words import counted, mm


def print_summary(summary: Summary, console: Console) -> None:
    """Print the run's numbers, one a line; a number that the log does not have is left out."""
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in _lines(summary):
        table.add_row(name, Text(value))  # what drones and people said is never markup
    console.print(table)


def _lines(summary: Summary) -> list[tuple[str, str]]:
    """(name, value) of what is known."""
    lines = [("outcome", str(summary.outcome)), ("flight", _flight(summary))]
    if summary.formation_rms_m is not None:
        lines.append(("formation error", f"{mm(summary.formation_rms_m)} RMS, {mm(summary.formation_max_m)} largest"))
    if summary.leader_rms_m is not None:
        lines.append(("leader tracking error", f"{mm(summary.leader_rms_m)} RMS, {mm(summary.leader_max_m)} largest"))
    if summary.vibration_m is not None:
        lines.append(("vibration", mm(summary.vibration_m)))
    if summary.altitude_rms_m is not None:
        lines.append(("altitude error", f"{mm(summary.altitude_rms_m)} RMS"))
    if summary.min_separation_m is not None:
        lines.append(("least separation", f"{summary.min_separation_m:.3f} m"))
    late = counted(summary.late_ticks, "control cycle")
    lines.append(("frames", f"{summary.frames}, {late} late"))
    latencies = ("mocap process", summary.mocap_ms), ("latency", summary.latency_ms), ("links", summary.link_behind_ms)
    for name, latency in latencies:
        if latency is not None:
            lines.append((name, f"{latency.p50:.2f} ms median, {latency.p99:.2f} ms 99 %, {latency.max:.2f} ms max"))
    if summary.age_ms is not None:
        lines.append(("setpoint age", f"{summary.age_ms.p50:.1f} ms median, {summary.age_ms.p99:.1f} ms 99 %"))
    if summary.realtime_factor is not None:
        lines.append(("speed", f"{summary.realtime_factor:.1f} times real time"))
    lines.append(("commands", summary.command_hash))
    return lines + [(name, path) for name, path in (("log", summary.mcap), ("report", summary.report)) if path]


def _flight(summary: Summary) -> str:
    """Scenario, seed, link, length and size in one line."""
    named = [summary.scenario] if summary.scenario else []
    seeded = [f"seed {summary.seed}"] if summary.seed is not None else []
    linked = [f"over {summary.link}"] if summary.link else []
    return ", ".join([*named, *seeded, *linked, f"{summary.duration_s:.1f} s", counted(summary.followers, "follower")])
