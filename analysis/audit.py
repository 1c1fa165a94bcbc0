"""Who asked for what in a flight, and what was rejected from outside: the log's own records, in order of time."""

from collections.abc import Iterator
from dataclasses import dataclass

from formation import topics
from formation.messages import Event, OperatorReply, OperatorRequest
from wire.logs.mcap_read import Log, holds_nothing

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
