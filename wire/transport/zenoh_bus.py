"""The lab's bus over Zenoh: MAVLink, truth, state and operator requests, by key; poses are wire.transport.mocap_bus's.

    <lab>/uav/<sysid>/mavlink/{down,up}   <lab>/sim/<sysid>/truth
    <lab>/gcs/<name>/state                <lab>/gcs/<name>/do   (a queryable)

With keys, the name in the certificate of who publishes or asks ends each key but MAVLink's, which is signed.

Peers with explicit endpoints and no multicast. Each listens on a port of its own and learns of the others by
gossip, so that the ones left keep talking when one dies, the one that was connected to first included.
Everything is real-time priority (what viewers are shown: background) and dropped rather than queued, and not express
but frames: on loopback an express put of a burst of twenty packets loses one in a hundred and waits up to 1.6 ms, a
batched one loses none.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from typing import Any, Generic, TypeVar

import zenoh

from formation.link_config import LinkConfig
from formation.messages import Datagram, OperatorReply, OperatorRequest, Truth, Verb
from wire import clock
from wire.errors import BusError as BusError
from wire.mavlink.framing import LARGEST_DATAGRAM
from wire.mavlink.signing import SigningChannel
from wire.rejections import RejectionLog
from wire.schema import Schema, SchemaError, schema_of
from wire.security.protection import LOOPBACK_ONLY, Protection
from wire.text import plain
from wire.transport.link import BACKLOG_MAX, PAUSE_S, Deliver, Intake, LinkCounters
from wire.transport.zenoh_session import ASK_AGAIN_S, REPLY, REQUEST, open_session, request_key

T = TypeVar("T")


class Inbox(Generic[T]):
    """Hands items from Zenoh's threads to the event loop, one wake-up for many; when full the oldest is lost.

    `turn`: how many items it delivers in a row; the others wait for PAUSE_S. None: all.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        deliver: Callable[[T], None],
        counters: LinkCounters,
        limit: int,
        turn: int | None = None,
    ) -> None:
        self._loop = loop
        self._deliver = deliver
        self._counters = counters
        self._queue: deque[T] = deque(maxlen=limit)
        self._turn = turn
        self._resting = False
        self._awake = False
        self._open = True

    def enqueue(self, item: T) -> None:
        """From any thread."""
        if len(self._queue) == self._queue.maxlen:
            self._counters.dropped += 1
        self._queue.append(item)
        if not self._awake:
            self._awake = True
            on_loop(self._loop, self._drain)

    def close(self) -> None:
        """Deliver nothing more."""
        self._open = False

    def _drain(self) -> None:
        if self._resting:
            return  # and stay awake: nobody need wake the loop before the pause is over
        # Cleared first: an item queued from here on is either delivered below or wakes the loop again.
        self._awake = False
        delivered = 0
        while self._queue and self._open:
            if delivered == self._turn:
                self._resting = True
                self._loop.call_later(PAUSE_S, self._resume)
                return
            delivered += 1
            self._counters.received += 1
            self._deliver(self._queue.popleft())

    def _resume(self) -> None:
        self._resting = False
        self._drain()


def on_loop(loop: asyncio.AbstractEventLoop, call: Callable[[], None]) -> None:
    """Call on the loop, from any thread; nothing happens once the loop has closed."""
    try:
        loop.call_soon_threadsafe(call)
    except RuntimeError:  # the loop has closed
        return


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


Reply = Callable[[OperatorReply], None]
Handler = Callable[[OperatorRequest, Reply], None]

_TRUTH: Schema[Truth] = schema_of(Truth)

_EXPRESS = ("mocap/raw", "mocap/frame")  # one at a time, and the control waits for it
_IDLE = ("/log/head", "/log/chunk")  # for viewers: behind everything else
_QUEUED = 1024
_URGENT = (Verb.STOP, Verb.LAND, Verb.HOLD)
"""Each waits in a queue of its own: no flood of other requests, nor of another of these, keeps it waiting."""
LARGEST_PAYLOAD = 1 << 18
"""Bytes of a payload that are read: a frame of a thousand bodies, a state of hundreds of drones, a quarter of it."""
LARGEST_REQUEST = 1024


class ZenohBus:
    """One process's connection to the lab's bus. All callbacks run on the event loop that opened it."""

    def __init__(
        self,
        session: zenoh.Session,
        lab: str,
        rejections: RejectionLog,
        *,
        listens: bool = False,
        protection: Protection = LOOPBACK_ONLY,
    ) -> None:
        self.lab = lab
        self.protection = protection
        """The protection of the bus, and of the drones' links that this process opens beside it."""
        self._certificate_name = protection.bus.name
        self.listens = listens
        """Whether it listens where others look for the bus."""
        self.counters = LinkCounters()
        self.rejections = rejections
        """Inputs rejected on this bus, and on the links of this process that share this log."""
        self.identity = str(session.zid()).encode()
        """Our Zenoh id."""
        self._session = session
        self._loop = asyncio.get_running_loop()
        self._inboxes: list[Inbox[Any]] = []
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._tokens: list[zenoh.LivelinessToken] = []

    @classmethod
    async def open(
        cls,
        config: LinkConfig,
        lab: str,
        rejections: RejectionLog | None = None,
        protection: Protection = LOOPBACK_ONLY,
    ) -> "ZenohBus":
        """Join the bus; peers that are not there yet are retried for ever. BusError, ConfigError for keys.

        rejections: counts rejected inputs; the bus makes its own if there is none. protection: with keys the bus and
        the drones' links on it are authenticated; without, an endpoint of another machine is a BusError.
        """
        listen, connect = config.zenoh_listen, config.zenoh_connect
        session = await asyncio.to_thread(open_session, listen, connect, lab, protection.bus)
        return cls(session, lab, rejections or RejectionLog(), listens=bool(listen), protection=protection)

    @classmethod
    async def open_or_listen(
        cls,
        config: LinkConfig,
        lab: str,
        rejections: RejectionLog | None = None,
        protection: Protection = LOOPBACK_ONLY,
    ) -> "ZenohBus":
        """Join the bus that the configuration names; where it names none, listen if nobody else does. BusError."""
        if not config.names_bus:
            with suppress(BusError):  # the endpoint is another's: join it there
                return await cls.open(config.listening, lab, rejections, protection)
        return await cls.open(config, lab, rejections, protection)

    @property
    def is_joined(self) -> bool:
        """Whether anybody else is on the bus."""
        info = self._session.info
        return bool(info.peers_zid() or info.routers_zid())

    async def close(self) -> None:
        """Leave the bus; nothing is delivered afterwards."""
        for inbox in self._inboxes:
            inbox.close()
        await asyncio.to_thread(self._session.close)

    def ground_link(self, sysids: Iterable[int], deliver: Deliver) -> ZenohLink:
        """The ground's end of the drones `sysids`."""
        return self._link(sysids, "down", "up", deliver)

    def drone_link(self, sysid: int, deliver: Deliver) -> ZenohLink:
        """The drone's own end; without keys it is seen by processes of other labs, too (`others`)."""
        if not self._certificate_name:
            self.declare_token(f"uav/{sysid}")
        return self._link((sysid,), "up", "down", deliver)

    def _link(self, sysids: Iterable[int], out: str, into: str, deliver: Deliver) -> ZenohLink:
        publish = {sysid: self._publisher(f"{self.lab}/uav/{sysid}/mavlink/{out}") for sysid in sysids}
        return ZenohLink(self._session, f"{self.lab}/uav", into, publish, deliver, self.rejections, self.protection)

    def publish(self, key: str, payload: bytes, attachment: bytes | None = None) -> None:
        """Publish bytes on a key of the lab; dropped and counted where Zenoh's queue is full.

        With keys, the name in this process's certificate ends the key, and nobody else may publish there.
        """
        try:
            self._publisher_of(key).put(payload, attachment=attachment)
            self.counters.sent += 1
        except zenoh.ZError:
            self.counters.dropped += 1

    def listen(self, key: str, receive: Callable[[zenoh.Sample], None], limit: int) -> None:
        """Subscribe to a key of the lab. At most `limit` wait, the oldest is lost.

        Payloads that are too large are rejected, and those of publishers whose keys are revoked.
        """

        def receive_judged(judged: zenoh.Sample | str) -> None:
            if isinstance(judged, str):
                self.reject(key, judged)
            else:
                receive(judged)

        inbox = Inbox(self._loop, receive_judged, self.counters, limit)

        def enqueue(sample: zenoh.Sample) -> None:
            inbox.enqueue(self._reject_reason(sample) or sample)

        self._inboxes.append(inbox)
        expression = f"{self.lab}/{key}/*" if self._certificate_name else f"{self.lab}/{key}"
        self._session.declare_subscriber(expression, zenoh.handlers.Callback(enqueue))

    def _reject_reason(self, sample: zenoh.Sample) -> str:
        """Why a sample is not read; empty where it is."""
        if len(sample.payload) > LARGEST_PAYLOAD:
            return f"payload larger than {LARGEST_PAYLOAD} bytes"
        names = self.protection.names
        if names is not None and names.revoked:
            name = str(sample.key_expr).rpartition("/")[2]
            return f"payload of {name}, whose keys are revoked" if name in names.revoked else ""
        return ""

    def reject(self, key: str, reason: str) -> None:
        """Count a rejected payload of a key of the lab."""
        self.counters.rejected += 1
        self.rejections.note(f"{self.lab}/{key}", reason, clock.monotonic_ns())

    def has_subscribers(self, key: str) -> bool:
        """Whether another process subscribes to the key."""
        # An object, though zenoh's own annotations call it a bool; as one it would always be true.
        matching: bool = self._publisher_of(key).matching_status.matching  # type: ignore[attr-defined]
        return matching

    def declare_token(self, key: str) -> None:
        """Declare a liveliness token on the key, for as long as this process is on the bus."""
        self._tokens.append(self._session.liveliness().declare_token(f"{self.lab}/{key}"))

    async def others(self) -> str:
        """Who of other labs is on this bus, in words; the empty text where nobody is seen."""
        get = self._session.liveliness().get
        replies = await asyncio.to_thread(lambda: list(get("*/**", timeout=0.5)))
        keys = sorted({str(reply.ok.key_expr) for reply in replies if reply.ok is not None})
        labs: dict[str, list[str]] = {}
        for key in keys:
            lab, kind, *name = key.split("/")
            if lab != self.lab:
                labs.setdefault(lab, []).append(f"{kind} {name[0]}" if name else kind)
        return "; ".join(f"lab {lab!r}: {', '.join(there[:8])}" for lab, there in labs.items())

    def watch_tokens(self, key: str, receive: Callable[[zenoh.Sample], None]) -> Callable[[], None]:
        """Call back with the liveliness tokens that are there, appear and disappear; call the result to end it."""
        inbox = Inbox(self._loop, receive, self.counters, _QUEUED)
        callback = zenoh.handlers.Callback(inbox.enqueue)
        subscriber = self._session.liveliness().declare_subscriber(f"{self.lab}/{key}", callback, history=True)

        def close() -> None:
            inbox.close()
            subscriber.undeclare()  # type: ignore[no-untyped-call]

        return close

    def publish_truth(self, truth: Truth) -> None:
        """Publish a simulated vehicle's true state."""
        self.publish(f"sim/{truth.sysid}/truth", _TRUTH.encode(truth))

    def on_truth(self, callback: Callable[[Truth], None]) -> None:
        """Call back with the true state of every simulated vehicle."""
        self._subscribe("sim/*/truth", _TRUTH, callback, limit=_QUEUED)

    def publish_state(self, gcs_name: str, text: str) -> None:
        """Publish the ground's state, a JSON text."""
        self.publish(f"gcs/{gcs_name}/state", text.encode())

    def on_state(self, gcs_name: str, callback: Callable[[str], None]) -> None:
        """Call back with the state of the ground `gcs_name`; the latest wins."""

        def receive(sample: zenoh.Sample) -> None:
            callback(sample.payload.to_bytes().decode(errors="replace"))

        self.listen(f"gcs/{gcs_name}/state", receive, limit=1)

    def serve(self, gcs_name: str, handler: Handler) -> None:
        """Answer operators' requests as the ground `gcs_name`: `handler(request, reply)`, reply once, now or later.

        With keys, a request's source begins with the name in the certificate of who asks.
        """
        key = request_key(self.lab, gcs_name, "*" if self._certificate_name else "")

        def receive(asked: tuple[zenoh.Query, OperatorRequest | None]) -> None:
            self._handle(gcs_name, *asked, handler)

        # One at a time: each may cost the ground a tick.
        queues = {verb: Inbox(self._loop, receive, self.counters, 16, turn=1) for verb in _URGENT}
        others = Inbox(self._loop, receive, self.counters, 256, turn=1)
        self._inboxes += [*queues.values(), others]

        def enqueue(query: zenoh.Query) -> None:
            request = _request(query)
            queue = others if request is None else queues.get(request.verb, others)
            queue.enqueue((query, request))

        self._session.declare_queryable(key, zenoh.handlers.Callback(enqueue))

    async def ask(self, gcs_name: str, request: OperatorRequest, timeout_s: float) -> OperatorReply:
        """The answer of the ground `gcs_name`; TimeoutError if none comes in time.

        Asked again only while nobody is there to hear it, so no request is carried out twice.
        """
        key = request_key(self.lab, gcs_name, self._certificate_name)
        try:
            async with asyncio.timeout(timeout_s):
                while (data := await self._get(key, REQUEST.encode(request), timeout_s)) is None:
                    await asyncio.sleep(ASK_AGAIN_S)
        except TimeoutError as error:
            raise TimeoutError(f"no answer on {key} within {timeout_s:g} s") from error
        return REPLY.decode(data)

    def _publisher_of(self, key: str) -> zenoh.Publisher:
        """The publisher of a key of the lab, made once."""
        publisher = self._publishers.get(key)
        if publisher is None:
            priority = zenoh.Priority.BACKGROUND if key.endswith(_IDLE) else zenoh.Priority.REAL_TIME
            own = f"{self.lab}/{key}/{self._certificate_name}" if self._certificate_name else f"{self.lab}/{key}"
            publisher = self._publishers[key] = self._publisher(own, key in _EXPRESS, priority)
        return publisher

    def _publisher(
        self, key: str, express: bool = False, priority: zenoh.Priority = zenoh.Priority.REAL_TIME
    ) -> zenoh.Publisher:
        return self._session.declare_publisher(
            key,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=priority,
            express=express,
        )

    def _subscribe(self, key: str, schema: Schema[T], callback: Callable[[T], None], limit: int) -> None:
        def receive(sample: zenoh.Sample) -> None:
            try:
                message = schema.decode(sample.payload.to_bytes())
            except SchemaError:
                self.reject(key, "payload that is no message of its kind")
                return
            callback(message)

        self.listen(key, receive, limit)

    def _handle(self, gcs_name: str, query: zenoh.Query, request: OperatorRequest | None, handler: Handler) -> None:
        """One query: its handler gets a `reply` that answers and ends it."""
        if request is None:
            self.reject(f"gcs/{gcs_name}/do", "request that is none, or too long")
            query.drop()  # type: ignore[no-untyped-call]
            return

        key = query.key_expr
        source = plain(request.source, 64)
        if self._certificate_name:
            source = f"{str(key).rpartition('/')[2]} ({source})"

        def reply(answer: OperatorReply) -> None:
            try:
                query.reply(key, REPLY.encode(answer))
            except zenoh.ZError:  # the one who asked has gone
                self.counters.dropped += 1
            query.drop()  # type: ignore[no-untyped-call]

        handler(OperatorRequest(request.id, request.verb, plain(request.argument, LARGEST_REQUEST), source), reply)

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


def _request(query: zenoh.Query) -> OperatorRequest | None:
    """The request in a query; None where it is none, or too long."""
    payload = b"" if query.payload is None or len(query.payload) > LARGEST_REQUEST else query.payload.to_bytes()
    try:
        return REQUEST.decode(payload) if payload else None
    except SchemaError:
        return None
