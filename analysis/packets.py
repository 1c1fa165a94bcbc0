"""The MAVLink traffic of a log, decoded."""

from collections.abc import Callable, Iterator

from analysis.load import Flight
from analysis.series import Series
from formation.messages import Datagram
from wire.link_messages import DRONE_COMPONENT, GROUND, Address, LinkMessage
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
