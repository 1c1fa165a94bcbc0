"""The MAVLink traffic of a log, decoded: packets, age of telemetry when it was read, what each drone said of itself.

Ages are by the drone's own clock. Battery, link and mode are columns with ten rows a second, out of its datagrams.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from heapq import merge
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.load import Flight, Traffic
from formation.maths.arrays import Float
from wire.clock_offset import ClockOffset
from wire.link_messages import (
    DRONE_COMPONENT,
    GROUND,
    Address,
    LinkMessage,
    MessageId,
    Packet,
    TimeSync,
    UnknownMessage,
)
from wire.logs.views import READS, DroneLink, LinkView
from wire.mavlink.codec import Codec
from wire.mavlink.frames import Frames, stamps

TimedMessage = tuple[float, int, LinkMessage]


def from_drones(flight: Flight, reads: frozenset[int]) -> Iterator[TimedMessage]:
    """(t_s, sysid of the link, message) of packets that the ground received, in log order; reads: the messages' ids."""
    return (each[1:] for each in _packets(flight.up, lambda _: GROUND, reads))


def from_ground(flight: Flight, reads: frozenset[int]) -> Iterator[TimedMessage]:
    """(t_s, sysid of the link, message) of packets that the ground sent, in log order; reads: the messages' ids."""
    return (each[1:] for each in _packets(flight.down, lambda sysid: Address(sysid, DRONE_COMPONENT), reads))


def _packets(
    traffic: Traffic, receiver: Callable[[int], Address], reads: frozenset[int]
) -> Iterator[tuple[int, float, int, LinkMessage]]:
    """Every packet that its receiver would take, where its frame is first; what does not parse is passed over, as
    it was in flight."""
    codecs: dict[int, Codec] = {}
    frames = traffic.frames.of(*reads)
    start, of = frames["start"].tolist(), frames["datagram"]
    rows = zip(start, traffic.t_s[of].tolist(), traffic.sysid[of].tolist(), frames.each(), strict=True)
    for at, t_s, sysid, data in rows:
        if sysid not in codecs:
            codecs[sysid] = Codec(receiver(sysid), reads=reads)
        for packet in codecs[sysid].receive(data):
            yield at, t_s, sysid, packet.message


_CLOCKS = frozenset({MessageId.TIMESYNC})


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
    up, begin_ns = flight.up, flight.t0_ns
    asked = {(sysid, m.ts1_ns) for _, sysid, m in from_ground(flight, _CLOCKS) if isinstance(m, TimeSync)}
    reported, boot_ms = stamps(up.frames)
    of = reported["datagram"]
    stamped = zip(reported["start"].tolist(), up.t_s[of].tolist(), up.sysid[of].tolist(), boot_ms.tolist(), strict=True)
    sysids = np.unique(up.sysid[up.frames["datagram"]]).tolist()
    links = {sysid: _Link() for sysid in sysids}
    for _, t_s, sysid, received in merge(stamped, _packets(up, lambda _: GROUND, _CLOCKS), key=itemgetter(0)):
        link, now_ns = links[sysid], begin_ns + round(t_s * 1e9)
        if isinstance(received, int):
            lag_ns = link.clock.lag_ns(received * 1_000_000, now_ns)
            if lag_ns is not None:
                link.behind_ms.append(max(lag_ns, 0) * 1e-6)
        elif isinstance(received, TimeSync) and received.tc1_ns and (sysid, received.ts1_ns) in asked:
            link.clock.exchange(received.ts1_ns, received.tc1_ns, now_ns)
    return tuple(
        Backlog(sysid, np.array(link.behind_ms, np.float64), int(up.superseded[up.sysid == sysid].sum()))
        for sysid, link in links.items()
    )


STEP_NS = 100_000_000
History = Mapping[str, NDArray[Any]]
"""`t_ns`, since the log began, and every field of `DroneLink`, each (T,)."""


def histories(up: Traffic) -> dict[int, History]:
    """The link state of each drone, by sysid, at each tenth of a second from its first datagram to the last of all."""
    views: dict[int, LinkView] = {}
    rows: dict[int, list[tuple[int, DroneLink]]] = {}
    t_ns = [round(t_s * 1e9) for t_s in up.t_s.tolist()]
    next_ns = t_ns[0] + STEP_NS if t_ns else 0
    for k, packet in _packets_of_drones(up.frames):
        while t_ns[k] >= next_ns:
            for sysid, view in views.items():
                rows[sysid].append((next_ns, view.now(next_ns)))
            next_ns += STEP_NS
        sysid = int(up.sysid[k])
        if sysid not in views:
            views[sysid], rows[sysid] = LinkView(sysid), []
        views[sysid].update(packet, t_ns[k])
    for sysid, view in views.items():
        rows[sysid].append((t_ns[-1], view.now(t_ns[-1])))
    return {sysid: _columns(states) for sysid, states in sorted(rows.items())}


def _packets_of_drones(frames: Frames) -> Iterator[tuple[int, Packet]]:
    """Every packet of drones, with its datagram: decoded, or UnknownMessage where it says nothing of a link's state."""
    codec = Codec(GROUND, reads=READS)
    names = ("datagram", "number", "system", "component", "seq")
    rows = zip(*(frames[name].tolist() for name in names), frames.each(), strict=True)
    for datagram, number, system, component, seq, data in rows:
        if number in READS:
            yield from ((datagram, packet) for packet in codec.receive(data))
        else:
            yield datagram, Packet(Address(system, component), seq, UnknownMessage(number))


def _columns(states: list[tuple[int, DroneLink]]) -> History:
    columns: dict[str, NDArray[Any]] = {"t_ns": np.array([t_ns for t_ns, _ in states], np.int64)}
    for name in (one.name for one in fields(DroneLink)):
        columns[name] = np.array([getattr(link, name) for _, link in states])
    return columns
