"""One client's connection to the emulated VRPN server: cookies, descriptions, pings, and where its poses go."""

import asyncio
from collections.abc import Callable, Iterable
from typing import cast

from mocap.sources.tcp import ProtocolError
from mocap.sources.vrpn import messages
from mocap.sources.vrpn.messages import Stream

SEND_BUFFER_MAX_BYTES = 1_000_000
"""The server drops a client with more unsent bytes than that."""
DATAGRAM_BYTES = 1400
TYPES = (messages.POSE_TYPE, messages.PING_TYPE, messages.PONG_TYPE)
"""What the server's types are, by number."""


class Names:
    """A server's identity: its cookie, its clock in ns, its senders by number."""

    def __init__(self, cookie: bytes, clock_ns: Callable[[], int]) -> None:
        self.cookie = cookie
        self.clock_ns = clock_ns
        self._numbers: dict[bytes, int] = {messages.CONTROL: 0}

    def number(self, name: bytes) -> int | None:
        """A sender's number; None of an unknown one."""
        return self._numbers.get(name)

    def add(self, names: Iterable[bytes]) -> bytes:
        """Add senders; returns the descriptions of the new ones."""
        descriptions = b""
        for name in names:
            if name not in self._numbers:
                self._numbers[name] = len(self._numbers)
                descriptions += messages.description(messages.SENDER_DESCRIPTION, self._numbers[name], name)
        return descriptions

    def all(self) -> bytes:
        """The descriptions that a new client gets: all senders and types."""
        senders = (
            messages.description(messages.SENDER_DESCRIPTION, number, name) for name, number in self._numbers.items()
        )
        types = (messages.description(messages.TYPE_DESCRIPTION, number, name) for number, name in enumerate(TYPES))
        return b"".join((*senders, *types))


class Connection(asyncio.Protocol):
    """A client, from its cookie on."""

    _transport: asyncio.Transport

    def __init__(self, names: Names, clients: set["Connection"], udp: asyncio.DatagramTransport) -> None:
        self._names = names
        self._clients = clients
        self._udp = udp
        self._udp_port: int | None = None
        self._cookie = b""
        self._stream = Stream()
        self._theirs: dict[tuple[int, int], bytes] = {}

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Both ends send their cookies at once."""
        self._transport = cast(asyncio.Transport, transport)
        self._transport.write(self._names.cookie)

    def data_received(self, data: bytes) -> None:
        """A client that does not speak VRPN is dropped."""
        try:
            if len(self._cookie) < messages.COOKIE_BYTES:
                missing = messages.COOKIE_BYTES - len(self._cookie)
                self._cookie, data = self._cookie + data[:missing], data[missing:]
                if len(self._cookie) < messages.COOKIE_BYTES:
                    return
                messages.check_cookie(self._cookie)
                self._transport.write(self._names.all())
                self._clients.add(self)
            for message in self._stream.messages(data):
                self._receive(message)
        except ProtocolError:
            self.drop()

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002
        """It has gone."""
        self._clients.discard(self)

    def send_reliable(self, descriptions: bytes) -> None:
        """Send over TCP; a client that does not read is dropped."""
        if self._transport.get_write_buffer_size() > SEND_BUFFER_MAX_BYTES:
            self.drop()
        elif descriptions:
            self._transport.write(descriptions)

    def send(self, poses: list[bytes]) -> None:
        """Send pose messages by UDP, or over TCP if the client gave no UDP port."""
        if self._udp_port is None:
            self.send_reliable(b"".join(poses))
            return
        each = DATAGRAM_BYTES // len(poses[0]) if poses else 1
        to = self._transport.get_extra_info("peername")[0], self._udp_port
        for k in range(0, len(poses), each):
            self._udp.sendto(b"".join(poses[k : k + each]), to)

    def drop(self) -> None:
        """End it."""
        self._clients.discard(self)
        self._transport.abort()

    def _receive(self, message: messages.Message) -> None:
        kind, number = message.type, message.sender
        if kind in (messages.SENDER_DESCRIPTION, messages.TYPE_DESCRIPTION):
            if 0 <= number < messages.MOST_IDS:
                self._theirs[kind, number] = messages.described(message.payload)
        elif kind == messages.UDP_DESCRIPTION:
            self._udp_port = number if 0 < number < 65_536 else None
        elif self._theirs.get((messages.TYPE_DESCRIPTION, kind)) == messages.PING_TYPE:
            sender = self._names.number(self._theirs.get((messages.SENDER_DESCRIPTION, number), b""))
            if sender:
                self.send_reliable(messages.message(self._names.clock_ns(), sender, TYPES.index(messages.PONG_TYPE)))
