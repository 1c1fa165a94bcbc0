"""Two flights side by side: numbers, their differences, overlaid pictures; one self-contained page, or JSON."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from analysis import page
from analysis.load import Flight, load
from analysis.metrics import Summary, summarise
from analysis.page import Section, cell, picture, row, table
from analysis.plots import overlay, style
from wire.text import parse_json

FIGURES = (
    "formation_rms_m", "formation_max_m", "leader_rms_m", "leader_max_m", "vibration_m", "altitude_rms_m",
    "min_separation_m", "duration_s", "frames", "late_ticks",
)  # fmt: skip
LATENCIES = ("mocap_ms", "latency_ms", "age_ms", "link_behind_ms")
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
    found: dict[str, tuple[float | None, float | None]] = {
        key: (getattr(a.summary, key), getattr(b.summary, key)) for key in FIGURES
    }
    for key in LATENCIES:
        parts = [asdict(value) if (value := getattr(side.summary, key)) is not None else {} for side in (a, b)]
        for part in dict.fromkeys([*parts[0], *parts[1]]):
            found[f"{key}.{part}"] = (parts[0].get(part), parts[1].get(part))
    return found


def configuration(a: Side, b: Side) -> dict[str, tuple[object, object]]:
    """What the two were flown with and is not the same: keys of lab, gains and profiles, with both values."""
    flat = [dict(_flown_with(side.flight)) for side in (a, b)]
    keys = dict.fromkeys([*flat[0], *flat[1]])
    return {key: (flat[0].get(key), flat[1].get(key)) for key in keys if flat[0].get(key) != flat[1].get(key)}


def to_json(a: Side, b: Side) -> str:
    """Both summaries, the differences b - a, and the configuration that is not the same."""
    values = {
        "a": asdict(a.summary),
        "b": asdict(b.summary),
        "difference": {key: None if x is None or y is None else y - x for key, (x, y) in numbers(a, b).items()},
        "configuration": configuration(a, b),
    }
    return json.dumps(values, indent=2, allow_nan=False)


def html(a: Side, b: Side) -> str:
    """The page."""
    with style.styled():
        both = overlay.flown(a.name, a.flight, True), overlay.flown(b.name, b.flight, False)
        error, leader, paths = (draw(*both) for draw in (overlay.errors, overlay.leader_errors, overlay.paths))
    head = (
        f'<header><p class="kind">Two flights compared</p><h1>{escape(a.name)} and {escape(b.name)}</h1>'
        '<p class="facts">In the pictures the first is dark, the second coloured; times count from each '
        "flight’s own entry into formation.</p></header>"
    )
    sections = (
        Section("numbers", "Numbers", "", (_number_table(a, b),)),
        Section("error", "Formation error", "Root mean square over the followers, from moment to moment.",
                (picture(error, "Formation error"),)),
        Section("leader", "Leader tracking error", "",
                (picture(leader, "Leader tracking error"),)),
        Section("paths", "Paths", "From above, in formation.",
                (picture(paths, "Paths"),)),
        Section("setup", "Flown with", "What is not the same in lab, gains and profiles.", (_setup_table(a, b),)),
    )  # fmt: skip
    return page.document(f"{a.name} and {b.name} · compared", head + "\n".join(s.html() for s in sections))


def _number_table(a: Side, b: Side) -> str:
    rows = [
        row(cell(key), cell(str(_fact(a, key))), cell(str(_fact(b, key))), cell(""), cell(""))
        for key in (*FACTS, *PROVENANCE)
        if _fact(a, key) or _fact(b, key)
    ]
    for key, (x, y) in numbers(a, b).items():
        if x is None and y is None:
            continue
        change = None if x is None or y is None else y - x
        share = f"{100.0 * change / x:+.1f} %" if x and change is not None else ""
        rows.append(row(cell(key), *(cell(_value(v), "number") for v in (x, y)), cell(_change(change), "number"),
                        cell(share, "number")))  # fmt: skip
    return table(("key", f"#{a.name}", f"#{b.name}", "#second - first", "#change"), rows)


def _fact(side: Side, key: str) -> object:
    value = getattr(side.summary, key) if key in FACTS else side.flight.run.metadata.get(key, "")
    return f"{value[:16]}…" if key == "command_hash" else "" if value is None else value


def _value(value: float | None) -> str:
    return "–" if value is None else f"{value:.5g}" if isinstance(value, float) else f"{value}"


def _change(change: float | None) -> str:
    return "–" if change is None else SAME if change == 0 else f"{change:+.3g}"


def _setup_table(a: Side, b: Side) -> str:
    rows = [
        row(f"<td><code>{escape(key)}</code></td>", cell(str(x)), cell(str(y)))
        for key, (x, y) in configuration(a, b).items()
    ]
    return table(("key", a.name, b.name), rows) if rows else "<p>Both were flown with the same.</p>"


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
    for key, (was, is_now) in configuration(a, b).items():
        console.print(Text(f"{key}: {was} | {is_now}"))
