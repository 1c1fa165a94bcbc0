"""A flight log as frozen columns: one series a topic, poses ordered as the configuration, phases on a timeline.

Reads; judges nothing. Numbers are `analysis.metrics`, pictures `analysis.plots`.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from analysis.series import Series, series
from formation import topics
from formation.config import LabConfig
from formation.maths.arrays import Bool, Float
from formation.messages import (
    AttitudeTarget,
    Command,
    Datagram,
    Event,
    LabFrame,
    LawFailure,
    LoopTiming,
    OperatorReply,
    OperatorRequest,
    Phase,
    PhaseChange,
    Reference,
    SwarmState,
    Truth,
)
from formation.topics import Topic
from wire.logs.mcap_read import LogCheck, Reading, holds_nothing, lab_of, read_log
from wire.text import plain
from wire.transport.frame_check import pose_fault

M = TypeVar("M")
Stamped = list[tuple[float, float, object]]


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


LONGEST_WORDS, LONGEST_TEXT = 200, 1 << 20
STRAY_NS = 600_000_000_000


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
class Flight:
    """One log, read: everything analysis needs, times in seconds since the log's first record.

    closed: whether its writer ended it, as one that is killed does not.
    """

    run: Run
    vehicles: tuple[Vehicle, ...]
    t0_ns: int
    duration_s: float
    poses: Poses
    state: Series[SwarmState]
    reference: Series[Reference]
    command: Series[Command]
    target: Series[AttitudeTarget]
    timing: Series[LoopTiming]
    events: Series[Event]
    law_failures: Series[LawFailure]
    requests: Series[OperatorRequest]
    replies: Series[OperatorReply]
    up: Series[Datagram]
    down: Series[Datagram]
    truth: Mapping[int, Series[Truth]]
    phases: tuple[PhaseSpan, ...]
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
    reading = Reading(path)
    records = _InTime(reading)
    flight = from_records(read_log(path).metadata, records)
    found = reading.check()
    if records.left_out:
        text = f"messages with stamps outside the log's own time, left out: {records.left_out}"
        found = replace(found, complete=False, damage="; ".join(filter(None, (found.damage, text))))
    if not found.entries:
        raise holds_nothing(path, found.damage)
    return replace(flight, closed=found.closed), found


class _InTime:
    """The records whose stamps fit the log's own time, so that one stamp of another year makes no endless grid.

    Time runs ahead by at most a second a record: a ground records at least ten a second.
    """

    def __init__(self, records: Iterable[Record]) -> None:
        self.left_out = 0
        self._records = records

    def __iter__(self) -> Iterator[Record]:
        first_ns: int | None = None
        for number, record in enumerate(self._records):
            first_ns = record.t_ns if first_ns is None else first_ns
            low_ns, high_ns = first_ns - STRAY_NS, first_ns + STRAY_NS + number * 1_000_000_000
            if low_ns <= record.t_ns <= high_ns and low_ns <= _stamp_ns(record) <= high_ns:
                yield record
            else:
                self.left_out += 1


def from_records(metadata: Mapping[str, str], records: Iterable[Record]) -> Flight:
    """Build the flight from a log's metadata and its records in file order; any topic may be missing."""
    t0_ns: int | None = None
    last_ns = 0
    found: defaultdict[str, Stamped] = defaultdict(list)
    for record in records:
        t0_ns = record.t_ns if t0_ns is None else t0_ns
        last_ns = max(last_ns, record.t_ns)
        stamp_s, logged_s = (_stamp_ns(record) - t0_ns) * 1e-9, (record.t_ns - t0_ns) * 1e-9
        found[record.topic.name].append((stamp_s, logged_s, record.message))
    t0_ns = t0_ns or 0
    duration_s = max(last_ns - t0_ns, 0) * 1e-9
    run = _run(metadata)
    mocap = _of(found, topics.MOCAP, LabFrame)
    reference = _of(found, topics.REFERENCE, Reference)
    vehicles = _vehicles(run.lab, mocap, reference)
    return Flight(
        run=run,
        vehicles=vehicles,
        t0_ns=t0_ns,
        duration_s=duration_s,
        poses=_poses(mocap, tuple(vehicle.body for vehicle in vehicles), t0_ns),
        state=_of(found, topics.STATE, SwarmState),
        reference=reference,
        command=_of(found, topics.COMMAND, Command),
        target=_of(found, topics.TARGET, AttitudeTarget),
        timing=_of(found, topics.TIMING, LoopTiming),
        events=_of(found, topics.EVENT, Event),
        law_failures=_of(found, topics.LAW_FAILURE, LawFailure),
        requests=_of(found, topics.REQUEST, OperatorRequest),
        replies=_of(found, topics.REPLY, OperatorReply),
        up=_of(found, topics.LINK_UP, Datagram),
        down=_of(found, topics.LINK_DOWN, Datagram),
        truth=_truth(_of(found, topics.TRUTH, Truth)),
        phases=_spans(_of(found, topics.PHASE, PhaseChange), duration_s),
    )


def _stamp_ns(record: Record) -> int:
    """The time a message speaks of, else the time it was logged."""
    message = record.message
    if isinstance(message, LabFrame):
        return message.t_capture_ns
    if isinstance(message, SwarmState | Reference | Command | AttitudeTarget | Truth):
        return message.t_ns
    return record.t_ns


def _of(found: Mapping[str, Stamped], topic: Topic, kind: type[M]) -> Series[M]:
    """The series of one topic; a record of another type than the topic's is left out."""
    return series([(t, at, message) for t, at, message in found.get(topic.name, []) if isinstance(message, kind)])


def _run(metadata: Mapping[str, str]) -> Run:
    """Metadata as text -> Run; what is missing or unreadable is None or empty."""
    seed = metadata.get("seed", "")
    link = plain(metadata.get("link", ""), LONGEST_WORDS)
    return Run(
        scenario=plain(metadata.get("scenario", ""), LONGEST_WORDS),
        seed=int(seed) if seed.lstrip("-").isdigit() else None,
        link=link,
        lockstep=metadata.get("host", "") == "lockstep" or link == "memory",
        lab=lab_of(metadata),
        versions=plain(metadata.get("versions", ""), LONGEST_WORDS),
        metadata={key: plain(text, LONGEST_TEXT) for key, text in metadata.items()},
    )


def _vehicles(lab: LabConfig | None, mocap: Series[LabFrame], reference: Series[Reference]) -> tuple[Vehicle, ...]:
    """The configured vehicles; without a configuration, the mocap's bodies with the last m commanded."""
    if lab is not None:
        columns = {index: column for column, index in enumerate(lab.commanded)}
        return tuple(Vehicle(v.body, v.sysid, columns.get(i)) for i, v in enumerate(lab.vehicles))
    bodies = mocap.messages[0].bodies if mocap.messages else ()
    commanded = len(reference.messages[0].in_formation) if reference.messages else len(bodies)
    observed = len(bodies) - min(commanded, len(bodies))
    return tuple(Vehicle(body, None, i - observed if i >= observed else None) for i, body in enumerate(bodies))


def _poses(mocap: Series[LabFrame], bodies: tuple[str, ...], t0_ns: int) -> Poses:
    """The sound frames of exactly these bodies, in this order; a log of ours has no others."""
    sound = [frame.bodies == bodies and pose_fault(frame) is None for frame in mocap.messages]
    mocap = mocap.where(np.array(sound, dtype=np.bool_))
    shape = (len(mocap), len(bodies))
    return Poses(
        mocap.t_s,
        mocap.column(lambda frame: (frame.t_receive_ns - t0_ns) * 1e-9),
        mocap.logged_s,
        np.array([frame.pos_lab_m for frame in mocap.messages]).reshape(*shape, 3),
        np.array([frame.q_lab_from_flu for frame in mocap.messages]).reshape(*shape, 4),
        np.array([frame.seen for frame in mocap.messages], dtype=np.bool_).reshape(shape),
        np.array([frame.rejected for frame in mocap.messages], dtype=np.uint8).reshape(shape),
    )


def _truth(truth: Series[Truth]) -> Mapping[int, Series[Truth]]:
    """Truth by system id."""
    sysids = truth.column(lambda t: t.sysid)
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
