"""Imported files as one of our logs: frames, targets and references on our channels, all else as signals."""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from analysis.imports.maps import QUANTITIES
from analysis.imports.recording import Table
from analysis.imports.signals import Imported
from analysis.reading import IMPORTED
from analysis.series import Sampled
from formation import topics
from formation.clock_pair import ClockPair
from formation.maths import frames
from formation.maths.arrays import Float
from formation.messages import AttitudeTarget, Event, LabFrame, Reference, Severity, SignalRows
from formation.topics import Topic
from wire.columns import Index
from wire.logs.mcap_write import LogWriter

NUMBERS_MOST = 2048
"""Numbers of a message, so that a chunk of a thousand messages stays small enough to be read."""
SOURCE = "autopilot"


@dataclass(frozen=True, slots=True, eq=False)
class Stream:
    """Messages of one topic: t_ns (N,), when each is logged, and how the k-th is made."""

    topic: Topic
    t_ns: Index
    make: Callable[[int], object]


def write(files: Sequence[Imported], path: Path) -> None:
    """Write the log of vehicles whose files share a clock; its time begins with the first stamp. OSError."""
    zero_s = min(each.recording.span_s[0] for each in files)
    streams = [stream for each in files for stream in signal_streams(each, zero_s)]
    streams += _pose_streams(files, zero_s)
    newest_s = max(each.recording.span_s[1] for each in files)
    unix_s = files[0].recording.unix_s
    begin_s = files[0].recording.path.stat().st_mtime - (newest_s - zero_s) if unix_s is None else unix_s + zero_s
    with LogWriter(path, _metadata(files), start=ClockPair(0, round(1e9 * begin_s)), threaded=False) as log:
        for topic, message, now_ns in in_order(streams):
            log.write(topic, message, now_ns)


def in_order(streams: Sequence[Stream]) -> Iterator[tuple[Topic, object, int]]:
    """(topic, message, t_ns) of all streams by their times."""
    t_ns = np.concatenate([stream.t_ns for stream in streams])
    which = np.repeat(np.arange(len(streams)), [len(stream.t_ns) for stream in streams])
    index = np.concatenate([np.arange(len(stream.t_ns)) for stream in streams])
    order = np.argsort(t_ns, kind="stable")
    for now_ns, stream, k in zip(t_ns[order].tolist(), which[order].tolist(), index[order].tolist(), strict=True):
        yield streams[stream].topic, streams[stream].make(k), now_ns


def _metadata(files: Sequence[Imported]) -> dict[str, str]:
    made_of = [
        {"file": each.recording.path.name, "kind": each.recording.kind, "map": each.title, "body": each.body,
         "sysid": number, "damage": each.recording.damage}
        for number, each in enumerate(files, 1)
    ]  # fmt: skip
    return {"scenario": files[0].recording.path.stem, IMPORTED: json.dumps(made_of)}


def signal_streams(of: Imported, zero_s: float, clock: Callable[[Float], Float] = lambda t_s: t_s) -> Iterator[Stream]:
    """Every quantity, every other column and every text of a file. clock: from the file's clock to the log's, s, which
    is zero at zero_s."""

    def ns(t_s: Float) -> Index:
        return np.rint(1e9 * (clock(t_s) - zero_s)).astype(np.int64)

    for name, sampled in of.quantities.items():
        quantity = QUANTITIES[name]
        names = (
            quantity.names
            if not quantity.any
            else tuple(f"{quantity.name}_{k}" for k in range(sampled.values.shape[1]))
        )
        rows = Table(sampled.t_s, dict(zip(names, sampled.values.T, strict=True)))
        yield _blocks(topics.SIGNAL, of.body, name, ns(sampled.t_s), rows)
    for name, rows in of.others.items():
        yield _blocks(topics.COLUMN, of.body, name or of.recording.path.stem, ns(rows.t_s), rows)
    first_s, last_s = of.recording.span_s
    texts = [(min(max(t_s, first_s), last_s), level, text) for t_s, level, text in of.recording.texts]
    events = [Event(Severity(min(max(level, 0), 7)), SOURCE, text, subject=of.body) for _, level, text in texts]
    yield Stream(topics.EVENT, ns(np.array([t_s for t_s, _, _ in texts], np.float64)), events.__getitem__)


def _blocks(topic: Topic, body: str, table: str, t_ns: Index, rows: Table) -> Stream:
    """Rows, so many a message."""
    count = max(NUMBERS_MOST // len(rows.columns), 1)
    starts = np.arange(0, len(t_ns), count)
    names = tuple(rows.columns)

    def make(k: int) -> SignalRows:
        part = slice(int(starts[k]), int(starts[k]) + count)
        since_s = (t_ns[part] - t_ns[part.start]) * 1e-9
        values = np.stack([np.asarray(column[part], np.float64) for column in rows.columns.values()], axis=1)
        return SignalRows(int(t_ns[part.start]), body, table, names, since_s, values.ravel())

    return Stream(topic, t_ns[starts], make)


def _pose_streams(files: Sequence[Imported], zero_s: float) -> Iterator[Stream]:
    """What analysis of our own flights reads: frames, targets and references of all vehicles, at the times of the first
    that has any; the others' are interpolated, the targets held."""
    bodies = tuple(each.body for each in files)

    def ns(t_s: Float) -> Index:
        return np.rint(1e9 * (t_s - zero_s)).astype(np.int64)

    def axis(*wanted: str) -> Float | None:
        have = (each.quantities for each in files if all(name in each.quantities for name in wanted))
        return next((of[wanted[0]].t_s for of in have), None)

    def gathered(name: str, width: int, at_s: Float, sample: Callable[[Sampled, Float], Float]) -> Float:
        """(T, n, w); NaN where a vehicle has none."""
        none = np.full((len(at_s), width), np.nan)
        return np.stack([sample(of.quantities[name], at_s) if name in of.quantities else none for of in files], axis=1)

    if (t_s := axis("position", "attitude")) is not None:
        pos = gathered("position", 3, t_s, Sampled.at)
        q = gathered("attitude", 4, t_s, partial(Sampled.at, attitude=True))
        seen = np.isfinite(np.concatenate([pos, q], axis=2)).all(axis=2)
        pos, q = np.where(seen[..., None], pos, 0.0), np.where(seen[..., None], q, frames.IDENTITY)
        some = np.flatnonzero(seen.any(axis=1))
        t_ns, pos, q, seen = ns(t_s[some]), pos[some], q[some], seen[some]
        yield Stream(topics.MOCAP, t_ns, lambda k: LabFrame(k, int(t_ns[k]), bodies, pos[k], q[k], seen[k]))
    n = len(files)
    none, flags = np.full(n, np.nan), np.zeros(n, np.bool_)
    if (t_s := axis("commanded_attitude")) is not None:
        targets = gathered("commanded_attitude", 4, t_s, Sampled.held)
        rates = gathered("commanded_rates", 3, t_s, Sampled.held)
        thrust = gathered("commanded_thrust", 1, t_s, Sampled.held)[..., 0]
        at_ns, limits = ns(t_s), np.zeros(n)
        yield Stream(
            topics.TARGET, at_ns,
            lambda k: AttitudeTarget(int(at_ns[k]), targets[k], rates[k], thrust[k], limits, flags),
        )  # fmt: skip
    if (t_s := axis("reference_position")) is not None:
        slots = gathered("reference_position", 3, t_s, Sampled.held)
        vel = gathered("reference_velocity", 3, t_s, Sampled.held)
        yaw = gathered("reference_heading", 1, t_s, Sampled.held)[..., 0]
        when_ns, origin, missing, still = ns(t_s), np.zeros((n, 3)), np.full((n, 3), np.nan), np.zeros(n)
        yield Stream(
            topics.REFERENCE, when_ns,
            lambda k: Reference(
                int(when_ns[k]), origin, origin, origin, still, still, still, slots[k], vel[k], missing, yaw[k], none,
                flags,
            ),
        )  # fmt: skip
