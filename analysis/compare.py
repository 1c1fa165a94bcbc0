"""Two flights side by side: numbers, their differences, overlaid pictures; one self-contained page, or JSON.

In the pictures the first is dark, the second coloured; times count from each one's entry into formation.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from analysis import page
from analysis.load import Flight, load
from analysis.metrics import KEYS, Summary, summarise
from analysis.page import Section, render
from analysis.plots import style
from analysis.plots.motion import paths_m
from analysis.plots.style import Drawing, Missing
from analysis.tracking import Tracking, track, track_leader
from formation.maths.arrays import Float
from formation.messages import Phase
from wire.text import parse_json

COLOURS = (style.LEADER, style.FOLLOWERS[1])


@dataclass(frozen=True, slots=True, eq=False)
class Flown:
    """A flight with its name, its tracking, and when it first entered formation."""

    name: str
    flight: Flight
    tracking: Tracking
    formed_s: float
    first: bool


def flown(name: str, flight: Flight, first: bool) -> Flown:
    """The flight, ready to be laid over another, as the first or the second of the two."""
    spans = flight.spans(Phase.FORMATION)
    return Flown(name, flight, track(flight), spans[0].start_s if spans else 0.0, first)


def draw_errors(a: Flown, b: Flown) -> Drawing:
    """Root mean square of the followers' formation errors against time."""
    lines = [
        (one, one.tracking.t_s[formed], 1e3 * _rms(one.tracking.error_lead_m[formed]))
        for one in (a, b)
        if (formed := one.tracking.formed.all(axis=1)).any()
    ]
    return _against_time(lines, "formation error, mm", "neither flew in formation")


def draw_leader_errors(a: Flown, b: Flown) -> Drawing:
    """Length of the leaders' tracking errors against time."""
    lines = [
        (one, leader.t_s, 1e3 * np.linalg.norm(leader.error_lab_m, axis=-1))
        for one in (a, b)
        if len((leader := track_leader(one.flight)).t_s)
    ]
    return _against_time(lines, "leader tracking error, mm", "neither leader had a reference in formation")


def draw_paths(a: Flown, b: Flown) -> Drawing:
    """Every vehicle's way in formation, from above."""
    if not len(a.flight.poses) and not len(b.flight.poses):
        return Missing("no mocap frame was recorded")
    fig, [[ax]] = style.Sheet(5.0, width_in=0.6 * style.WIDTH_IN).axes()
    for one, colour in zip((a, b), COLOURS, strict=True):
        for i, path_m in enumerate(paths_m(one.flight)):
            ax.plot(*path_m.T, color=colour, lw=1.0, alpha=0.8, label=one.name if i == 0 else None)
    ax.set(xlabel="lab x, m", ylabel="lab y, m")
    ax.set_aspect("equal", adjustable="datalim")
    style.legend(ax)
    return fig


def _against_time(lines: list[tuple[Flown, Float, Float]], label: str, missing: str) -> Drawing:
    if not lines:
        return Missing(missing)
    fig, [[ax]] = style.Sheet(2.6).axes()
    for one, t_s, values in lines:
        colour = COLOURS[0] if one.first else COLOURS[1]
        root = float(np.sqrt(np.mean(np.square(values))))
        style.line(ax, t_s - one.formed_s, values, color=colour, lw=1.0, label=f"{one.name}, RMS {root:.3g} mm")
    ax.set(ylabel=label, ylim=(0.0, None))
    style.time_axis(ax, 0.0, max(float(t_s[-1]) - one.formed_s for one, t_s, _ in lines))
    ax.set_xlabel("time in formation, s")
    style.legend(ax)
    return fig


def _rms(error_m: Float) -> Float:
    """(T, k, 3) -> (T,): the root mean square length over the followers."""
    squares: Float = np.sqrt(np.mean(np.sum(np.square(error_m), axis=-1), axis=-1))
    return squares


FACTS = ("scenario", "seed", "link", "outcome", "command_hash")
PROVENANCE = ("date", "versions", "machine", "lab_file")
SAME = "the same"


@dataclass(frozen=True, slots=True)
class Side:
    """One of the two."""

    name: str
    flight: Flight
    summary: Summary


def sides(path_a: Path, path_b: Path) -> tuple[Side, Side]:
    """Both flights, read and summed up. Raises as `analysis.load.load`."""
    a, b = (Side(path.name, flight := load(path), summarise(flight, mcap=path)) for path in (path_a, path_b))
    if a.name == b.name:
        return Side(str(path_a), a.flight, a.summary), Side(str(path_b), b.flight, b.summary)
    return a, b


def numbers(a: Side, b: Side) -> dict[str, tuple[float | None, float | None]]:
    """Every number of the two summaries, by its key; latencies as `latency_ms.p99` and the like."""
    return {key: (a.summary.number(key), b.summary.number(key)) for key in KEYS if key not in FACTS}


def configuration(a: Side, b: Side) -> dict[str, tuple[object, object]]:
    """What the two were flown with and is not the same: keys of lab, gains and profiles, with both values."""
    flat = [dict(_flown_with(side.flight)) for side in (a, b)]
    keys = dict.fromkeys([*flat[0], *flat[1]])
    return {key: (flat[0].get(key), flat[1].get(key)) for key in keys if flat[0].get(key) != flat[1].get(key)}


def to_json(a: Side, b: Side) -> str:
    """Both summaries, the differences b - a, and the configuration that is not the same."""
    values = {
        "a": a.summary.as_dict(),
        "b": b.summary.as_dict(),
        "difference": {key: None if x is None or y is None else y - x for key, (x, y) in numbers(a, b).items()},
        "configuration": configuration(a, b),
    }
    return json.dumps(values, indent=2, allow_nan=False)


def html(a: Side, b: Side, heading: str = "", further: Sequence[Section] = ()) -> str:
    """The page; heading: of another question than how the two compare, whose answers are `further`."""
    with style.styled():
        both = flown(a.name, a.flight, True), flown(b.name, b.flight, False)
        error, leader, paths = (draw(*both) for draw in (draw_errors, draw_leader_errors, draw_paths))
    return render(
        title=heading or f"{a.name} and {b.name} · compared",
        kind="Two flights compared",
        heading=heading or f"{a.name} and {b.name}",
        facts="In the pictures the first is dark, the second coloured; times count from each flight’s own entry into "
        "formation.",
        sections=(
            Section("numbers", "Numbers", parts=(_number_table(a, b),)),
            Section("error", "Formation error", "Root mean square over the followers at each moment.", (error,)),
            Section("leader", "Leader tracking error", drawings=(leader,)),
            Section("paths", "Paths", "From above, in formation.", (paths,)),
            *further,
            _setup_section(a, b),
        ),
    )


def _number_table(a: Side, b: Side) -> page.Table | None:
    rows = [
        (key, str(_fact(a, key)), str(_fact(b, key)), "", "")
        for key in (*FACTS, *PROVENANCE)
        if _fact(a, key) or _fact(b, key)
    ]
    for key, (x, y) in numbers(a, b).items():
        if x is None and y is None:
            continue
        change = None if x is None or y is None else y - x
        share = f"{100.0 * change / x:+.1f} %" if x and change is not None else ""
        rows.append((key, _value(x), _value(y), _change(change), share))
    return page.table(("key", f"#{a.name}", f"#{b.name}", "#second - first", "#change"), rows)


def _fact(side: Side, key: str) -> object:
    value = getattr(side.summary, key) if key in FACTS else side.flight.run.metadata.get(key, "")
    return f"{value[:16]}…" if key == "command_hash" else "" if value is None else value


def _value(value: float | None) -> str:
    return "–" if value is None else f"{value:.5g}" if isinstance(value, float) else f"{value}"


def _change(change: float | None) -> str:
    return "–" if change is None else SAME if change == 0 else f"{change:+.3g}"


def _setup_section(a: Side, b: Side) -> Section:
    """What is not the same in the two configurations."""
    rows = [(key, str(x), str(y)) for key, (x, y) in configuration(a, b).items()]
    lead = "What is not the same in lab, gains and profiles." if rows else "Both were flown with the same."
    return Section("setup", "Flown with", lead, parts=(page.table(("`key", a.name, b.name), rows),))


def _flown_with(flight: Flight) -> Iterator[tuple[str, object]]:
    """Every key of the lab, and of gains and profiles as they were used, with its value."""
    if flight.run.lab is not None:
        yield from _flat(flight.run.lab.model_dump(mode="json"), "lab")
    for part in ("gains", "profiles"):
        try:
            yield from _flat(parse_json(flight.run.metadata.get(part, "{}")), part)
        except ValueError:  # of a later version, or somebody's own
            yield part, flight.run.metadata[part]


def _flat(value: object, prefix: str) -> Iterator[tuple[str, object]]:
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _flat(inner, f"{prefix}.{key}")
    elif isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        for k, item in enumerate(value):
            yield from _flat(item, f"{prefix}[{k}]")
    else:
        yield prefix, value


def print_comparison(a: Side, b: Side, console: Console) -> None:
    """Print the numbers of two flights and their differences; a number that neither log has is left out."""
    table = Table(box=None, pad_edge=False)
    for name in ("", a.name, b.name, "second - first"):
        table.add_column(Text(name), justify="left" if name == "" else "right")
    for key, (x, y) in numbers(a, b).items():
        if x is not None or y is not None:
            change = "" if x is None or y is None else f"{y - x:+.3g}"
            table.add_row(key, *("-" if value is None else f"{value:.5g}" for value in (x, y)), change)
    console.print(table)
    for side in (a, b):
        if side.summary.law_failures:
            console.print(Text(f"{side.name}: its law failed, so it has no figures: {side.summary.outcome.reason}"))
    for key, (was, is_now) in configuration(a, b).items():
        console.print(Text(f"{key}: {was} | {is_now}"))
