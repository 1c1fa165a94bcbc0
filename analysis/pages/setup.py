"""What a flight was flown with, as the log says it: date, version, machine, lab, gains and profiles. HTML pieces."""

import json
from collections.abc import Iterator, Mapping
from html import escape

from analysis.load import Flight
from analysis.page import cell, row, table
from wire.text import parse_json

FACTS = (
    ("date", "date"), ("versions", "version"), ("machine", "machine"), ("lab_file", "lab file"),
    ("control_law", "control law"), ("scenario", "scenario"), ("seed", "seed"), ("link", "link"),
    ("speed", "speed of the clock"), ("security", "protection of the links"),
)  # fmt: skip


def setup(flight: Flight) -> str:
    """Facts, gains by vehicle kind, profiles, and the whole configuration folded away."""
    metadata = flight.run.metadata
    rows = [row(cell(words), cell(metadata[key])) for key, words in FACTS if metadata.get(key)]
    if not rows and flight.run.lab is None:
        return '<p class="missing">Not shown: the log says nothing of what it was flown with.</p>'
    parts = [table(("", ""), rows)] if rows else []
    for key, words in (("gains", "Gains and observers"), ("profiles", "Vehicle profiles")):
        parts += [_values(f"{words}: {name}", values) for name, values in _objects(metadata.get(key, "")).items()]
    if flight.run.lab is not None:
        text = json.dumps(flight.run.lab.model_dump(mode="json"), indent=2)
        parts.append(f"<details><summary>The lab's whole configuration</summary><pre>{escape(text)}</pre></details>")
    return "".join(parts)


def _objects(text: str) -> Mapping[str, Mapping[str, object]]:
    """The object of objects in a log's metadata; none where it is anything else."""
    try:
        found = parse_json(text)
    except ValueError:
        return {}
    return (
        {str(name): values for name, values in found.items() if isinstance(values, dict)}
        if isinstance(found, dict)
        else {}
    )


def _values(words: str, values: Mapping[str, object]) -> str:
    """A folded table of keys and values."""
    rows = [row(f"<td><code>{escape(key)}</code></td>", cell(value)) for key, value in _flat(values)]
    return f"<details><summary>{escape(words)}</summary>{table(('key', 'value'), rows)}</details>"


def _flat(values: Mapping[str, object], prefix: str = "") -> Iterator[tuple[str, str]]:
    for key, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, f"{value:.6g}" if isinstance(value, float) else str(value)
