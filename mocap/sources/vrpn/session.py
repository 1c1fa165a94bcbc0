"""VRPN's client: one connection without its sockets, bytes and times in, frames and answers out; then its sockets.

There is one TCP connection, a UDP socket beside it if wanted, and a timer for frames that wait.

Which of the lab's bodies a sender and its sensor are: a tracker each in VRPN, a sensor each at Chingmu.
"""

import asyncio
import socket
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace
from itertools import count
from typing import Protocol

from formation.config import LabConfig
from formation.messages import Severity
from formation.mocap_config import FIRST_SENSOR, ChingmuConfig, VrpnConfig
from formation.model import LONGEST_NAME
from mocap.sources.pose_frames import MOST_BODIES, Assembling, Expiry, Pacing, PoseFrames
from mocap.sources.source import Feed, SourceStatus, seconds
from mocap.sources.tcp import ProtocolError, Session, TcpClient
from mocap.sources.vrpn import messages
from mocap.sources.vrpn.messages import Message, Stream
from wire.text import plain


class Naming(Protocol):
    """One kind of server's."""

    def body(self, sender: str, sensor: int) -> str | None:
        """The body whose poses these are; None where they are no body's."""

    def lack(self, senders: Collection[str], bodies: Collection[str]) -> str:
        """Which of the lab's bodies are missing, in words, given who sends, and whose poses came; "" if none."""


class Trackers:
    """A tracker a body, by its name; further sensors of one tracker are `NAME:SENSOR`."""

    def __init__(self, lab: tuple[str, ...], name: Callable[[str], str]) -> None:
        self._lab = lab
        self._name = name

    def body(self, sender: str, sensor: int) -> str | None:
        """By `[mocap.names]`, else as the server says."""
        return self._name(sender if sensor == 0 else f"{sender}:{sensor}")

    def lack(self, senders: Collection[str], bodies: Collection[str]) -> str:
        """A body that is hidden is there all the same, since its tracker has a name."""
        there = {self._name(sender) for sender in senders}.union(bodies)
        missing = [body for body in self._lab if body not in there]
        if missing:
            return f"the server has no tracker {_list(missing)}; it has {_list(senders)}"
        others = [body for body in bodies if self._is_other_sensor(body, bodies)]
        return f"poses come of {_list(others)}, not of sensor 0: say in [mocap.names] whose they are" if others else ""

    def _is_other_sensor(self, body: str, bodies: Collection[str]) -> bool:
        tracker, numbered, _ = body.rpartition(":")
        return bool(numbered) and tracker in self._lab and tracker not in bodies


class Sensors:
    """One device, whose sensors are bodies: by `names`, the lab's others in their order on the next free numbers."""

    def __init__(self, config: ChingmuConfig, lab: tuple[str, ...], names: dict[str, str]) -> None:
        self._device = config.device
        free = (str(n) for n in count(FIRST_SENSOR) if str(n) not in names)
        unnamed = (body for body in lab if body not in names.values())
        self._bodies = names | dict(zip(free, unnamed, strict=False))
        self._lab = lab

    def body(self, sender: str, sensor: int) -> str | None:
        """Another sensor of the device is a body by its number; what else the server sends is none."""
        return self._bodies.get(str(sensor), str(sensor)) if sender == self._device else None

    def lack(self, senders: Collection[str], bodies: Collection[str]) -> str:
        """A sensor shows itself by its poses only."""
        if self._device not in senders:
            return f"the server has no device {plain(self._device, LONGEST_NAME)}; it has {_list(senders)}"
        numbers = {body: number for number, body in self._bodies.items()}
        missing = [f"{numbers[body]} ({body})" for body in self._lab if body not in bodies]
        there = [number for number, body in self._bodies.items() if body in bodies]
        return f"no poses of sensor {_list(missing)}; those of {_list(there)} come" if missing else ""


def _list(names: Collection[str]) -> str:
    shown = [plain(name, LONGEST_NAME) for name in list(names)[:8]]
    more = len(names) - len(shown)
    return (", ".join(shown) or "none") + (f" and {more} more" if more else "")


PING_NS = 500_000_000
NAMED_NS = 1_000_000_000
"""Delay after the connection before a missing body is reported."""


@dataclass(slots=True)
class SourceState:
    """State that outlives a connection: how frames are numbered and counted, and what was reported to the operator."""

    naming: Naming
    how: Assembling
    lack: str = ""


class VrpnSession:
    """A `tcp.Session`. Poses may come as datagrams, too."""

    def __init__(self, known: SourceState, now_ns: int) -> None:
        self.frames = PoseFrames(known.how)
        self._known = known
        self._feed = known.how.feed
        self._stream = Stream()
        self._cookie = b""
        self._opened_ns = self._pinged_ns = now_ns
        self._senders: dict[int, str] = {}
        self._pose_type: int | None = None
        self._clocks: set[str] = set()
        """Bodies whose trackers' clocks were reported."""

    @property
    def bodies(self) -> tuple[str, ...]:
        """Whose poses have come, by the names of the lab."""
        return self.frames.rows.names

    def received(self, data: bytes, now_ns: int) -> bytes:
        """Take what came over TCP."""
        if len(self._cookie) < messages.COOKIE_BYTES:
            missing = messages.COOKIE_BYTES - len(self._cookie)
            self._cookie, data = self._cookie + data[:missing], data[missing:]
            if len(self._cookie) < messages.COOKIE_BYTES:
                return b""
            messages.check_cookie(self._cookie)
            ping = messages.description(messages.TYPE_DESCRIPTION, 0, messages.PING_TYPE)
            return ping + self.received(data, now_ns) if data else ping
        answer = self._read_messages(data, now_ns)
        self.frames.deliver(now_ns)
        return answer

    def datagrams(self, came: Iterable[bytes], now_ns: int) -> None:
        """Take the poses in them; what cannot be read is refused, and the connection goes on."""
        for data in came:
            stream = Stream()
            try:
                for message in stream.messages(data):
                    if message.type == self._pose_type:
                        self._receive_pose(message, now_ns)
            except ProtocolError as error:
                self._feed.reject(f"datagram: {error}")
            if stream.is_cut:
                self._feed.reject("datagram that ends within a message")
        self.frames.deliver(now_ns)

    def due(self, now_ns: int) -> bytes:
        """Pings, and word of missing bodies."""
        if now_ns - self._pinged_ns < PING_NS:
            return b""
        self._pinged_ns = now_ns
        if self._senders and now_ns - self._opened_ns >= NAMED_NS:
            self._report_lack()
            self._report_clocks()
        control = messages.CONTROL.decode()
        asked = [number for number, name in self._senders.items() if name != control][:4]  # any answer will do
        return b"".join(messages.message(now_ns, number, 0) for number in asked)

    def _read_messages(self, data: bytes, now_ns: int) -> bytes:
        answers = []
        for message in self._stream.messages(data):
            if message.type == self._pose_type:
                self._receive_pose(message, now_ns)
            elif message.type == messages.SENDER_DESCRIPTION:
                answers.append(self._name_sender(message))
            elif message.type == messages.TYPE_DESCRIPTION:
                self._name_type(message)
        return b"".join(answers)

    def _receive_pose(self, message: Message, now_ns: int) -> None:
        _, sender, _, payload = message
        if len(payload) != messages.POSE_BYTES:
            self._feed.reject("pose message of another length than 64 bytes")
            return
        sensor = int.from_bytes(payload[:4], "big", signed=True)
        is_known, row = self.frames.rows.find((sender, sensor))
        if not is_known:
            row = self._new_row(sender, sensor)
        if row is not None:
            self.frames.receive(row, message.stamp_ns, payload[8:], now_ns)

    def _new_row(self, sender: int, sensor: int) -> int | None:
        """The row of what is seen for the first time; None where it is no body."""
        name = self._senders.get(sender)
        if name is None:
            self._feed.reject("pose of a sender that has no name yet")
            return None
        if self.frames.rows.is_full:
            self._feed.reject(f"pose of more than {MOST_BODIES} senders and sensors")
            return None
        return self.frames.rows.add((sender, sensor), self._known.naming.body(name, sensor))

    def _name_sender(self, message: Message) -> bytes:
        """A sender is named, or renamed; the answer names it the same, so that it can be pinged."""
        name, number = messages.described(message.payload), message.sender
        if not 0 <= number < messages.MOST_IDS:
            raise ProtocolError("a sender's number cannot be right")
        text = name.decode("utf-8", "replace")
        if self._senders.get(number) not in (None, text):
            self.frames.begin()  # poses under another name are another body's
        self._senders[number] = text
        return messages.description(messages.SENDER_DESCRIPTION, number, name)

    def _name_type(self, message: Message) -> None:
        if not 0 <= message.sender < messages.MOST_IDS:
            raise ProtocolError("a type's number cannot be right")
        if messages.described(message.payload) == messages.POSE_TYPE:
            self._pose_type = message.sender
        elif message.sender == self._pose_type:
            self._pose_type = None

    def _report_lack(self) -> None:
        """Report missing bodies once, and again when they change."""
        known = self._known
        lack = known.naming.lack(self._named(), self.bodies)
        if lack != known.lack:
            known.lack = lack
            self._feed.report(Severity.WARNING if lack else Severity.INFO, lack or "all bodies of the lab are there")

    def _report_clocks(self) -> None:
        """Report, once, bodies whose trackers' clocks are off."""
        for body, off_s in self.frames.clocks_off():
            if body not in self._clocks:
                self._clocks.add(body)
                text = f"{body}: its tracker's clock is {off_s:+.0f} s from the others', which is corrected; set it"
                self._feed.report(Severity.WARNING, text)

    def _named(self) -> list[str]:
        control = messages.CONTROL.decode()
        return [name for name in self._senders.values() if name != control]


Deliver = Callable[[list[tuple[bytes, str]]], None]


class Datagrams:
    """A bound socket (OSError where there is none to be had); deliver: takes datagrams and their senders' addresses."""

    def __init__(self, deliver: Deliver) -> None:
        self._deliver = deliver
        self._loop = asyncio.get_running_loop()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1_000_000)
        try:
            self._socket.bind(("0.0.0.0", 0))
        except OSError:
            self._socket.close()
            raise
        self._loop.add_reader(self._socket, self._read)

    @property
    def port(self) -> int:
        """Ours."""
        port: int = self._socket.getsockname()[1]
        return port

    def close(self) -> None:
        """Hear no more."""
        self._loop.remove_reader(self._socket)
        self._socket.close()

    def _read(self) -> None:
        came: list[tuple[bytes, str]] = []
        while len(came) < 64:
            try:
                data, address = self._socket.recvfrom(65_535)
            except OSError:  # nothing waits
                break
            came.append((data, address[0]))
        if came:
            self._deliver(came)


def vrpn_source(config: LabConfig, feed: Feed) -> "VrpnSource":
    """Source `vrpn`, and NOKOV's, which is no other."""
    server = (config.mocap.nokov if config.mocap.source == "nokov" else config.mocap.vrpn) or VrpnConfig()
    return VrpnSource(server, server.udp, _knowledge(config, Trackers(_bodies(config), feed.name), feed))


def chingmu_source(config: LabConfig, feed: Feed) -> "VrpnSource":
    """Source `chingmu`."""
    server = config.mocap.chingmu or ChingmuConfig()
    naming = Sensors(server, _bodies(config), config.mocap.names)
    return VrpnSource(server, False, _knowledge(config, naming, feed))


def _bodies(config: LabConfig) -> tuple[str, ...]:
    return tuple(vehicle.body for vehicle in config.vehicles)


def _knowledge(config: LabConfig, naming: Naming, feed: Feed) -> SourceState:
    how = Assembling(
        feed=feed,
        pacing=Pacing(1e9 / config.mocap.rate_hz),
        assemble_ns=config.mocap.assemble_ns,
        latency_ns=round(config.mocap.constant_latency_s * 1e9),
        repeats_are_lost=config.mocap.repeats_are_lost,
    )
    return SourceState(naming, how)


class VrpnSource:
    """A `Source`."""

    def __init__(self, server: VrpnConfig | ChingmuConfig, udp: bool, known: SourceState) -> None:
        self._known = known
        self._udp = udp
        self._receiver: Datagrams | None = None
        self._session: _TimedSession | None = None
        self._status = SourceStatus(server=f"{server.host}:{server.port}")
        self._client = TcpClient(server.host, server.port, self, known.how.feed)

    async def run(self) -> None:
        """Take frames until cancelled."""
        try:
            if self._udp:
                self._receiver = Datagrams(self.datagrams)
            await self._client.run()
        finally:
            if self._receiver is not None:
                self._receiver.close()

    def status(self) -> SourceStatus:
        """How it is doing."""
        lost, session = self._known.how.pacing.lost, self._session
        status = replace(self._status, connected=self._client.connected, lost=lost)
        if session is None:
            return status
        uncertainty_ns = session.vrpn.frames.uncertainty_ns(self._known.how.feed.clock.monotonic_ns())
        return replace(
            status,
            latency_s=seconds(session.vrpn.frames.latency_ns),
            uncertainty_s=seconds(uncertainty_ns),
            bodies=session.vrpn.bodies,
        )

    def open(self, now_ns: int, ours: str, theirs: str) -> tuple[Session, bytes]:
        """A new connection's session and cookie; where datagrams are to go, if they are wanted."""
        if self._session is not None:
            self._session.expiry.cancel()
        hello = messages.COOKIE
        if self._receiver is not None:
            hello += messages.udp_description(ours, self._receiver.port)
        self._session = _TimedSession(VrpnSession(self._known, now_ns), self._known.how.feed, theirs)
        return self._session, hello

    def datagrams(self, came: list[tuple[bytes, str]]) -> None:
        """From the server that we are connected to; others are not heard."""
        session = self._session
        server = session.server if session is not None else ""
        theirs = [data for data, sender in came if sender == server]
        if len(theirs) < len(came):
            self._known.how.feed.reject("datagram of somebody else", len(came) - len(theirs))
        if session is not None and theirs:
            session.datagrams(theirs)


class _TimedSession:
    """A session that is woken when a frame has waited long enough."""

    def __init__(self, vrpn: VrpnSession, feed: Feed, server: str) -> None:
        self.vrpn = vrpn
        self.server = server
        self.expiry = Expiry(vrpn.frames, feed.clock)
        self._feed = feed

    def received(self, data: bytes, now_ns: int) -> bytes:
        answer = self.vrpn.received(data, now_ns)
        self.expiry.set()
        return answer

    def due(self, now_ns: int) -> bytes:
        return self.vrpn.due(now_ns)

    def datagrams(self, came: list[bytes]) -> None:
        self.vrpn.datagrams(came, self._feed.clock.monotonic_ns())
        self.expiry.set()
