"""The columns of a log whose stamps fit the log's own time, so that one stamp of another year makes no endless grid."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from formation import topics
from formation.maths.arrays import Bool, Float
from formation.topics import Topic
from wire.columns import Index
from wire.logs.mcap_read import LogColumns, TopicColumns, holds_nothing, read_columns
from wire.text import plain

LONGEST_WORDS = 200
STRAY_NS = 600_000_000_000
IMPORTED = "imported"
"""Key of a run's metadata: which files of others a log was made of, JSON."""
STAMPS: Mapping[Topic, str] = MappingProxyType({
    topics.MOCAP: "t_capture_ns", topics.STATE: "t_ns", topics.REFERENCE: "t_ns", topics.COMMAND: "t_ns",
    topics.TARGET: "t_ns", topics.TRUTH: "t_ns",
})  # fmt: skip
"""The field of a message that is the time it speaks of; of other topics that is when a message was logged."""


def read(path: Path, names: Mapping[Topic, tuple[str, ...]]) -> LogColumns:
    """The columns that are named, and the stamps, of a log, whole or damaged; what was left out is in its check.

    Raises as `read_columns`, and LogError where the log holds no message of a flight.
    """
    stamps = {topic: (STAMPS[topic],) if topic in STAMPS else () for topic in topics.ALL}
    log = read_columns(path, {topic: names.get(topic, ()) + stamps[topic] for topic in topics.ALL})
    if not log.topics:
        raise holds_nothing(path, log.check.damage)
    fits = {topic: _fits(topic, found, log.begin_ns) for topic, found in log.topics.items()}
    strays = sum(int((~each).sum()) for each in fits.values())
    if not strays:
        return log
    text = f"messages with stamps outside the log's own time, left out: {strays}"
    check = replace(log.check, complete=False, damage="; ".join(filter(None, (log.check.damage, text))))
    fitting = {topic: found.where(fits[topic]) for topic, found in log.topics.items()}
    return replace(log, topics=fitting, check=check)


def _fits(topic: Topic, found: TopicColumns, begin_ns: int) -> Bool:
    """Whose times fit: time runs ahead by at most a second a record, as a ground records at least ten a second."""
    low_ns, high_ns = begin_ns - STRAY_NS, begin_ns + STRAY_NS + found.number * 1_000_000_000
    fits: Bool = np.ones(len(found.t_ns), np.bool_)
    for times_ns in (found.t_ns, stamps_ns(topic, found)):
        fits &= (low_ns <= times_ns) & (times_ns <= high_ns)
    return fits


def stamps_ns(topic: Topic, found: TopicColumns) -> Index:
    """The times that messages speak of, else when they were logged."""
    return found.fields[STAMPS[topic]].values if topic in STAMPS else found.t_ns


def imported_sysids(metadata: Mapping[str, str]) -> dict[str, int]:
    """The system id of each vehicle of a log that was imported, by its name; none where it was not."""
    try:
        files = json.loads(metadata.get(IMPORTED, "[]"))
        return {plain(str(each["body"]), LONGEST_WORDS): int(each["sysid"]) for each in files}
    except (ValueError, TypeError, KeyError, RecursionError):
        return {}


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """One table of signals: t_ns (T,); values (T, w); names (w,)."""

    t_ns: Index
    values: Float
    names: tuple[str, ...]


def signal_rows(found: TopicColumns) -> dict[tuple[str, str], Rows]:
    """The tables in messages of `SignalRows`, by body and name; rows that do not fit their names are left out."""
    if not len(found.t_ns):
        return {}
    since_s, counts = found.fields["since_s"].flat()
    numbers, sizes = found.fields["values"].flat()
    starts, firsts = np.cumsum(counts) - counts, np.cumsum(sizes) - sizes
    parts: dict[tuple[str, str], list[Rows]] = {}
    texts = (found.fields[name].values.tolist() for name in ("body", "table", "names"))
    spans = zip(found.t_ns.tolist(), starts.tolist(), counts.tolist(), firsts.tolist(), sizes.tolist(), strict=True)
    for body, table, names, (t_ns, start, count, first, size) in zip(*texts, spans, strict=True):
        same = parts.setdefault((body, table), [])
        if size != count * len(names) or (same and same[0].names != names):
            continue
        at_ns = t_ns + np.rint(1e9 * since_s[start : start + count]).astype(np.int64)
        same.append(Rows(at_ns, numbers[first : first + size].reshape(count, len(names)), names))
    return {
        name: Rows(np.concatenate([p.t_ns for p in same]), np.concatenate([p.values for p in same]), same[0].names)
        for name, same in parts.items()
        if same
    }


def scenario_of(metadata: Mapping[str, str]) -> str:
    """The scenario's name; empty where there is none."""
    return plain(metadata.get("scenario", ""), LONGEST_WORDS)
