"""Reading a drone's parameters: each named one is asked for until it answers or has been asked often enough."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from wire.link_messages.address import Address
from wire.link_messages.parameters import ParamRequestRead, ParamValue
from wire.link_messages.status import MavAutopilot
from wire.mavlink.codec import MavlinkError, param_from_raw

RETRY_NS = 400_000_000
TRIES = 6
AT_ONCE = 4
KEPT = 2048  # autopilots have some 1,500


@dataclass(slots=True)
class _Question:
    tries: int = 0
    asked_ns: int = -RETRY_NS


@dataclass(slots=True)
class ParameterReader:
    """PARAM_REQUEST_READ by name, four at a time. An autopilot stays silent on a name it does not have."""

    target: Address
    autopilot: MavAutopilot
    values: dict[str, float] = field(default_factory=dict)
    _open: dict[str, _Question] = field(default_factory=dict)

    def ask(self, names: Iterable[str]) -> None:
        """Read these, again if they were read before."""
        self._open.update((name, _Question()) for name in names)

    @property
    def reading(self) -> bool:
        """Whether an answer is still hoped for."""
        return bool(self._open)

    def receive(self, message: ParamValue) -> bool:
        """Take a value in, asked for or not (autopilots announce changes).

        False if its bytes are no number, or nobody asked for it and too many are known.
        """
        try:
            value = param_from_raw(message.raw, message.type, self.autopilot)
        except MavlinkError:
            return False
        if message.name not in self._open and message.name not in self.values and len(self.values) >= KEPT:
            return False
        self.values[message.name] = float(value)
        self._open.pop(message.name, None)
        return True

    def due(self, now_ns: int) -> list[ParamRequestRead]:
        """The requests to send now. A name that has stayed silent through all tries is given up."""
        requests = []
        for name, question in list(self._open.items())[:AT_ONCE]:
            if now_ns - question.asked_ns < RETRY_NS:
                continue
            if question.tries >= TRIES:
                del self._open[name]
                continue
            question.tries, question.asked_ns = question.tries + 1, now_ns
            requests.append(ParamRequestRead(self.target, name))
        return requests
