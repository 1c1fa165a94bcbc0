"""A client of a server that streams over TCP: connected, watched, connected to again; a `Session` has the protocol."""

import asyncio
from collections.abc import Callable
from typing import Protocol, cast

from formation.messages import Severity
from mocap.sources.source import Feed

CONNECT_S, AGAIN_S, SILENT_S = 2.0, 0.5, 2.0
TICK_S = 0.1
ANSWER_NS = 2_000_000_000
"""A server that has not answered what was asked first by then speaks another protocol."""
LARGEST_PACKET = 1 << 20


class ProtocolError(ValueError):
    """The bytes are not the protocol's; the connection cannot be read on. Its text names message and field."""


class Session(Protocol):
    """One connection's protocol without its socket: bytes in, bytes out; frames go to the feed it was given."""

    def received(self, data: bytes, now_ns: int) -> bytes:
        """Take the next bytes; what to answer. ProtocolError where they cannot be read."""

    def due(self, now_ns: int) -> bytes:
        """The bytes to send as time passes (called every 0.1 s): keep-alives, requests again."""


class Protocols(Protocol):
    """Makes the sessions of one source, one a connection."""

    def open(self, now_ns: int, ours: str, theirs: str, /) -> tuple[Session, bytes]:
        """A new connection's session, and what it says first; ours, theirs: both ends' addresses."""


class TcpClient:
    """Keeps one connection to `host:port`; reconnects to a server that is silent for 2 s."""

    def __init__(self, host: str, port: int, protocols: Protocols, feed: Feed) -> None:
        self.connected = False
        self._host, self._port = host, port
        self._protocols = protocols
        self._feed = feed
        self._reported = ""

    async def run(self) -> None:
        """Run until cancelled. Report each change once: connected, or why not."""
        while True:
            try:
                await self._connection()
                why = "the server closed the connection"
            except ProtocolError as error:
                self._feed.reject(str(error))
                why = f"not understood: {error}"
            except TimeoutError:
                why = f"silent for {SILENT_S:g} s" if self.connected else f"no answer within {CONNECT_S:g} s"
            except OSError as error:
                why = error.strerror or "cannot be reached"
            self._report(f"no frames from {self._host}:{self._port}: {why}; trying again", Severity.WARNING)
            self.connected = False
            await asyncio.sleep(AGAIN_S)

    async def _connection(self) -> None:
        """One connection, from its start to its end."""
        loop = asyncio.get_running_loop()
        async with asyncio.timeout(CONNECT_S):
            transport, link = await loop.create_connection(lambda: _Link(self), self._host, self._port)
        try:
            while not link.ended.done():
                await asyncio.wait((link.ended,), timeout=TICK_S)
                link.tick()
            link.ended.result()
        finally:
            transport.abort()

    def open(self, transport: asyncio.Transport) -> tuple[Session, bytes]:
        """The session of a connection that was made."""
        ours, theirs = transport.get_extra_info("sockname"), transport.get_extra_info("peername")
        return self._protocols.open(self.now_ns(), ours[0], theirs[0])

    def note_received(self) -> None:
        """Note that data came from the server."""
        if not self.connected:
            self.connected = True
            self._report(f"connected to {self._host}:{self._port}", Severity.INFO)

    def now_ns(self) -> int:
        """On our clock."""
        return self._feed.clock.monotonic_ns()

    def _report(self, text: str, severity: Severity) -> None:
        if text != self._reported:
            self._reported = text
            self._feed.report(severity, text)


class _Link(asyncio.Protocol):
    """One connection's bytes into its session, as they come."""

    _session: Session
    _transport: asyncio.Transport

    def __init__(self, client: TcpClient) -> None:
        self.ended = asyncio.get_running_loop().create_future()
        self._client = client
        self._silent_s = 0.0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)
        self._session, hello = self._client.open(self._transport)
        self._transport.write(hello)

    def data_received(self, data: bytes) -> None:
        self._silent_s = 0.0
        self._client.note_received()
        self._do(self._session.received, data)

    def tick(self) -> None:
        """Check for silence and send what is due; every 0.1 s."""
        self._silent_s += TICK_S
        if self._silent_s > SILENT_S:
            self._end(TimeoutError())
        self._do(self._session.due)

    def connection_lost(self, exc: Exception | None) -> None:
        self._end(exc)

    def _do(self, step: Callable[..., bytes], *data: bytes) -> None:
        """Do a step; what a session raises ends its connection: of the protocol, or, a defect, of the whole client."""
        if self.ended.done():
            return
        try:
            answer = step(*data, self._client.now_ns())
            if answer:
                self._transport.write(answer)
        except Exception as error:  # noqa: BLE001 - raised again by whoever waits for the end
            self._end(error)

    def _end(self, error: Exception | None) -> None:
        if self.ended.done():
            return
        if error is None:
            self.ended.set_result(None)
        else:
            self.ended.set_exception(error)
