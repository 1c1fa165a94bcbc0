"""What the bridge sends in one tick."""

from dataclasses import dataclass

from formation.messages import Datagram, Event
from wire.mavlink.framing import packed


@dataclass(frozen=True, slots=True)
class BridgeOutgoing:
    """What one tick gives: packets for the ground, packets for the autopilot, events."""

    to_ground: tuple[Datagram, ...]
    to_autopilot: tuple[Datagram, ...]
    events: tuple[Event, ...]


def datagrams(sysid: int, packets: list[bytes]) -> tuple[Datagram, ...]:
    """The packets for, or of, that drone in as few datagrams as hold them."""
    return tuple(Datagram(sysid, data) for data in packed(b"".join(packets)))
