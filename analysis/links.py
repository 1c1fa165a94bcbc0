"""The MAVLink traffic of a log, decoded: packets, age of telemetry when it was read, what each drone said of itself.

Ages are by the drone's own clock. Battery, link and mode are columns with ten rows a second, out of its datagrams.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from heapq import merge
from itertools import accumulate, chain
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.load import Flight, Traffic
from analysis.series import Index
from formation.maths.arrays import Bool, Float
from wire.clock_offset import ClockOffset
from wire.link_messages import (
    DRONE_COMPONENT,
    GROUND,
    Address,
    LinkMessage,
    MessageId,
    TimeSync,
)
from wire.logs.views import AGE_NAME, RARE, DroneLink, LinkView, Losses, lost_by
from wire.mavlink.codec import Codec
from wire.mavlink.frames import Frames, named_values, stamps

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
_FIELDS = tuple(field.name for field in fields(DroneLink))
History = Mapping[str, NDArray[Any]]
"""`t_ns`, since the log began, and every field of `DroneLink`, each (T,)."""


def histories(up: Traffic) -> dict[int, History]:
    """The link state of each drone, by sysid, at each tenth of a second from its first datagram to the last of all."""
    t_ns = np.rint(up.t_s * 1e9).astype(np.int64)
    of = up.frames["datagram"]
    sysids = np.unique(up.sysid[of])
    grid_ns = np.append(np.arange(t_ns[0] + STEP_NS, t_ns[-1] + 1, STEP_NS), t_ns[-1]) if len(sysids) else t_ns
    return {sysid: _history(up.frames.where(up.sysid[of] == sysid), sysid, t_ns, grid_ns) for sysid in sysids.tolist()}


def _history(frames: Frames, sysid: int, t_ns: Index, grid_ns: Index) -> History:
    """One drone's. frames: of its datagrams; t_ns: of all; grid_ns: of the rows, those before its first frame too."""
    grid_ns = np.append(grid_ns[:-1][grid_ns[:-1] > t_ns[frames["datagram"][0]]], grid_ns[-1])
    frames = frames.where(frames["system"] == sysid)
    states, read = _states(frames, sysid, t_ns, grid_ns)
    columns = {name: np.array([getattr(state, name) for state in states]) for name in _FIELDS}
    frames = frames.where(read)
    received_ns, ages, ages_ms = t_ns[frames["datagram"]], *named_values(frames, AGE_NAME)
    none: Losses = 0, None
    lost = [count for count, _ in accumulate(frames["seq"].tolist(), lost_by, initial=none)]
    columns["received"] = received = _before(received_ns, grid_ns)
    columns["lost"] = np.array(lost)[received]
    columns["silent_s"] = (grid_ns - np.append(0, received_ns)[received]) * 1e-9
    columns["setpoint_age_ms"] = np.append(np.nan, ages_ms)[_before(t_ns[ages["datagram"]], grid_ns)]
    columns["silent_s"][received == 0] = np.nan
    return {"t_ns": grid_ns, **columns}


def _before(event_ns: Index, grid_ns: Index) -> Index:
    """How many of the events there were before each row; the last row has them all."""
    count = np.searchsorted(event_ns, grid_ns)
    count[-1] = len(event_ns)
    return count


def _states(frames: Frames, sysid: int, t_ns: Index, grid_ns: Index) -> tuple[list[DroneLink], Bool]:
    """What a drone's rare messages say of it, in each row; and which of the frames could be read."""
    rare = np.isin(frames["number"], list(RARE))
    of_rare, codec, view = frames.where(rare), Codec(GROUND, reads=RARE), LinkView(sysid)
    packets = [codec.receive(data) for data in of_rare.each()]
    read = ~rare
    read[rare] = [bool(each) for each in packets]
    rare_ns, states, done = t_ns[of_rare["datagram"]], list[DroneLink](), 0
    for row_ns, count in zip(grid_ns.tolist(), _before(rare_ns, grid_ns).tolist(), strict=True):
        for packet in chain.from_iterable(packets[done:count]):
            view.update(packet, row_ns)
        done = count
        states.append(view.now(row_ns))
    return states, read
