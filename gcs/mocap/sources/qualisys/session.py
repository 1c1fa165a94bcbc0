"""One connection to QTM: version, names, stream; the names again when they change. Sans-IO, time an argument."""

from collections.abc import Callable

from qtm_rt.packet import QRTEvent, QRTPacketType

from formation.messages import Severity
from gcs.mocap.sources.qualisys.packets import HEADER, SixD, Stream, bodies_of, names_of, text_of
from gcs.mocap.sources.source import Feed
from gcs.mocap.sources.tcp import ProtocolError

VERSION = "1.19"
"""The oldest in wide use; QTM serves every older one too."""
WELCOME = "QTM RT Interface connected"
ANSWER_NS = 2_000_000_000
AGAIN_NS, SOON_NS = 1_000_000_000, 100_000_000
"""So often the names are asked for, lest a renamed body is told of by no event, or QTM has gone silent."""
MOST_TOLD = 8
RENAMING = (QRTEvent.EventCameraSettingsChanged, QRTEvent.EventConnected, QRTEvent.EventRTfromFileStarted)
SHUTTING_DOWN = QRTEvent.EventQTMShuttingDown


def command(text: str) -> bytes:
    """A command's packet."""
    data = text.encode() + b"\0"
    return HEADER.pack(HEADER.size + len(data), QRTPacketType.PacketCommand.value) + data


class QualisysSession:
    """Frames go to `deliver` once `named` has been told their names, none while QTM is asked for them anew."""

    def __init__(
        self,
        deliver: Callable[[SixD, int], None],
        named: Callable[[tuple[str, ...]], None],
        feed: Feed,
        now_ns: int,
    ) -> None:
        self._deliver = deliver
        self._named = named
        self._feed = feed
        self._stream = Stream()
        self._names: tuple[str, ...] | None = None
        self._version = self._streaming = self._idle = False
        self._opened_ns = self._asked_ns = now_ns
        self._told: set[str] = set()

    def received(self, data: bytes, now_ns: int) -> bytes:
        """Take the next bytes; what to answer. ProtocolError where the connection cannot go on."""
        return b"".join(self._packet(kind, packet, now_ns) for kind, packet in self._stream.take(data))

    def due(self, now_ns: int) -> bytes:
        """The names again, once a second. ProtocolError where QTM answers nothing that is of use."""
        if self._version:
            return self._ask(now_ns) if now_ns - self._asked_ns >= AGAIN_NS else b""
        if now_ns - self._opened_ns > ANSWER_NS:
            raise ProtocolError("no answer to the version asked for")
        return b""

    def _packet(self, kind: QRTPacketType, packet: bytes, now_ns: int) -> bytes:
        match kind:
            case QRTPacketType.PacketData:
                return self._frame(packet, now_ns)
            case QRTPacketType.PacketXML:
                return self._parameters(text_of(packet))
            case QRTPacketType.PacketCommand | QRTPacketType.PacketError:
                return self._answer(text_of(packet), now_ns)
            case QRTPacketType.PacketEvent:
                return self._event(packet, now_ns)
            case QRTPacketType.PacketNoMoreData:
                self._rest()
        return b""

    def _answer(self, text: str, now_ns: int) -> bytes:
        if text.startswith(WELCOME):
            return command(f"Version {VERSION}")
        if text.startswith("Version set to"):
            self._version = True
            return self._ask(now_ns)
        if "NOT supported" in text:
            raise ProtocolError(f"QTM does not know version {VERSION} of its protocol: update QTM")
        if text.startswith("Connection refused"):
            raise ProtocolError("QTM has as many clients as it takes")
        if text.startswith("Parameters not available"):
            return self._take_names(())
        self._feed.refuse("an answer that was not expected")
        if text not in self._told and len(self._told) < MOST_TOLD:
            self._told.add(text)
            self._feed.say(Severity.WARNING, f"QTM says: {text}")
        return b""

    def _parameters(self, text: str) -> bytes:
        try:
            return self._take_names(names_of(text))
        except ValueError as error:
            self._feed.refuse(str(error))
            return b""

    def _take_names(self, names: tuple[str, ...]) -> bytes:
        self._names = names
        self._named(names)
        if self._streaming:
            return b""
        self._streaming = True
        return command("StreamFrames AllFrames 6D")

    def _event(self, packet: bytes, now_ns: int) -> bytes:
        if packet[:1] == bytes([SHUTTING_DOWN.value]):
            self._feed.say(Severity.WARNING, "QTM is shutting down")
        if self._version and packet[:1] in [bytes([event.value]) for event in RENAMING]:
            self._names = None  # an index may mean another body now
            return self._ask(now_ns)
        return b""

    def _rest(self) -> None:
        if not self._idle:
            self._idle = True
            self._feed.say(Severity.WARNING, "QTM measures nothing: start a measurement or its real-time preview")

    def _ask(self, now_ns: int) -> bytes:
        self._asked_ns = now_ns
        return command("GetParameters 6D")

    def _frame(self, packet: bytes, now_ns: int) -> bytes:
        try:
            frame = bodies_of(packet)
        except ValueError as error:
            self._feed.refuse(str(error))
            return b""
        if frame is None:
            self._feed.refuse("data packet: no 6D component")
        elif self._names is None:
            self._feed.refuse("a frame while the bodies' names are asked for")
        elif len(self._names) != len(frame.rows):
            self._feed.refuse("a frame of more or fewer bodies than are named")
            self._names = None
            return self._ask(now_ns) if now_ns - self._asked_ns > SOON_NS else b""
        else:
            self._idle = False
            self._deliver(frame, now_ns)
        return b""
