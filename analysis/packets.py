"""The MAVLink traffic of a log, decoded."""

from collections import defaultdict
from collections.abc import Iterator

from analysis.series import Series
from formation.messages import Datagram
from wire.link_messages import GROUND, LinkMessage
from wire.mavlink import Codec


def packets(datagrams: Series[Datagram]) -> Iterator[tuple[float, int, LinkMessage]]:
    """(t_s, sysid of the drone's link, message) of every packet, in log order; what does not parse is passed over."""
    codecs: defaultdict[int, Codec] = defaultdict(lambda: Codec(GROUND))
    for t_s, datagram in zip(datagrams.t_s, datagrams.messages, strict=True):
        for packet in codecs[datagram.sysid].receive(datagram.data):
            yield float(t_s), datagram.sysid, packet.message
