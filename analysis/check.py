"""What a log still holds, whole, truncated or damaged; and who asked for what in a flight, and what was rejected."""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from operator import itemgetter
from pathlib import Path
from typing import TypeVar

from rich.console import Console
from rich.table import Table
from rich.text import Text

from analysis.reading import read, scenario_of
from formation import topics
from formation.messages import Event, OperatorReply, OperatorRequest
from formation.topics import Topic
from wire.logs.mcap_read import LogColumns, holds_nothing, read_columns

M = TypeVar("M")

Need = Topic | str
NEEDS: tuple[tuple[str, tuple[Need, ...]], ...] = (
    ("error to the reference", (topics.MOCAP, topics.REFERENCE)),
    ("controller's inside", (topics.COMMAND,)),
    ("attitude against target, and its lag by identify", (topics.MOCAP, topics.TARGET)),
    ("thrust curve by identify", (topics.MOCAP, topics.TARGET, "commanded_thrust")),
    ("latency", (topics.TIMING,)),
    ("phases", (topics.PHASE,)),
    ("replay", (topics.MOCAP, topics.TICK)),
)
"""What the report, identify and replay can show, and the topics, and quantities of `analysis.imports`, each needs."""
RECORDED: tuple[tuple[str, tuple[Need, ...]], ...] = (
    ("gyros: join by the motion", ("rates",)),
    ("motor commands", ("motors",)),
    ("battery", ("battery_voltage",)),
    ("the autopilot's own estimate against the cameras", (topics.MOCAP, "estimated_position")),
    ("innovations", ("innovation_position",)),
)
"""The same of logs that were imported or joined alone."""


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
    log = read(path, {topics.SIGNAL: ("table",)})
    found = log.check
    span_ns = 0 if found.first_ns is None or found.last_ns is None else found.last_ns - found.first_ns
    has: set[Need] = {topic for topic in topics.ALL if found.entries.get(topic.name)}
    asked = NEEDS
    if topics.SIGNAL in has:
        has |= set(log.topics[topics.SIGNAL].fields["table"].values.tolist())
        asked += RECORDED
    elif topics.TARGET in has:  # a ground of ours sends no attitude without a thrust
        has.add("commanded_thrust")
    usable = tuple(name for name, needs in asked if has.issuperset(needs))
    return Check(
        mcap=str(path),
        complete=found.complete,
        damage=found.damage,
        scenario=scenario_of(log.metadata),
        duration_s=1e-9 * span_ns,
        entries={topic.name: found.entries[topic.name] for topic in topics.ALL if topic.name in found.entries},
        usable=usable,
        lost=tuple(name for name, _ in asked if name not in usable),
    )


def print_check(check: Check, console: Console) -> None:
    """A log's condition, its channels, what of it can still be shown."""
    if check.complete:
        console.print("The log is complete.", style="green", highlight=False)
    else:
        console.print(f"The log is damaged: {check.damage}.", style="red", highlight=False, markup=False)
    console.print(
        f"It holds {check.duration_s:.2f} s of {check.scenario or 'a flight'}:", highlight=False, markup=False
    )
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim")
    table.add_column(justify="right")
    for topic, entries in check.entries.items():
        table.add_row(Text(topic), str(entries))
    console.print(table)
    if check.usable:
        console.print(f"To be had from it: {', '.join(check.usable)}.", highlight=False, markup=False)
    if check.lost:
        console.print(f"Not to be had from it: {', '.join(check.lost)}.", highlight=False, markup=False)


OPERATIONS = "key_operations"
"""The run's metadata: what was done to the lab's keys before, a line each."""
NOBODY = "the ground itself"
AUDITED = (topics.REQUEST, topics.REPLY, topics.REJECTED)


@dataclass(frozen=True, slots=True)
class Audited:
    """One row. t_s: from the log's first record; None before the run. who: as the ground knew it."""

    t_s: float | None
    who: str
    what: str
    result: str = ""


def audit(path: Path) -> tuple[Audited, ...]:
    """Key operations before the run, then requests with their answers and rejected inputs, in order of the log.

    Raises as `check`.
    """
    log = read_columns(path, {topic: [field.name for field in fields(topic.type)] for topic in AUDITED})
    if not log.held:
        raise holds_nothing(path, log.check.damage)
    lines = [(*line.split(" ", 2), "", "")[:3] for line in log.metadata.get(OPERATIONS, "").splitlines()]
    before = tuple(Audited(None, who, f"{what} ({date})") for date, who, what in lines)
    answers = {reply.id: reply for _, _, reply in _messages(log, topics.REPLY, OperatorReply)}
    rows = [
        (number, Audited(t_s, request.source or NOBODY, _what(request), _result(answers.get(request.id))))
        for number, t_s, request in _messages(log, topics.REQUEST, OperatorRequest)
    ]
    rows += [(number, Audited(t_s, e.source, e.text)) for number, t_s, e in _messages(log, topics.REJECTED, Event)]
    return (*before, *(row for _, row in sorted(rows, key=itemgetter(0))))


def _messages(log: LogColumns, topic: Topic, kind: type[M]) -> Iterator[tuple[int, float, M]]:
    """(place in the log, t_s, message) of each of a topic."""
    found = log.topics.get(topic)
    if found is not None:
        t_s = (found.t_ns - log.begin_ns) * 1e-9
        yield from zip(found.number.tolist(), t_s.tolist(), found.messages(kind), strict=True)


def _what(request: OperatorRequest) -> str:
    return f"{request.verb.command_name} {request.argument}".strip()


def _result(reply: OperatorReply | None) -> str:
    if reply is None:
        return "no answer"
    return "done" if reply.accepted else f"refused: {reply.text}"
