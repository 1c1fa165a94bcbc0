"""A flight log as frozen columns: one series a topic, poses ordered as the configuration, phases on a timeline.

Reads; judges nothing. Numbers are `analysis.metrics`, pictures `analysis.plots`.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from analysis.reading import LONGEST_WORDS, imported_sysids, read, scenario_of, signal_rows, stamps_ns
from analysis.series import Columns, Index, Sampled, Series
from formation import topics
from formation.config import LabConfig
from formation.maths.arrays import Bool, Float
from formation.messages import Event, LawFailure, OperatorReply, OperatorRequest, Phase, PhaseChange
from formation.topics import Topic
from wire.columns import Stacked, stacked
from wire.logs.mcap_read import LogCheck, TopicColumns, lab_of
from wire.mavlink.frames import Frames, frames_in
from wire.text import plain
from wire.transport.frame_check import MOST_BODIES, are_poses

M = TypeVar("M")


class Record(Protocol):
    """One record of a log: `wire.logs.mcap_read.Entry`, or anything like it."""

    @property
    def topic(self) -> Topic:
        """The channel."""

    @property
    def t_ns(self) -> int:
        """When it was logged."""

    @property
    def message(self) -> object:
        """What was logged."""


LONGEST_TEXT = 1 << 20
READ: Mapping[Topic, tuple[str, ...]] = MappingProxyType({
    topics.MOCAP: ("t_receive_ns", "bodies", "pos_lab_m", "q_lab_from_flu", "seen", "rejected"),
    topics.REFERENCE: ("origin_lab_m", "heading_rad", "slot_lead_m", "slot_vel_lead_m_s", "in_formation"),
    topics.COMMAND: ("s_lead_m_s", "dist_lab_m_s2", "acc_lab_m_s2"),
    topics.TARGET: ("q_lab_from_flu", "rate_flu_rad_s", "thrust_norm", "saturation"),
    topics.TIMING: ("latency_s", "late"),
    topics.TRUTH: ("sysid", "dist_lab_m_s2", "on_ground"),
    topics.LINK_UP: ("sysid", "data", "superseded"),
    topics.LINK_DOWN: ("sysid", "data", "superseded"),
    topics.SIGNAL: ("body", "table", "names", "since_s", "values"),
})  # fmt: skip
"""The columns that analysis reads of a file; flights in memory have them all."""
RARE = (topics.EVENT, topics.LAW_FAILURE, topics.REQUEST, topics.REPLY, topics.PHASE)
"""The few messages that are read one by one."""
NOTHING = TopicColumns(np.zeros(0, np.int64), np.zeros(0, np.int64), MappingProxyType({}))


@dataclass(frozen=True, slots=True)
class Vehicle:
    """One vehicle as the log knows it; `column` is its place in the commanded arrays, None where only observed."""

    body: str
    sysid: int | None
    column: int | None


@dataclass(frozen=True, slots=True)
class Run:
    """What the log says of itself: its metadata record, read."""

    scenario: str
    seed: int | None
    link: str
    lockstep: bool
    lab: LabConfig | None
    versions: str
    metadata: Mapping[str, str]
    """All of it, as plain text."""


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Every mocap frame in lab and flu, n vehicles in the configuration's order (leader first).

    t_s, mocap_s, received_s (T,): capture, receipt by the mocap process (negative if unknown), receipt by the ground;
    pos_lab_m (T, n, 3); q_lab_from_flu (T, n, 4); seen (T, n); rejected (T, n): formation.messages.Rejection.
    """

    t_s: Float
    mocap_s: Float
    received_s: Float
    pos_lab_m: Float
    q_lab_from_flu: Float
    seen: Bool
    rejected: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass(frozen=True, slots=True)
class PhaseSpan:
    """The swarm was in `phase` from start_s to end_s, entered because of `cause`."""

    phase: Phase
    start_s: float
    end_s: float
    cause: str


@dataclass(frozen=True, slots=True, eq=False)
class Traffic:
    """One direction of all links. t_s, sysid, superseded (D,): of each datagram, as in `Datagram`; frames: in them."""

    t_s: Float
    sysid: Index
    superseded: Index
    frames: Frames

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """One log, read: everything analysis needs, times in seconds since the log's first record.

    closed: whether its writer ended it, as one that is killed does not.
    """

    run: Run
    vehicles: tuple[Vehicle, ...]
    t0_ns: int
    duration_s: float
    poses: Poses
    state: Columns
    reference: Columns
    command: Columns
    target: Columns
    timing: Columns
    events: Series[Event]
    law_failures: Series[LawFailure]
    requests: Series[OperatorRequest]
    replies: Series[OperatorReply]
    up: Traffic
    down: Traffic
    truth: Mapping[int, Columns]
    phases: tuple[PhaseSpan, ...]
    signals: Mapping[tuple[str, str], Sampled]
    """By body and quantity: of logs that were imported or joined."""
    closed: bool = True

    @property
    def leader(self) -> Vehicle:
        """The body the formation is held on."""
        return self.vehicles[0]

    @property
    def followers(self) -> tuple[Vehicle, ...]:
        """The commanded rest."""
        return self.vehicles[1:]

    def spans(self, *phases: Phase) -> tuple[PhaseSpan, ...]:
        """The stretches of the flight in any of the phases."""
        return tuple(span for span in self.phases if span.phase in phases)


def load(path: Path) -> Flight:
    """Read an MCAP log, whole or damaged. Errors: `wire.logs.mcap_read`'s own."""
    return load_checked(path)[0]


def load_checked(path: Path) -> tuple[Flight, LogCheck]:
    """Read an MCAP log, and in the same pass what it holds and what is wrong with it. Raises as `load`, and LogError
    where it holds no message of a flight."""
    log = read(path, {**READ, **{topic: tuple(field.name for field in fields(topic.type)) for topic in RARE}})
    return replace(_flight(log.metadata, log.begin_ns, log.topics), closed=log.check.closed), log.check


def from_records(metadata: Mapping[str, str], records: Iterable[Record]) -> Flight:
    """Build the flight from a log's metadata and its records in file order; any topic may be missing, and a record of
    another type than its topic's is left out."""
    begin_ns: int | None = None
    found: defaultdict[Topic, list[tuple[int, int, object]]] = defaultdict(list)
    for number, record in enumerate(records):
        begin_ns = record.t_ns if begin_ns is None else begin_ns
        if isinstance(record.message, record.topic.type):
            found[record.topic].append((record.t_ns, number, record.message))
    columns = {}
    for topic, rows in found.items():
        t_ns, numbers, messages = zip(*rows, strict=True)
        columns[topic] = TopicColumns(np.array(t_ns), np.array(numbers), Stacked(messages))
    return _flight(metadata, begin_ns or 0, columns)


def _flight(metadata: Mapping[str, str], begin_ns: int, found: Mapping[Topic, TopicColumns]) -> Flight:
    last_ns = max((int(of_one.t_ns.max()) for of_one in found.values() if len(of_one.t_ns)), default=begin_ns)
    duration_s = (last_ns - begin_ns) * 1e-9
    run = _run(metadata)

    def columns(topic: Topic) -> Columns:
        return _columns(topic, found.get(topic, NOTHING), begin_ns)

    def rare(topic: Topic, kind: type[M]) -> Series[M]:
        return _series(found.get(topic, NOTHING), begin_ns, kind)

    mocap, reference = columns(topics.MOCAP), columns(topics.REFERENCE)
    vehicles = _vehicles(run.lab, imported_sysids(metadata), mocap, reference)
    return Flight(
        run=run,
        vehicles=vehicles,
        t0_ns=begin_ns,
        duration_s=duration_s,
        poses=_poses(found.get(topics.MOCAP, NOTHING), tuple(vehicle.body for vehicle in vehicles), begin_ns),
        state=columns(topics.STATE),
        reference=reference,
        command=columns(topics.COMMAND),
        target=columns(topics.TARGET),
        timing=columns(topics.TIMING),
        events=rare(topics.EVENT, Event),
        law_failures=rare(topics.LAW_FAILURE, LawFailure),
        requests=rare(topics.REQUEST, OperatorRequest),
        replies=rare(topics.REPLY, OperatorReply),
        up=traffic(topics.LINK_UP, found.get(topics.LINK_UP, NOTHING), begin_ns),
        down=traffic(topics.LINK_DOWN, found.get(topics.LINK_DOWN, NOTHING), begin_ns),
        truth=_truth(columns(topics.TRUTH)),
        phases=_spans(rare(topics.PHASE, PhaseChange), duration_s),
        signals={
            name: Sampled(_seconds(rows.t_ns - begin_ns), rows.values)
            for name, rows in signal_rows(found.get(topics.SIGNAL, NOTHING)).items()
        },
    )


def _columns(topic: Topic, found: TopicColumns, begin_ns: int) -> Columns:
    if not len(found.t_ns):
        return Columns(np.zeros(0), {}, np.zeros(0, np.int64))
    times_ns = stamps_ns(topic, found)
    order = np.argsort(times_ns, kind="stable")
    return Columns(_seconds(times_ns[order] - begin_ns), found.fields, order)


def _series(found: TopicColumns, begin_ns: int, kind: type[M]) -> Series[M]:
    order = np.argsort(found.t_ns, kind="stable")
    messages = found.messages(kind)
    return Series(_seconds(found.t_ns[order] - begin_ns), tuple(messages[k] for k in order.tolist()))


def _seconds(t_ns: Index) -> Float:
    return np.multiply(t_ns, 1e-9, dtype=np.float64)


def traffic(topic: Topic, found: TopicColumns, begin_ns: int) -> Traffic:
    """The datagrams of one direction. begin_ns: when the log begins."""
    datagrams = _columns(topic, found, begin_ns)
    order = datagrams.order.tolist()
    data = datagrams.fields["data"] if len(datagrams) else stacked([b""])
    if order != sorted(order):
        data = stacked([data.pieces()[k] for k in order])
    return Traffic(datagrams.t_s, datagrams["sysid"], datagrams["superseded"], frames_in(*data.flat()))


def _run(metadata: Mapping[str, str]) -> Run:
    """Metadata as text -> Run; what is missing or unreadable is None or empty."""
    seed = metadata.get("seed", "")
    link = plain(metadata.get("link", ""), LONGEST_WORDS)
    return Run(
        scenario=scenario_of(metadata),
        seed=int(seed) if seed.lstrip("-").isdigit() else None,
        link=link,
        lockstep=metadata.get("host", "") == "lockstep" or link == "memory",
        lab=lab_of(metadata),
        versions=plain(metadata.get("versions", ""), LONGEST_WORDS),
        metadata={key: plain(text, LONGEST_TEXT) for key, text in metadata.items()},
    )


def _vehicles(
    lab: LabConfig | None, sysids: Mapping[str, int], mocap: Columns, reference: Columns
) -> tuple[Vehicle, ...]:
    """The configured vehicles; without a configuration, the mocap's bodies with the last m commanded."""
    if lab is not None:
        columns = {index: column for column, index in enumerate(lab.commanded)}
        return tuple(Vehicle(v.body, v.sysid, columns.get(i)) for i, v in enumerate(lab.vehicles))
    bodies = mocap["bodies"][0] if len(mocap) else ()
    commanded = reference["in_formation"].shape[1] if len(reference) else len(bodies)
    observed = len(bodies) - min(commanded, len(bodies))
    return tuple(
        Vehicle(body, sysids.get(body), i - observed if i >= observed else None) for i, body in enumerate(bodies)
    )


_OF_BODIES = ("pos_lab_m", "q_lab_from_flu", "seen", "rejected")


def _poses(found: TopicColumns, bodies: tuple[str, ...], begin_ns: int) -> Poses:
    """The sound frames of exactly these bodies, in this order; a log of ours has no others."""
    if len(found.t_ns):
        named = [len(bodies) <= MOST_BODIES and each == bodies for each in found.fields["bodies"].values.tolist()]
        alike = (found.fields[name].of_length(len(bodies)) for name in _OF_BODIES)
        found = found.where(np.logical_and.reduce([np.array(named, np.bool_), *alike]))
    if len(found.t_ns):
        found = found.where(are_poses(found.fields["pos_lab_m"].stack(), found.fields["q_lab_from_flu"].stack()))
    mocap = _columns(topics.MOCAP, found, begin_ns)
    shape = (len(mocap), len(bodies))
    return Poses(
        mocap.t_s,
        _seconds(mocap["t_receive_ns"] - begin_ns),
        _seconds(found.t_ns[mocap.order] - begin_ns),
        mocap["pos_lab_m"].reshape(*shape, 3),
        mocap["q_lab_from_flu"].reshape(*shape, 4),
        mocap["seen"].astype(np.bool_).reshape(shape),
        mocap["rejected"].astype(np.uint8).reshape(shape),
    )


def _truth(truth: Columns) -> Mapping[int, Columns]:
    """Truth by system id."""
    sysids = truth["sysid"]
    return {int(sysid): truth.where(sysids == sysid) for sysid in np.unique(sysids)}


def _spans(changes: Series[PhaseChange], end_s: float) -> tuple[PhaseSpan, ...]:
    """Phase changes -> stretches; the last one runs to the end of the log."""
    if not len(changes):
        return ()
    ends = [*changes.t_s[1:].tolist(), max(end_s, float(changes.t_s[-1]))]
    return tuple(
        PhaseSpan(change.phase, float(start), float(end), change.cause)
        for change, start, end in zip(changes.messages, changes.t_s, ends, strict=True)
    )
