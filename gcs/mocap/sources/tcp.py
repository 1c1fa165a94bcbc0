"""A client of a server that streams over TCP: connected, watched, connected to again; a `Session` has the protocol."""

import asyncio
from typing import Protocol

from formation.messages import Severity
from gcs.mocap.sources.source import Feed

CONNECT_S, AGAIN_S, SILENT_S = 2.0, 0.5, 2.0
READ_BYTES = 65_536
LOOK_S = 0.1


class ProtocolError(ValueError):
    """What came is not the protocol; the connection cannot be read on. Its text names message and field."""


class Session(Protocol):
    """One connection's protocol without its socket: bytes in, bytes out; frames go to the feed it was given."""

    def received(self, data: bytes, now_ns: int) -> bytes:
        """Take the next bytes; what to answer. ProtocolError where they cannot be read."""

    def due(self, now_ns: int) -> bytes:
        """What is to be sent as time passes (called every 0.1 s): keep-alives, requests again."""


class Protocols(Protocol):
    """Makes the sessions of one source, one a connection."""

    def open(self, now_ns: int) -> tuple[Session, bytes]:
        """A new connection's session, and what it says first."""


class TcpClient:
    """Keeps one connection to `host:port`; a server that is silent for 2 s is connected to anew."""

    def __init__(self, host: str, port: int, protocols: Protocols, feed: Feed) -> None:
        self.connected = False
        self._host, self._port = host, port
        self._protocols = protocols
        self._feed = feed
        self._told = ""

    async def run(self) -> None:
        """Until cancelled. Each change is told once: connected, and why it is not."""
        while True:
            try:
                await self._connection()
                why = "the server closed the connection"
            except ProtocolError as error:
                self._feed.refuse(str(error))
                why = f"not understood: {error}"
            except TimeoutError:
                why = f"silent for {SILENT_S:g} s" if self.connected else f"no answer within {CONNECT_S:g} s"
            except OSError as error:
                why = error.strerror or "cannot be reached"
            self._tell(f"no frames from {self._host}:{self._port}: {why}; trying again", Severity.WARNING)
            self.connected = False
            await asyncio.sleep(AGAIN_S)

    async def _connection(self) -> None:
        """One connection, from its start to its end."""
        async with asyncio.timeout(CONNECT_S):
            reader, writer = await asyncio.open_connection(self._host, self._port)
        try:
            session, hello = self._protocols.open(self._feed.clock.monotonic_ns())
            writer.write(hello)
            await self._converse(session, reader, writer)
        finally:
            writer.close()

    async def _converse(self, session: Session, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        silent_s, reading = 0.0, asyncio.ensure_future(reader.read(READ_BYTES))
        try:
            while True:
                await asyncio.wait((reading,), timeout=LOOK_S)
                if reading.done():
                    data = reading.result()
                    if not data:
                        return
                    silent_s = 0.0
                    if not self.connected:
                        self.connected = True
                        self._tell(f"connected to {self._host}:{self._port}", Severity.INFO)
                    reading = asyncio.ensure_future(reader.read(READ_BYTES))
                    writer.write(session.received(data, self._feed.clock.monotonic_ns()))
                else:
                    silent_s += LOOK_S
                    if silent_s >= SILENT_S:
                        raise TimeoutError
                writer.write(session.due(self._feed.clock.monotonic_ns()))
        finally:
            reading.cancel()
            await asyncio.gather(reading, return_exceptions=True)

    def _tell(self, text: str, severity: Severity) -> None:
        if text != self._told:
            self._told = text
            self._feed.say(severity, text)
