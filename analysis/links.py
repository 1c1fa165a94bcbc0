"""The MAVLink traffic of a log, decoded: packets, age of telemetry when it was read, what each drone said of itself.

Ages are by the drone's own clock. Battery, link and mode are columns with ten rows a second, out of its datagrams.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.load import Flight
from analysis.series import Series
from formation.maths.arrays import Float
from formation.messages import Datagram
from wire.clock_offset import ClockOffset
from wire.link_messages import (
    DRONE_COMPONENT,
    GROUND,
    Address,
    AttitudeQuaternion,
    LinkMessage,
    LocalPosition,
    MessageId,
    TimeSync,
)
from wire.logs.views import DroneLink, LinkView
from wire.mavlink.codec import Codec

TimedMessage = tuple[float, int, LinkMessage]


def from_drones(flight: Flight, reads: frozenset[int] | None = None) -> Iterator[TimedMessage]:
    """(t_s, sysid of the link, message) of every packet the ground received, in log order.

    reads: the ids of the messages that are decoded, all others are Unknown; None: every message.
    """
    return _packets(flight.up, lambda _: GROUND, reads)


def from_ground(flight: Flight, reads: frozenset[int] | None = None) -> Iterator[TimedMessage]:
    """(t_s, sysid of the link, message) of every packet the ground sent, in log order; reads: as in `from_drones`."""
    return _packets(flight.down, lambda sysid: Address(sysid, DRONE_COMPONENT), reads)


def _packets(
    datagrams: Series[Datagram], receiver: Callable[[int], Address], reads: frozenset[int] | None
) -> Iterator[TimedMessage]:
    """Every packet that its receiver would take; what does not parse is passed over, as it was in flight."""
    codecs: dict[int, Codec] = {}
    for t_s, datagram in zip(datagrams.t_s, datagrams.messages, strict=True):
        if datagram.sysid not in codecs:
            codecs[datagram.sysid] = Codec(receiver(datagram.sysid), reads=reads)
        for packet in codecs[datagram.sysid].receive(datagram.data):
            yield float(t_s), datagram.sysid, packet.message


_CLOCKS = frozenset({MessageId.TIMESYNC})
_STAMPED = frozenset({MessageId.TIMESYNC, MessageId.ATTITUDE_QUATERNION, MessageId.LOCAL_POSITION_NED})


@dataclass(frozen=True, slots=True, eq=False)
class Backlog:
    """One drone's link: behind_ms (T,), the age of each stamped message as it was read, ms.

    superseded: packets that were dropped unread, since newer ones of their stream had arrived.
    """

    sysid: int
    behind_ms: Float
    superseded: int


@dataclass(slots=True)
class _Link:
    clock: ClockOffset = field(default_factory=ClockOffset)
    behind_ms: list[float] = field(default_factory=list)


def backlogs(flight: Flight) -> tuple[Backlog, ...]:
    """One a drone that was heard, by sysid. Ages count from the first answer to the ground's TIMESYNC."""
    asked = {(sysid, m.ts1_ns) for _, sysid, m in from_ground(flight, _CLOCKS) if isinstance(m, TimeSync)}
    links: dict[int, _Link] = {}
    for t_s, sysid, message in from_drones(flight, _STAMPED):
        link, now_ns = links.setdefault(sysid, _Link()), flight.t0_ns + round(t_s * 1e9)
        match message:
            case TimeSync(tc1_ns=theirs_ns, ts1_ns=sent_ns) if theirs_ns and (sysid, sent_ns) in asked:
                link.clock.exchange(sent_ns, theirs_ns, now_ns)
            case AttitudeQuaternion() | LocalPosition():
                lag_ns = link.clock.lag_ns(message.t_boot_ms * 1_000_000, now_ns)
                if lag_ns is not None:
                    link.behind_ms.append(max(lag_ns, 0) * 1e-6)
    superseded = dict.fromkeys(links, 0)
    for datagram in flight.up.messages:
        if datagram.sysid in superseded:
            superseded[datagram.sysid] += datagram.superseded
    return tuple(
        Backlog(sysid, np.array(link.behind_ms, np.float64), superseded[sysid]) for sysid, link in sorted(links.items())
    )


STEP_NS = 100_000_000
History = Mapping[str, NDArray[Any]]
"""`t_ns` and every field of `DroneLink`, each (T,)."""


def histories(datagrams: Iterable[tuple[int, Datagram]]) -> dict[int, History]:
    """The link state of each drone, by sysid, at each tenth of a second from its first datagram to the last of all.

    datagrams: (t_ns, datagram) in the order of time.
    """
    views: dict[int, LinkView] = {}
    rows: dict[int, list[tuple[int, DroneLink]]] = {}
    next_ns: int | None = None
    t_ns = 0
    for t_ns, datagram in datagrams:
        next_ns = t_ns + STEP_NS if next_ns is None else next_ns
        while t_ns >= next_ns:
            for sysid, view in views.items():
                rows[sysid].append((next_ns, view.now(next_ns)))
            next_ns += STEP_NS
        if datagram.sysid not in views:
            views[datagram.sysid], rows[datagram.sysid] = LinkView(datagram.sysid), []
        views[datagram.sysid].receive(datagram, t_ns)
    for sysid, view in views.items():
        rows[sysid].append((t_ns, view.now(t_ns)))
    return {sysid: _columns(states) for sysid, states in sorted(rows.items())}


def _columns(states: list[tuple[int, DroneLink]]) -> History:
    columns: dict[str, NDArray[Any]] = {"t_ns": np.array([t_ns for t_ns, _ in states], np.int64)}
    for name in (one.name for one in fields(DroneLink)):
        columns[name] = np.array([getattr(link, name) for _, link in states])
    return columns
