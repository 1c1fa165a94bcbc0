"""How far behind each link was: the age of telemetry when the ground read it, by the drone's own clock."""

from dataclasses import dataclass, field

import numpy as np

from analysis.load import Flight
from analysis.packets import from_drones, from_ground
from formation.maths.arrays import Float
from wire.clock_offset import ClockOffset
from wire.link_messages import AttitudeQuaternion, LocalPosition, MessageId, TimeSync

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
