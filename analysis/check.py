"""What a log still holds, whole, truncated or damaged; and who asked for what in a flight, and what was rejected."""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from analysis.load import load_checked
from formation import topics
from formation.messages import Event, OperatorReply, OperatorRequest
from wire.logs.mcap_read import Log, holds_nothing

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


OPERATIONS = "key_operations"
"""The run's metadata: what was done to the lab's keys before, a line each."""
NOBODY = "the ground itself"


@dataclass(frozen=True, slots=True)
class Audited:
    """One row. t_s: from the log's first record; None before the run. who: as the ground knew it."""

    t_s: float | None
    who: str
    what: str
    result: str = ""


def audit(log: Log) -> tuple[Audited, ...]:
    """Key operations before the run, then requests with their answers and rejected inputs, in order of time."""
    before = tuple(_operation(line) for line in log.metadata.get(OPERATIONS, "").splitlines())
    return (*before, *_records(log))


def _records(log: Log) -> Iterator[Audited]:
    start_ns: int | None = None
    answers = {e.message.id: e.message for e in log.entries if isinstance(e.message, OperatorReply)}
    for entry in log.entries:
        start_ns = entry.t_ns if start_ns is None else start_ns
        t_s = (entry.t_ns - start_ns) * 1e-9
        message = entry.message
        if isinstance(message, OperatorRequest):
            what = f"{message.verb.command_name} {message.argument}".strip()
            yield Audited(t_s, message.source or NOBODY, what, _result(answers.get(message.id)))
        elif entry.topic == topics.REJECTED and isinstance(message, Event):
            yield Audited(t_s, message.source, message.text)
    if start_ns is None:
        raise holds_nothing(log.path)


def _operation(line: str) -> Audited:
    """A line of the folder's own record: date, who, what."""
    date, who, what = (*line.split(" ", 2), "", "")[:3]
    return Audited(None, who, f"{what} ({date})")


def _result(reply: OperatorReply | None) -> str:
    if reply is None:
        return "no answer"
    return "done" if reply.accepted else f"refused: {reply.text}"
