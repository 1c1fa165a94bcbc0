"""A node in ROS 2's graph over Zenoh, by the keys of rmw_zenoh (Jazzy or later); no ROS is on this machine.

    <domain>/<topic>/<type>/<type hash>                          messages in CDR, and requests of services
    @ros2_lv/<domain>/<session>/<node>/<entity>/<kind>/...       liveliness tokens, of which ROS makes its graph
    <topic>                                                      messages of a graph on DDS: zenoh-bridge-ros2dds

Attached to each message are its number, its time and its publisher's gid. The session is a client of the graph's router
(`rmw_zenohd`), as peers of other Zenoh versions see nothing through it. Callbacks run on the event loop that opened it.
"""

import asyncio
import struct
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from hashlib import blake2b
from typing import Any

import zenoh

from wire.clock import REAL_TIME, Clock, unix_us
from wire.errors import BusError
from wire.ros2.message_types import CdrError, MessageType, Values, message_type
from wire.transport.link import LinkCounters
from wire.transport.zenoh_bus import LARGEST_PAYLOAD, Inbox
from wire.transport.zenoh_session import RETRY, zenoh_config

_ATTACHED = struct.Struct("<qqB16s")
_GID_BYTES = 16
_QOS, _LATCHED_QOS = "::,10:,:,:,,", ":1:,1:,:,:,,"
"""Reliable, volatile, the last ten kept; and transient local, the last one kept."""

Receive = Callable[[str, bytes, int], None]
"""Receives a message: its type's name in keys, its CDR, and when it came (the node's clock, ns)."""
Reply = Callable[[Values], None]


@dataclass(frozen=True, slots=True)
class Graph:
    """Where a graph is, and where in it a node stands; namespace: empty or `/NAME`.

    dds: it is on DDS, behind zenoh-bridge-ros2dds, whose own domain it then is.
    """

    router: str
    domain: int = 0
    namespace: str = ""
    node: str = "formation"
    dds: bool = False

    def topic(self, name: str) -> str:
        """The full name of a topic or service; a name that begins with / is one."""
        return name if name.startswith("/") else f"{self.namespace}/{name}"


class Publisher:
    """One topic's, of one node."""

    def __init__(self, publisher: zenoh.Publisher, kind: MessageType, gid: bytes, counters: LinkCounters) -> None:
        self._publisher, self._kind, self._gid, self._counters = publisher, kind, gid, counters
        self._number = 0
        self.has_subscribers = bool(publisher.matching_status.matching)  # type: ignore[attr-defined]
        """Whether anybody subscribes to the topic."""
        publisher.declare_matching_listener(zenoh.handlers.Callback(self._note))

    def publish(self, values: Values) -> None:
        """Publish a message; dropped and counted where Zenoh's queue is full."""
        self._number += 1
        attached = _ATTACHED.pack(self._number, unix_us() * 1000, _GID_BYTES, self._gid)
        try:
            self._publisher.put(self._kind.encode(values), attachment=attached)
            self._counters.sent += 1
        except zenoh.ZError:
            self._counters.dropped += 1

    def _note(self, status: zenoh.MatchingStatus) -> None:
        self.has_subscribers = status.matching


class Node:
    """A node of one graph, and its Zenoh session."""

    def __init__(self, session: zenoh.Session, graph: Graph, clock: Clock = REAL_TIME) -> None:
        """clock: of the times at which messages came."""
        self.graph = graph
        self._clock = clock
        self.counters = LinkCounters()
        self._session = session
        self._loop = asyncio.get_running_loop()
        self._inboxes: list[Inbox[Any]] = []
        self._tokens: list[zenoh.LivelinessToken] = []
        self._declare("NN")

    @classmethod
    async def open(cls, graph: Graph, clock: Clock = REAL_TIME) -> "Node":
        """Join the graph, as soon as a router is there; a lab's own bus is none. BusError for what is no endpoint."""
        try:
            _configuration(graph.router)
        except zenoh.ZError as error:
            raise BusError(f"ROS 2's router {graph.router}: {error}") from error
        while True:
            with suppress(zenoh.ZError):
                session = await asyncio.to_thread(lambda: zenoh.open(_configuration(graph.router)))
                if session.info.routers_zid():
                    return cls(session, graph, clock)
                await asyncio.to_thread(session.close)
            await asyncio.sleep(0.1)

    @property
    def is_joined(self) -> bool:
        """Whether the router is still there; it is found again where it comes again."""
        return bool(self._session.info.routers_zid())

    def publisher(self, topic: str, type_name: str, latched: bool = False) -> Publisher:
        """The publisher of a topic. latched: as transient local; who publishes repeats it for those who come late."""
        kind, topic = message_type(type_name), self.graph.topic(topic)
        publisher = self._session.declare_publisher(
            self._key(topic, kind), congestion_control=zenoh.CongestionControl.DROP
        )
        token = self._declare("MP", topic, kind, _LATCHED_QOS if latched else _QOS)
        return Publisher(publisher, kind, blake2b(token.encode(), digest_size=_GID_BYTES).digest(), self.counters)

    def subscribe(self, topic: str, receive: Receive, dds_name: str = "") -> None:
        """Subscribe to a topic, of whatever type. Of those that wait the oldest are lost; large ones are rejected.

        dds_name: of its type, where the keys of the graph do not have it.
        """
        inbox = self._inbox(lambda came: receive(*came))

        def enqueue(sample: zenoh.Sample) -> None:
            now_ns = self._clock.monotonic_ns()
            if len(sample.payload) > LARGEST_PAYLOAD:
                self.counters.rejected += 1
                return
            name = dds_name or str(sample.key_expr).split("/")[-2]
            inbox.enqueue((name, sample.payload.to_bytes(), now_ns))

        topic = self.graph.topic(topic)
        key = topic[1:] if self.graph.dds else f"{self.graph.domain}{topic}/*/*"
        self._session.declare_subscriber(key, zenoh.handlers.Callback(enqueue))

    def serve(self, service: str, type_name: str, handle: Callable[[Reply], None]) -> None:
        """Serve a service whose request is empty: `handle(reply)`, reply once, now or later."""
        kind, service = message_type(type_name), self.graph.topic(service)
        request, response = message_type(f"{type_name}_Request"), message_type(f"{type_name}_Response")
        key = self._key(service, kind)

        def receive(query: zenoh.Query) -> None:
            try:
                number, _, _, gid = _ATTACHED.unpack(_bytes(query.attachment))
                request.decode(_bytes(query.payload))
            except (struct.error, CdrError) as error:
                self.counters.rejected += 1
                query.reply_err(str(error))
                query.drop()  # type: ignore[no-untyped-call]
                return

            def reply(values: Values) -> None:
                attached = _ATTACHED.pack(number, unix_us() * 1000, _GID_BYTES, gid)
                try:
                    query.reply(key, response.encode(values), attachment=attached)
                except zenoh.ZError:  # the one who asked has gone
                    self.counters.dropped += 1
                query.drop()  # type: ignore[no-untyped-call]

            handle(reply)

        inbox = self._inbox(receive)
        self._session.declare_queryable(key, zenoh.handlers.Callback(inbox.enqueue), complete=True)
        self._declare("SS", service, kind, _QOS)

    async def close(self) -> None:
        """Leave the graph; nothing is delivered afterwards."""
        for inbox in self._inboxes:
            inbox.close()
        await asyncio.to_thread(self._session.close)

    def _inbox(self, receive: Callable[[Any], None]) -> Inbox[Any]:
        inbox = Inbox(self._loop, receive, self.counters, 256)
        self._inboxes.append(inbox)
        return inbox

    def _key(self, topic: str, kind: MessageType) -> str:
        return topic[1:] if self.graph.dds else f"{self.graph.domain}{topic}/{kind.dds_name}/{kind.hash}"

    def _declare(self, entity: str, topic: str = "", kind: MessageType | None = None, qos: str = "") -> str:
        """Declare the token of the node itself, or of something that it has; its key."""
        graph, number = self.graph, len(self._tokens)
        namespace = _mangled(graph.namespace or "/")
        parts = ["@ros2_lv", graph.domain, self._session.zid(), 0, number, entity, "%", namespace, graph.node]
        if kind is not None:
            parts += [_mangled(topic), kind.dds_name, kind.hash, qos]
        key = "/".join(map(str, parts))
        if not graph.dds:
            self._tokens.append(self._session.liveliness().declare_token(key))
        return key


def _mangled(name: str) -> str:
    return name.replace("/", "%")


def _bytes(data: zenoh.ZBytes | None) -> bytes:
    """At most so many as are read anywhere."""
    return b"" if data is None or len(data) > LARGEST_PAYLOAD else data.to_bytes()


def _configuration(router: str) -> zenoh.Config:
    values = {
        "mode": "client",
        "connect/endpoints": [router],
        # A client's first connection is waited for in a thread, which nothing ends; later ones Zenoh tries for ever.
        "connect/timeout_ms": 1000,
        "connect/retry": RETRY,
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
    }
    return zenoh_config(values)
