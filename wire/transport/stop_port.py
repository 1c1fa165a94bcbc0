"""The ground's UDP ports for stops by datagram: one beside each endpoint of the bus, with keys and without."""

import asyncio
import os
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from formation.exposure import is_local_endpoint
from formation.link_config import LinkConfig
from formation.messages import Event, Severity
from formation.requests import OperatorReply, OperatorRequest, Verb
from wire import clock
from wire.errors import ConfigError
from wire.process.daemon import EventSink
from wire.process.port_holder import why_not_bound
from wire.rejections import RejectionLog
from wire.security.private_keys import read_mavlink_key, stop_key_file
from wire.security.protection import Names, Protection
from wire.text import plain
from wire.transport.link import PAUSE_S
from wire.transport.stop_call import LARGEST, SOURCE_MOST, StopReader, StopRequest, stop_address

Handler = Callable[[OperatorRequest, Callable[[OperatorReply], None]], None]
READS_A_TURN = 32
"""Datagrams read at once: 0.2 ms of work. A flood of others is read no faster; who asks asks again every 10 ms."""
BUFFER = 1 << 20


class StopPort:
    """One bound port. A request is handed on once; one that comes again is answered again."""

    def __init__(
        self, where: tuple[socket.AddressFamily, tuple[str, int]], reader: StopReader, handler: Handler,
        rejections: RejectionLog
    ) -> None:  # fmt: skip
        """Bind (OSError)."""
        self._reader, self._handler, self._rejections = reader, handler, rejections
        self._answers: dict[str, bytes] = {}
        """The newest answer by name."""
        self._loop = asyncio.get_running_loop()
        self._resume: asyncio.TimerHandle | None = None
        self._socket = socket.socket(where[0], socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        try:
            self._socket.bind(where[1])
        except OSError:
            self._socket.close()
            raise
        self._loop.add_reader(self._socket, self._read)

    def close(self) -> None:
        """Hear nobody more."""
        if self._resume is not None:
            self._resume.cancel()
        self._loop.remove_reader(self._socket)
        self._socket.close()

    def _read(self) -> None:
        for _ in range(READS_A_TURN):
            try:
                data, sender = self._socket.recvfrom(LARGEST + 1)
            except BlockingIOError:
                return
            except OSError:  # an ICMP answer to something sent earlier
                continue
            found = self._reader.read(data)
            if isinstance(found, StopRequest):
                self._obey(found, sender)
            elif isinstance(found, bytes):
                self._send(found, sender)
            else:
                self._rejections.note(str(sender[0]), found, clock.monotonic_ns())
        self._loop.remove_reader(self._socket)
        self._resume = self._loop.call_later(PAUSE_S, self._loop.add_reader, self._socket, self._read)

    def _obey(self, asked: StopRequest, sender: tuple[str, int]) -> None:
        if asked.again:
            if asked.name in self._answers:
                self._send(self._answers[asked.name], sender)
            return
        self._answers.pop(asked.name, None)

        def reply(answer: OperatorReply) -> None:
            self._answers[asked.name] = self._reader.reply(asked, answer)
            self._send(self._answers[asked.name], sender)

        source = plain(asked.source, SOURCE_MOST)
        if asked.name:
            source = f"{asked.name} ({source} at {sender[0]})"
        self._handler(OperatorRequest(asked.id, Verb.STOP, source=source), reply)

    def _send(self, data: bytes, sender: tuple[str, int]) -> None:
        try:
            self._socket.sendto(data, sender)
        except OSError:  # it asks again
            return


@contextmanager
def stop_ports(
    link: LinkConfig, lab: str, protection: Protection, handler: Handler, rejections: RejectionLog, report: EventSink
) -> Iterator[None]:
    """While inside, each endpoint where this ground listens, or may on this machine, has a port.

    One that cannot be bound is reported: the bus is left.
    """
    own, names = protection.bus.identity, protection.names
    key_of = _Keys(own, names).of if own is not None and names is not None else {"": lab.encode()}.get
    with ExitStack() as opened:
        for endpoint in link.zenoh_listen or filter(is_local_endpoint, link.zenoh_connect):
            where = None
            try:
                where = stop_address(endpoint)
                if where is not None:
                    port = StopPort(where, StopReader(key_of, os.urandom), handler, rejections)
                    opened.callback(port.close)
            except OSError as error:
                why = error.strerror if where is None else why_not_bound(error, "udp", where[1][1])
                text = f"no stop by datagram at {endpoint}, the bus alone carries it: {why}"
                report(Event(Severity.WARNING, "ground", text))
        yield


class _Keys:
    """The stop keys in the ground's folder, each read when it is first needed; of known names alone."""

    def __init__(self, own: Path, names: Names) -> None:
        self._own, self._names = own, names
        self._keys: dict[str, bytes] = {}

    def of(self, name: str) -> bytes | None:
        """The key of a name that is not revoked."""
        if name not in self._names.known:
            return None
        if name not in self._keys:
            try:
                self._keys[name] = read_mavlink_key(self._own / stop_key_file(name))
            except ConfigError:
                return None
        return self._keys[name]
