"""Asks an autopilot for its version, signed and unsigned: does it demand signatures? Pure; time is an argument."""

from dataclasses import dataclass

from wire.link_messages import (
    DRONE_COMPONENT,
    GROUND,
    Address,
    CommandAck,
    Heartbeat,
    MavAutopilot,
    MavCommand,
    MavState,
    MavType,
    MessageId,
    command_long,
)
from wire.mavlink.codec import Codec
from wire.mavlink.framing import FrameCutter
from wire.mavlink.signing import SigningChannel

ASKS = (True, True, True, False, False, False)
"""Whether each command is signed. Signed ones come first: an answer that is late counts against the autopilot."""
ASK_S = 0.5
"""How long an answer is awaited."""
_BEAT = Heartbeat(MavAutopilot.INVALID, MavType.GCS, 0, 0, MavState.ACTIVE)


@dataclass(frozen=True, slots=True)
class ProbeOutcome:
    """An autopilot's answers: whether anything came, which make, how many there were.

    signed_answers: to signed commands, signed themselves. unsigned_answers: to unsigned commands, of either kind.
    """

    received: bool = False
    autopilot: MavAutopilot | None = None
    signed_answers: int = 0
    unsigned_answers: int = 0

    @property
    def has_key(self) -> bool:
        """Whether it has the key of this end: it answers what is signed with it, and signs its answer."""
        return self.signed_answers > 0

    @property
    def demands_signatures(self) -> bool:
        """Whether it answered signed commands, and none that was not."""
        return self.has_key and self.unsigned_answers == 0


class SigningProbe:
    """One autopilot: send what `beat` and `ask` return, hand over what arrives, read the outcome."""

    def __init__(self, sysid: int, channel: SigningChannel) -> None:
        self.sysid = sysid
        self._channel = channel
        self._codec, self._cutter = Codec(GROUND), FrameCutter(stream=True)
        self._asks_signed = True
        self._received = False
        self._autopilot: MavAutopilot | None = None
        self._answers = {True: 0, False: 0}

    def beat(self, unix_us: int, *, signed: bool) -> bytes:
        """A ground's heartbeat: autopilots begin to speak on a line where they hear one."""
        return self._sealed(self._codec.encode(_BEAT), unix_us, signed=signed)

    def ask(self, unix_us: int, *, signed: bool) -> bytes:
        """A command that moves nothing: REQUEST_MESSAGE for AUTOPILOT_VERSION. What is answered now answers it."""
        self._asks_signed = signed
        target = Address(self.sysid, DRONE_COMPONENT)
        command = command_long(target, MavCommand.REQUEST_MESSAGE, float(MessageId.AUTOPILOT_VERSION))
        return self._sealed(self._codec.encode(command), unix_us, signed=signed)

    def receive(self, data: bytes, unix_us: int) -> None:
        """Bytes of the link, cut anywhere."""
        for frame in self._cutter.cut(data):
            if frame.source.system != self.sysid:
                continue
            self._received = True
            verified = bool(self._channel.verify(frame.data, unix_us).data)
            for packet in self._codec.receive(frame.data):
                message = packet.message
                if isinstance(message, Heartbeat) and packet.source.component == DRONE_COMPONENT:
                    self._autopilot = message.autopilot
                elif isinstance(message, CommandAck) and message.command == MavCommand.REQUEST_MESSAGE:
                    self._answers[self._asks_signed] += verified or not self._asks_signed

    @property
    def outcome(self) -> ProbeOutcome:
        """The outcome so far."""
        return ProbeOutcome(self._received, self._autopilot, self._answers[True], self._answers[False])

    def _sealed(self, data: bytes, unix_us: int, *, signed: bool) -> bytes:
        return self._channel.sign(data, unix_us) if signed else data
