"""The lab's bus over Zenoh: MAVLink, poses, truth, state and operator requests, by key.

    <lab>/uav/<sysid>/mavlink/{down,up}   <lab>/mocap/frame   <lab>/sim/<sysid>/truth
    <lab>/gcs/<name>/state                <lab>/gcs/<name>/do   (a queryable)

Peers with explicit endpoints and no multicast. Each listens on a port of its own and learns of the others by
gossip, so that the ones left keep talking when one dies, the one that was connected to first included.
Everything is real-time priority and dropped rather than queued, and not express: on loopback an express put
of a burst of twenty packets loses one in a hundred and waits up to 1.6 ms, a batched one loses none.
"""

import asyncio
from collections.abc import Callable, Iterable
from typing import TypeVar

import zenoh

from formation.config import LinkConfig
from formation.messages import Datagram, MocapFrame, OperatorReply, OperatorRequest, Truth
from wire.errors import BusError as BusError
from wire.inbox import Inbox, on_loop
from wire.link import Deliver, LinkCounters
from wire.schema import Schema, SchemaError, schema_of
from wire.zenoh_session import open_session, request_key

T = TypeVar("T")
Reply = Callable[[OperatorReply], None]
Handler = Callable[[OperatorRequest, Reply], None]

_FRAME: Schema[MocapFrame] = schema_of(MocapFrame)
_TRUTH: Schema[Truth] = schema_of(Truth)
_REQUEST: Schema[OperatorRequest] = schema_of(OperatorRequest)
_REPLY: Schema[OperatorReply] = schema_of(OperatorReply)

_QUEUED = 1024
_ASK_AGAIN_S = 0.05


class ZenohLink:
    """The MAVLink of some drones over the bus; see `ZenohBus.ground_link` and `drone_link`."""

    def __init__(
        self,
        publishers: dict[int, zenoh.Publisher],
        subscribers: list[zenoh.Subscriber[None]],
        inbox: Inbox[Datagram],
        counters: LinkCounters,
    ) -> None:
        self.counters = counters
        self._publishers = publishers
        self._subscribers = subscribers
        self._inbox = inbox

    def send(self, datagram: Datagram) -> None:
        """Publish to (or as) the drone `sysid`; KeyError for a drone that is none of this link's."""
        try:
            self._publishers[datagram.sysid].put(datagram.data)
            self.counters.sent += 1
        except zenoh.ZError:
            self.counters.dropped += 1

    def close(self) -> None:
        """Stop publishing and delivering."""
        self._inbox.close()
        for subscriber in self._subscribers:
            subscriber.undeclare()  # type: ignore[no-untyped-call]
        for publisher in self._publishers.values():
            publisher.undeclare()  # type: ignore[no-untyped-call]


class ZenohBus:
    """One process's place on the lab's bus. All callbacks run on the event loop that opened it."""

    def __init__(self, session: zenoh.Session, lab: str) -> None:
        self.lab = lab
        self.counters = LinkCounters()
        self.bad_payloads = 0
        self._session = session
        self._loop = asyncio.get_running_loop()
        self._inboxes: list[Inbox[zenoh.Sample]] = []
        self._publishers: dict[str, zenoh.Publisher] = {}

    @classmethod
    async def open(cls, config: LinkConfig, lab: str) -> "ZenohBus":
        """Join the bus; peers that are not there yet are retried for ever. BusError."""
        session = await asyncio.to_thread(open_session, config.zenoh_listen, config.zenoh_connect, lab)
        return cls(session, lab)

    async def close(self) -> None:
        """Leave the bus; nothing is delivered afterwards."""
        for inbox in self._inboxes:
            inbox.close()
        await asyncio.to_thread(self._session.close)

    def ground_link(self, sysids: Iterable[int], deliver: Deliver) -> ZenohLink:
        """The ground's end of the drones `sysids`."""
        return self._link(list(sysids), "down", "up", deliver)

    def drone_link(self, sysid: int, deliver: Deliver) -> ZenohLink:
        """The drone's own end."""
        return self._link([sysid], "up", "down", deliver)

    def publish_frame(self, frame: MocapFrame) -> None:
        """Publish one exposure."""
        self._put("mocap/frame", _FRAME.encode(frame))

    def on_frame(self, callback: Callable[[MocapFrame], None]) -> None:
        """Call back with each frame; the latest wins where the loop is late."""
        self._subscribe("mocap/frame", _FRAME, callback, limit=1)

    def publish_truth(self, truth: Truth) -> None:
        """Publish a simulated vehicle's true state."""
        self._put(f"sim/{truth.sysid}/truth", _TRUTH.encode(truth))

    def on_truth(self, callback: Callable[[Truth], None]) -> None:
        """Call back with the true state of every simulated vehicle."""
        self._subscribe("sim/*/truth", _TRUTH, callback, limit=_QUEUED)

    def publish_state(self, gcs_name: str, text: str) -> None:
        """Publish the ground's state, in words of its own."""
        self._put(f"gcs/{gcs_name}/state", text.encode())

    def on_state(self, gcs_name: str, callback: Callable[[str], None]) -> None:
        """Call back with the state of the ground `gcs_name`; the latest wins."""

        def take(sample: zenoh.Sample) -> None:
            callback(sample.payload.to_bytes().decode(errors="replace"))

        self._listen(f"gcs/{gcs_name}/state", take, limit=1)

    def serve(self, gcs_name: str, handler: Handler) -> None:
        """Answer operators' requests as the ground `gcs_name`: `handler(request, reply)`, reply once, now or later."""
        key = request_key(self.lab, gcs_name)
        inbox = Inbox[zenoh.Query](self._loop, lambda query: self._handle(key, query, handler), self.counters, _QUEUED)
        self._session.declare_queryable(key, zenoh.handlers.Callback(inbox.put))

    async def ask(self, gcs_name: str, request: OperatorRequest, timeout_s: float) -> OperatorReply:
        """The answer of the ground `gcs_name`; TimeoutError if none comes in time.

        Asked again only while nobody is there to hear it, so no request is carried out twice.
        """
        key = request_key(self.lab, gcs_name)
        try:
            async with asyncio.timeout(timeout_s):
                while (data := await self._get(key, _REQUEST.encode(request), timeout_s)) is None:
                    await asyncio.sleep(_ASK_AGAIN_S)
        except TimeoutError as error:
            raise TimeoutError(f"no answer on {key} within {timeout_s:g} s") from error
        return _REPLY.decode(data)

    def _link(self, sysids: list[int], out: str, into: str, deliver: Deliver) -> ZenohLink:
        base = f"{self.lab}/uav"
        counters = LinkCounters()
        inbox = Inbox(self._loop, deliver, counters, _QUEUED)

        def listen(sysid: int) -> zenoh.Subscriber[None]:
            def take(sample: zenoh.Sample) -> None:
                inbox.put(Datagram(sysid, sample.payload.to_bytes()))

            key = f"{base}/{sysid}/mavlink/{into}"
            return self._session.declare_subscriber(key, zenoh.handlers.Callback(take))

        publishers = {sysid: self._publisher(f"{base}/{sysid}/mavlink/{out}") for sysid in sysids}
        return ZenohLink(publishers, [listen(sysid) for sysid in sysids], inbox, counters)

    def _publisher(self, key: str) -> zenoh.Publisher:
        return self._session.declare_publisher(
            key,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=False,
        )

    def _put(self, key: str, payload: bytes) -> None:
        try:
            publisher = self._publishers.get(key)
            if publisher is None:
                publisher = self._publishers[key] = self._publisher(f"{self.lab}/{key}")
            publisher.put(payload)
            self.counters.sent += 1
        except zenoh.ZError:
            self.counters.dropped += 1

    def _subscribe(self, key: str, schema: Schema[T], callback: Callable[[T], None], limit: int) -> None:
        def take(sample: zenoh.Sample) -> None:
            try:
                message = schema.decode(sample.payload.to_bytes())
            except SchemaError:
                self.bad_payloads += 1
                return
            callback(message)

        self._listen(key, take, limit)

    def _listen(self, key: str, take: Callable[[zenoh.Sample], None], limit: int) -> None:
        inbox = Inbox(self._loop, take, self.counters, limit)
        self._inboxes.append(inbox)
        self._session.declare_subscriber(f"{self.lab}/{key}", zenoh.handlers.Callback(inbox.put))

    def _handle(self, key: str, query: zenoh.Query, handler: Handler) -> None:
        """One query: its handler gets a `reply` that answers and ends it."""
        try:
            request = _REQUEST.decode(query.payload.to_bytes() if query.payload is not None else b"")
        except SchemaError:
            self.bad_payloads += 1
            query.drop()  # type: ignore[no-untyped-call]
            return

        def reply(answer: OperatorReply) -> None:
            try:
                query.reply(key, _REPLY.encode(answer))
            except zenoh.ZError:  # the one who asked has gone
                self.counters.dropped += 1
            query.drop()  # type: ignore[no-untyped-call]

        handler(request, reply)

    async def _get(self, key: str, payload: bytes, timeout_s: float) -> bytes | None:
        """The first reply's bytes; None where the query ends without one, because nobody serves the key."""
        answer: asyncio.Future[bytes | None] = self._loop.create_future()

        def settle(data: bytes | None) -> None:
            if not answer.done():
                answer.set_result(data)

        def on_reply(reply: zenoh.Reply) -> None:
            sample = reply.ok
            if sample is not None:
                data = sample.payload.to_bytes()
                on_loop(self._loop, lambda: settle(data))

        callback = zenoh.handlers.Callback(on_reply, lambda: on_loop(self._loop, lambda: settle(None)))
        self._session.get(key, callback, payload=payload, timeout=timeout_s)
        return await answer
