"""What a log still holds: whole, truncated or damaged. Words and JSON for `gcs-log check`."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from analysis.load import load_checked
from formation import topics

NEEDS = (
    ("formation error", (topics.MOCAP, topics.REFERENCE)),
    ("controller's inside", (topics.COMMAND,)),
    ("attitude against target", (topics.MOCAP, topics.TARGET)),
    ("latency", (topics.TIMING,)),
    ("phases", (topics.PHASE,)),
    ("replay", (topics.MOCAP, topics.TICK)),
)
"""What the report and replay can show, and the topics each needs."""


@dataclass(frozen=True, slots=True)
class Check:
    """A log's condition: entries per topic, the time they span, what is wrong, what can still be shown of it."""

    mcap: str
    complete: bool
    damage: str
    scenario: str
    duration_s: float
    entries: dict[str, int]
    usable: tuple[str, ...]
    lost: tuple[str, ...]

    def to_json(self) -> str:
        """Indented JSON of every field."""
        return json.dumps(asdict(self), indent=2, allow_nan=False)


def check(path: Path) -> Check:
    """Read the whole log and say what it holds. Raises OSError, and wire.logs.mcap_read.LogError where it is no log."""
    flight, found = load_checked(path)
    span_ns = 0 if found.first_ns is None or found.last_ns is None else found.last_ns - found.first_ns
    usable = tuple(name for name, needs in NEEDS if all(found.entries.get(topic.name) for topic in needs))
    return Check(
        mcap=str(path),
        complete=found.complete,
        damage=found.damage,
        scenario=flight.run.scenario,
        duration_s=1e-9 * span_ns,
        entries={topic.name: found.entries[topic.name] for topic in topics.ALL if topic.name in found.entries},
        usable=usable,
        lost=tuple(name for name, _ in NEEDS if name not in usable),
    )
