"""The client's side of NatNet: the session without its sockets, then the client with them.

The session takes packets and times; it hands frames to the feed, and says what to send. The client has one socket for
commands and the frames of a unicast server, and one for multicast, or port 1511. Nothing that is sent here moves
Motive's playback or changes what it streams.
"""

import asyncio
import contextlib
import socket
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from formation.config import LabConfig
from formation.messages import RawFrame, Severity
from formation.mocap_config import NatNetConfig
from mocap.capture_time import CaptureTime
from mocap.retiming import FrameOrder
from mocap.sources.natnet import packets
from mocap.sources.natnet.packets import (
    BodyFlag,
    Frame,
    FrameFlag,
    MessageId,
    Named,
    PacketError,
    ServerInfo,
    Version,
    frame_of_data,
    rigid_bodies,
)
from mocap.sources.poses import from_quaternions
from mocap.sources.source import Feed, SourceStatus, seconds
from wire.process.port_holder import why_not_bound

WHO = "mavlink-formation"
CONNECT_NS, SILENT_NS = 500_000_000, 2_000_000_000
STEP_NS = 2_000_000
"""A larger difference between an echo and the clock offset shows that the server's clock was set."""


class NatNetSession:
    """One source's conversation with its server, over all restarts of either.

    wanted: the lab's bodies, to name those that the server lacks. latency_ns: from exposure to receipt, used where the
    cameras do not report exposures.
    """

    def __init__(self, config: NatNetConfig, latency_ns: int, wanted: Sequence[str], feed: Feed) -> None:
        self._config = config
        self._latency_ns = latency_ns
        self._wanted = tuple(wanted)
        self._feed = feed
        self._reported: dict[str, str] = {}
        self._info: ServerInfo | None = None
        self._version: Version = packets.OLDEST
        self._peer = ""
        self._streamer = ""
        self._names: dict[int, str] | None = None
        self._shared: dict[int, list[str]] = {}
        """Streaming ids that several bodies have."""
        self._order: tuple[bytes, tuple[str, ...], list[int]] = (b"", (), [])
        self._numbers = FrameOrder()
        self._capture = CaptureTime(latency_ns)
        self._echoes: deque[int] = deque(maxlen=32)  # so many may be on their way
        self._status = SourceStatus(server=f"{config.host}:{config.command_port}")
        self._sent: dict[MessageId, int] = {}
        self._received_ns = self._frame_ns = self._since_ns = 0
        self._alone_ns = 0
        self._newest: tuple[int, int, bool] | None = None
        self._unread_ns: int | None = None
        self._stale_ns: int | None = None

    def start(self, now_ns: int) -> None:
        """Sockets are open (again)."""
        self._received_ns = self._frame_ns = self._alone_ns = now_ns
        self._sent.clear()

    def is_silent(self, now_ns: int) -> bool:
        """Whether nothing at all has come for 2 s."""
        return now_ns - self._received_ns > SILENT_NS

    def status(self) -> SourceStatus:
        """How it is doing."""
        if self._newest is None:
            return self._status
        now_ns, capture_ns, is_stamped = self._newest
        uncertainty_ns = self._capture.uncertainty_ns(now_ns) if is_stamped else None
        return replace(
            self._status,
            lost=self._numbers.lost,
            latency_s=seconds(now_ns - capture_ns),
            uncertainty_s=seconds(uncertainty_ns),
            latency_measured=is_stamped and self._capture.offset_ns(now_ns) is not None,
        )

    def due(self, now_ns: int) -> list[bytes]:
        """The packets to send to the server's command port now; to be asked every 25 ms or so."""
        self._watch(now_ns)
        out = []
        if self._is_unsure(now_ns) and self._is_due(MessageId.CONNECT, CONNECT_NS, now_ns):
            out += [packets.hello(MessageId.CONNECT, WHO)]
        if self._info is None:
            return out
        if self._stale_ns is not None and self._is_due(MessageId.REQUEST_MODELS, 200_000_000, now_ns):
            out += [
                packets.packet(MessageId.REQUEST, packets.WHICH_VERSION),
                packets.packet(MessageId.REQUEST_MODELS),
            ]
        if not self._config.multicast and self._is_due(MessageId.KEEP_ALIVE, 1_000_000_000, now_ns):
            out += [packets.packet(MessageId.KEEP_ALIVE)]
        often = now_ns - self._since_ns < 2_000_000_000
        if self._is_due(MessageId.ECHO_REQUEST, 50_000_000 if often else 100_000_000, now_ns):
            self._echoes.append(now_ns)
            out += [packets.echo_request(now_ns)]
        return out

    def _is_unsure(self, now_ns: int) -> bool:
        """Whether to ask the server who it is: frames are missing, or its list (in another version than believed)."""
        waited = self._stale_ns is not None and now_ns - self._stale_ns >= CONNECT_NS
        return self._info is None or self._names is None or waited or now_ns - self._frame_ns >= CONNECT_NS

    def received(self, data: bytes, sender: str, now_ns: int) -> None:
        """Receive a packet from an address. An unreadable packet is rejected and counted, and changes nothing."""
        try:
            self._receive(*packets.unpack(data), sender, now_ns)
        except PacketError as error:
            self._feed.reject(str(error))

    def _receive(self, message: int, payload: bytes, sender: str, now_ns: int) -> None:
        if message == MessageId.FRAME:
            self._receive_frame(payload, sender, now_ns)
        elif message == MessageId.SERVER_INFO:
            self._greet(packets.server_info(payload), sender, now_ns)
        elif sender != self._peer:
            self._feed.reject("a message of another sender than the server")
        elif message == MessageId.MODELS:
            self._received_ns = now_ns
            self._receive_models(rigid_bodies(payload, self._version))
        elif message == MessageId.ECHO_RESPONSE:
            self._received_ns = now_ns
            self._receive_echo(*packets.echo_response(payload), now_ns)
        elif message == MessageId.RESPONSE:
            version = packets.stream_version(payload)
            if version is not None:
                self._speak(version, now_ns)

    def _greet(self, info: ServerInfo, sender: str, now_ns: int) -> None:
        if self._info is not None and sender != self._peer:
            self._feed.reject("server info of another sender than the server")
            return
        if self._info is None:
            self._frame_ns = now_ns
        if self._info is None or info != self._info:
            self._since_ns = now_ns
            self._capture = CaptureTime(self._latency_ns)
            self._names = None  # ids may mean others now
        self._received_ns, self._stale_ns = now_ns, now_ns
        self._info, self._peer = info, sender
        self._status = replace(self._status, server=info.text, connected=True)
        self._speak(info.version, now_ns)
        self._report("server", Severity.INFO, f"connected to {info.text} at {sender}")

    def _speak(self, version: Version, now_ns: int) -> None:
        """Frames and models come in this version from now on."""
        if version != self._version:
            self._version, self._stale_ns = version, now_ns
        if version > packets.NEWEST:
            self._report(
                "version",
                Severity.ERROR,
                f"the server streams NatNet {version[0]}.{version[1]}, which is not known (3.0 to 4.2 are): not read",
            )

    def _receive_models(self, theirs: Named) -> None:
        """The newest list; asked for again where the change that it was asked for is newer than the question.

        Bodies that share an id are one in a frame: they are left out.
        """
        if self._stale_ns is not None and self._sent.get(MessageId.REQUEST_MODELS, 0) >= self._stale_ns:
            self._stale_ns = None
        sharing: dict[int, list[str]] = {}
        for number, name in theirs:
            sharing.setdefault(number, []).append(self._feed.name(name))
        names = {number: bodies[0] for number, bodies in sharing.items() if len(bodies) == 1}
        shared = {number: bodies for number, bodies in sharing.items() if len(bodies) > 1}
        if names == self._names and shared == self._shared:
            return
        self._names, self._shared, self._order = names, shared, (b"", (), [])
        self._status = replace(self._status, bodies=tuple(names.values()))
        texts = [f"rigid bodies {' and '.join(bodies)} have one streaming id ({k})" for k, bodies in shared.items()]
        cure = "they are left out, give each an id of its own in Motive"
        self._report("ids", Severity.ERROR, f"{'; '.join(texts)}: {cure}" if texts else "")
        listed = ", ".join(body for bodies in sharing.values() for body in bodies) or "none"
        missing = [body for body in self._wanted if not any(body in bodies for bodies in sharing.values())]
        if missing:
            what = "bodies" if len(missing) > 1 else "body"
            text = f"{what} {', '.join(missing)} not in the server's list, which is: {listed}"
            self._report("bodies", Severity.WARNING, text)
        else:
            self._report("bodies", Severity.INFO, f"rigid bodies: {listed}")

    def _receive_echo(self, sent_ns: int, ticks: int, now_ns: int) -> None:
        if sent_ns not in self._echoes:
            self._feed.reject("echo response: to no request of ours, or a second time")
            return
        self._echoes.remove(sent_ns)
        if self._info is None:
            return
        theirs_ns = ticks * 1_000_000_000 // self._info.clock_hz
        offset_ns = self._capture.offset_ns(now_ns)
        doubt_ns = STEP_NS + (self._capture.uncertainty_ns(now_ns) or 0)
        # The answer was given after the request and before it came: whatever the delays, that bounds the offset.
        if offset_ns is not None and not sent_ns - doubt_ns <= theirs_ns + offset_ns <= now_ns + doubt_ns:
            self._capture, self._since_ns = CaptureTime(self._latency_ns), now_ns
            self._feed.report(Severity.WARNING, "the server's clock was set")
        self._capture.exchange(sent_ns, theirs_ns, now_ns)

    def _receive_frame(self, payload: bytes, sender: str, now_ns: int) -> None:
        came_ns = now_ns - self._frame_ns  # from another address only where the one has been silent for a second
        if sender not in (self._streamer, self._peer) and came_ns < 1_000_000_000 and self._streamer:
            self._feed.reject("a frame of another sender than the server")
            return
        if self._info is None:
            self._note_frame(sender, now_ns)
            if now_ns - self._alone_ns > SILENT_NS:
                self._report(
                    "server", Severity.WARNING, f"frames come from {sender}, but {self._asked} does not answer"
                )
            return
        if self._version > packets.NEWEST:
            self._feed.reject("a frame of an unknown version")
            return
        try:
            frame = frame_of_data(payload, self._version)
        except PacketError:
            self._unread_ns = now_ns
            raise
        self._note_frame(sender, now_ns)
        step = self._numbers.receive(frame.number)
        if step is None:
            self._feed.reject("a frame out of order")
            return
        if step == 0:  # another server, or the same one started again: its ids may mean others
            self._names = None
        changed = frame.params & (FrameFlag.MODELS_CHANGED | FrameFlag.VERSION_CHANGED)
        if changed or step != 1:  # what was skipped may have said so
            self._stale_ns = now_ns
        self._report(
            "mode", Severity.WARNING, "plays a recording (Edit mode)" if frame.params & FrameFlag.EDITED else ""
        )
        if self._names is not None:
            self._deliver(frame, self._names, now_ns)

    def _note_frame(self, sender: str, now_ns: int) -> None:
        self._streamer, self._received_ns, self._frame_ns = sender, now_ns, now_ns

    def _deliver(self, frame: Frame, names: dict[int, str], now_ns: int) -> None:
        ids = frame.bodies["id"].tobytes()
        if ids != self._order[0]:
            rows = [k for k, number in enumerate(frame.bodies["id"].tolist()) if number in names]
            self._order = ids, tuple(names[int(frame.bodies["id"][k])] for k in rows), rows
            known = names.keys() | self._shared.keys()
            if not known >= set(frame.bodies["id"].tolist()):  # a body that is new
                self._stale_ns = now_ns
        _, bodies, rows = self._order
        table = frame.bodies[rows] if len(rows) < len(frame.bodies) else frame.bodies
        capture_ns = self._capture_ns(frame.exposure_ticks, now_ns)
        self._newest = now_ns, capture_ns, frame.exposure_ticks != 0
        pos_m, q = from_quaternions(table["pose"], self._feed.unit_m)
        seen = (table["params"] & BodyFlag.TRACKED) != 0
        self._feed.deliver(RawFrame(frame.number, capture_ns, bodies, pos_m, q, seen))

    def _capture_ns(self, ticks: int, now_ns: int) -> int:
        """The middle of the exposure on our clock; without a valid stamp, arrival less latency."""
        if ticks and self._info is not None:
            capture_ns = self._capture.capture_ns(ticks * 1_000_000_000 // self._info.clock_hz, now_ns)
            if now_ns - capture_ns < 1_000_000_000:  # else the clock was set: the next echo corrects the offset
                return capture_ns
        return now_ns - self._latency_ns

    def _watch(self, now_ns: int) -> None:
        """Report silence once."""
        if self.is_silent(now_ns):
            self._info, self._alone_ns = None, now_ns
            self._status = replace(self._status, connected=False)
            self._report("server", Severity.WARNING, f"no answer from {self._asked} for 2 s; trying again")
        elif self._info is not None and now_ns - self._frame_ns > SILENT_NS:
            self._report(
                "server", Severity.WARNING, f"{self._info.text} answers, but sends no frames: {self._hint(now_ns)}"
            )
        elif self._info is not None:
            self._report("server", Severity.INFO, f"connected to {self._info.text} at {self._peer}")

    def _hint(self, now_ns: int) -> str:
        """The most likely cause where a server answers and no frame comes."""
        if self._unread_ns is not None and now_ns - self._unread_ns < SILENT_NS:
            return f"what comes cannot be read as NatNet {self._version[0]}.{self._version[1]}"
        ours, theirs = self._config.multicast or None, self._info.multicast if self._info else None
        if ours != theirs:
            return f"it streams {_transmission(theirs)}, the lab file says {_transmission(ours)}"
        if ours is None:
            return "is streaming on, and does a firewall let its packets in?"
        return "is streaming on, and is `interface` our address in the cameras' network?"

    @property
    def _asked(self) -> str:
        return f"{self._config.host}:{self._config.command_port}"

    def _report(self, subject: str, severity: Severity, text: str) -> None:
        """Report once, until the text of the subject changes."""
        if text != self._reported.get(subject, ""):
            self._reported[subject] = text
            if text:
                self._feed.report(severity, text)

    def _is_due(self, message: MessageId, every_ns: int, now_ns: int) -> bool:
        if now_ns - self._sent.get(message, now_ns - every_ns) < every_ns:
            return False
        self._sent[message] = now_ns
        return True


def _transmission(group: str | None) -> str:
    return "unicast" if group is None else f"multicast to {group}"


ANY = "0.0.0.0"


class NatNet:
    """Motive as a source. It reopens its sockets when the server is silent, to find a network that was away."""

    def __init__(self, config: LabConfig, feed: Feed) -> None:
        self._config = config.mocap.natnet or NatNetConfig()
        self._feed = feed
        self._reported = ""
        latency_ns = round(config.mocap.constant_latency_s * 1e9)
        self._session = NatNetSession(self._config, latency_ns, [v.body for v in config.vehicles], feed)

    def status(self) -> SourceStatus:
        """How it is doing."""
        return self._session.status()

    async def run(self) -> None:
        """Run until cancelled. A network that cannot be used is reported once, and tried again."""
        clock = self._feed.clock
        while True:
            try:
                await self._converse()
            except OSError as error:
                self._report(f"{self._config.host}: {error.strerror or 'cannot be reached'}; trying again")
            await clock.sleep_until_ns(clock.monotonic_ns() + 500_000_000)

    async def _converse(self) -> None:
        """Until the server has been silent. OSError where name, interface or port cannot be used."""
        clock, session = self._feed.clock, self._session
        address = await _resolve(self._config.host)
        with open_sockets(self._config, address, self._report) as (command, *others), self._reading(command, *others):
            self._reported = "" if others else self._reported
            session.start(clock.monotonic_ns())
            while True:
                now_ns = clock.monotonic_ns()
                for data in session.due(now_ns):
                    with contextlib.suppress(OSError):  # no route for now; the silence is reported
                        command.sendto(data, (address, self._config.command_port))
                if session.is_silent(now_ns):
                    return
                await clock.sleep_until_ns(now_ns + 25_000_000)

    @contextlib.contextmanager
    def _reading(self, *sockets: socket.socket) -> Iterator[None]:
        loop, buffer = asyncio.get_running_loop(), memoryview(bytearray(65_536))
        for each in sockets:
            loop.add_reader(each, self._read, each, buffer)
        try:
            yield
        finally:
            for each in sockets:
                loop.remove_reader(each)

    def _read(self, ready: socket.socket, buffer: memoryview) -> None:
        """One packet; where more wait, the loop calls again, everybody else's turn having come first."""
        try:
            size, sender = ready.recvfrom_into(buffer)
        except OSError:  # an ICMP answer to something sent earlier
            return
        self._session.received(bytes(buffer[:size]), sender[0], self._feed.clock.monotonic_ns())

    def _report(self, text: str) -> None:
        if text != self._reported:
            self._reported = text
            self._feed.report(Severity.WARNING, text)


async def _resolve(host: str) -> str:
    try:
        async with asyncio.timeout(2.0):
            found = await asyncio.get_running_loop().getaddrinfo(host, None, family=socket.AF_INET)
    except TimeoutError as error:
        raise OSError(0, "its name is not resolved") from error
    return str(found[0][4][0])


@contextlib.contextmanager
def open_sockets(config: NatNetConfig, address: str, report: Callable[[str], None]) -> Iterator[list[socket.socket]]:
    """The command socket, then the one for data. OSError, in words, where one cannot be had."""
    with contextlib.ExitStack() as stack:
        command = stack.enter_context(_udp())
        _bind(command, (config.interface, 0))
        sockets = [command]
        data = stack.enter_context(_udp())
        if config.multicast:
            data.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            _bind(data, (config.multicast, config.data_port))
            _join(data, config, address)
            sockets.append(data)
        else:
            try:
                data.bind((config.interface, config.data_port))
                sockets.append(data)
            except OSError as error:  # a server on this machine has it: then it sends to the command socket
                why = why_not_bound(error, "udp", config.data_port)
                report(f"UDP port {config.data_port} of the cameras' data: {why}; heard where the server answers alone")
        yield sockets


def _udp() -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.setblocking(False)
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)  # while we are busy; as far as the system allows
    return opened


def _bind(opened: socket.socket, to: tuple[str, int]) -> None:
    try:
        opened.bind(to)
    except OSError as error:
        raise OSError(error.errno, f"{to[0]} port {to[1]}: {why_not_bound(error, 'udp', to[1])}") from error


def _join(data: socket.socket, config: NatNetConfig, address: str) -> None:
    """The group on our interface; where none is named, on the one that leads to the server, and on the system's own."""
    interfaces = [config.interface] if config.interface != ANY else [*_toward(address), ANY]
    failed: OSError | None = None
    joined = False
    for interface in dict.fromkeys(interfaces):
        try:
            group = socket.inet_aton(config.multicast) + socket.inet_aton(interface)
            data.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
            joined = True
        except OSError as error:
            failed = OSError(error.errno, f"group {config.multicast} on {interface}: {error.strerror or error}")
    if failed is not None and not joined:
        raise failed


def _toward(address: str) -> list[str]:
    """Our address on the way there."""
    with _udp() as probe, contextlib.suppress(OSError):
        probe.connect((address, 9))
        return [probe.getsockname()[0]]
    return []
