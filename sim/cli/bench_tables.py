"""What `gcs-sim bench` prints: the figures of a machine as tables."""

from collections.abc import Iterator

from rich import box
from rich.table import Table

from sim.studies.bench import MANY, Result, Timing
from sim.studies.scale.against import Compared


def bench_tables(result: Result) -> Iterator[Table]:
    """One table of swarms, one of single calls, one of the bus."""
    swarms = _table("leader and followers, microseconds: median (shortest)", "")
    for swarm in result.swarms:
        swarms.add_column(f"+ {swarm.followers}", justify="right")
    swarms.add_row("law and estimate, a drone", *(f"{s.law_and_estimate_us_per_drone:.1f}" for s in result.swarms))
    swarms.add_row("estimate", *(_words(s.estimate) for s in result.swarms))
    swarms.add_row("law", *(_words(s.law) for s in result.swarms))
    swarms.add_row("control step", *(_words(s.step) for s in result.swarms))
    swarms.add_row("the ground's tick", *(_words(s.tick) for s in result.swarms))
    swarms.add_row("Python calls in it", *(f"{s.tick_calls.tick:.0f}" for s in result.swarms))
    swarms.add_row("and to take in what came", *(f"{s.tick_calls.receive:.0f}" for s in result.swarms))
    swarms.add_row("lockstep, s a second", *(f"{s.lockstep_speed:.1f}" for s in result.swarms))
    swarms.add_row("Python calls, a simulated second", *(f"{s.python_calls:,}" for s in result.swarms))
    yield swarms
    parts, calls = result.parts, _table("single calls", "", "each")
    calls.add_row(f"nearest neighbours of {MANY:,}", f"{parts.nearest_us:.0f} µs")
    calls.add_row(f"separation filter of {MANY:,}", f"{parts.separation_filter_us:.0f} µs")
    calls.add_row("encode an attitude target", f"{parts.encode_us:.1f} µs")
    calls.add_row("decode it", f"{parts.decode_us:.1f} µs")
    yield calls
    bus = _table("a frame on the bus, microseconds", "", "median", "99 %")
    bus.add_row("one hop between processes", f"{result.bus.hop.p50_us:.0f}", f"{result.bus.hop.p99_us:.0f}")
    bus.add_row("two, through the mocap process", f"{result.bus.path.p50_us:.0f}", f"{result.bus.path.p99_us:.0f}")
    bus.add_row("of it inside the mocap process", f"{result.bus.mocap_p50_us:.0f}", f"{result.bus.mocap_p99_us:.0f}")
    yield bus


def against_table(compared: Compared) -> Table:
    """A row a figure: here, at the other commit, and their ratio."""
    table = _table("the same figures of another commit", "", compared.revision, "here", "ratio")
    for name, here in compared.here.items():
        ratio = compared.ratio(name)
        table.add_row(name, f"{compared.there[name]:,.6g}", f"{here:,.6g}", "" if ratio is None else f"{ratio:.2f}")
    return table


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    for k, column in enumerate(columns):
        table.add_column(column, justify="right" if k else "left")
    return table


def _words(timing: Timing) -> str:
    return f"{timing.p50_us:.0f} ({timing.least_us:.0f})"
