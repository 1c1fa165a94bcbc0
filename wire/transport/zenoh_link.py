"""The MAVLink of some drones over the bus, signed and verified where the drones have keys."""

import asyncio
from collections.abc import Mapping

import zenoh

from formation.messages import Datagram
from wire import clock
from wire.mavlink.signing import SigningChannel
from wire.rejections import RejectionLog
from wire.security.protection import Protection
from wire.transport.inbox import Inbox
from wire.transport.intake import BACKLOG_MAX, Intake
from wire.transport.link import LARGEST_DATAGRAM, Deliver, LinkCounters


class ZenohLink:
    """One end of the links of some drones; see `ZenohBus.ground_link` and `drone_link`."""

    def __init__(
        self,
        session: zenoh.Session,
        base: str,
        into: str,
        publishers: Mapping[int, zenoh.Publisher],
        deliver: Deliver,
        rejections: RejectionLog,
        protection: Protection,
    ) -> None:
        """publishers: by sysid, the way out. The way in is `base`/SYSID/mavlink/`into`."""
        self.counters = LinkCounters()
        self._base = base
        self._publishers = publishers
        self._rejections = rejections
        self._channels = {sysid: protection.channel(sysid) for sysid in publishers}
        # A queue and a turn for each drone: what floods one key costs no other drone a datagram.
        self._intakes = {sysid: Intake(sysid, deliver, self.counters) for sysid in publishers}
        loop = asyncio.get_running_loop()
        self._inboxes = {sysid: self._inbox(sysid, loop) for sysid in publishers}
        self._subscribers = [self._listen(session, sysid, into) for sysid in publishers]

    def send(self, datagram: Datagram) -> None:
        """Publish to (or as) the drone `sysid`; KeyError for a drone that is none of this link's."""
        channel = self._channels[datagram.sysid]
        data = datagram.data if channel is None else channel.sign(datagram.data, clock.unix_us())
        if channel is not None and not data:
            return
        try:
            self._publishers[datagram.sysid].put(data)
            self.counters.sent += 1
        except zenoh.ZError:
            self.counters.dropped += 1

    def close(self) -> None:
        """Stop publishing and delivering."""
        for sysid in self._publishers:
            self._inboxes[sysid].close()
            self._intakes[sysid].close()
        for subscriber in self._subscribers:
            subscriber.undeclare()  # type: ignore[no-untyped-call]
        for publisher in self._publishers.values():
            publisher.undeclare()  # type: ignore[no-untyped-call]

    def _inbox(self, sysid: int, loop: asyncio.AbstractEventLoop) -> Inbox[bytes]:
        intake, channel = self._intakes[sysid], self._channels[sysid]

        def receive(data: bytes) -> None:
            if not data:
                self._reject(sysid, f"datagram that is empty or larger than {LARGEST_DATAGRAM} bytes")
                return
            if channel is not None:
                data = self._verified(channel, sysid, data)
            if data:
                intake.enqueue(data)

        return Inbox(loop, receive, self.counters, BACKLOG_MAX)

    def _listen(self, session: zenoh.Session, sysid: int, into: str) -> zenoh.Subscriber[None]:
        inbox = self._inboxes[sysid]

        def enqueue(sample: zenoh.Sample) -> None:
            inbox.enqueue(sample.payload.to_bytes() if len(sample.payload) <= LARGEST_DATAGRAM else b"")

        key = f"{self._base}/{sysid}/mavlink/{into}"
        return session.declare_subscriber(key, zenoh.handlers.Callback(enqueue))

    def _verified(self, channel: SigningChannel, sysid: int, data: bytes) -> bytes:
        """The datagram's verified packets; the others are counted."""
        verified = channel.verify(data, clock.unix_us())
        if verified.reject_reason:
            self._reject(sysid, verified.reject_reason)
        return verified.data

    def _reject(self, sysid: int, reason: str) -> None:
        self.counters.rejected += 1
        self._rejections.note(f"{self._base}/{sysid}", reason, clock.monotonic_ns())
