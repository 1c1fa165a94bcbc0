"""What the bridge sends in one tick."""

from typing import NamedTuple

from drone_agent.guard.navigator import Fault
from formation.messages import Datagram, Event, Innovation
from wire.mavlink.framing import packed


class BridgeOutgoing(NamedTuple):
    """What one tick gives: packets for the ground, packets for the autopilot, events, innovations, detected faults."""

    to_ground: tuple[Datagram, ...]
    to_autopilot: tuple[Datagram, ...]
    events: tuple[Event, ...]
    innovations: tuple[Innovation, ...] = ()
    faults: tuple[Fault, ...] = ()


def datagrams(sysid: int, packets: list[bytes]) -> tuple[Datagram, ...]:
    """The packets for, or of, that drone in as few datagrams as hold them."""
    return tuple([Datagram(sysid, data) for data in packed(b"".join(packets))]) if packets else ()
