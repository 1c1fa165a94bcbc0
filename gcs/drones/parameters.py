"""Reading a drone's parameters: each named one is asked for until it answers or has been asked often enough."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

from wire.link_messages.address import Address
from wire.link_messages.parameters import ParamRequestRead, ParamValue
from wire.link_messages.status import MavAutopilot
from wire.mavlink.codec import MavlinkError, param_from_raw

RETRY_NS = 400_000_000
TRIES = 6
AT_ONCE = 4


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

    def receive(self, message: ParamValue, armed: bool) -> str:
        """Take a value in: why not, or the empty text where it is known now.

        Only an answer is taken. While armed, what is known does not change; before, an announced change of a known
        parameter is asked for.
        """
        try:
            value = float(param_from_raw(message.raw, message.type, self.autopilot))
        except MavlinkError:
            return "parameter whose bytes are no value"
        if not math.isfinite(value):
            return "parameter that is not finite"
        known, asked = self.values.get(message.name), message.name in self._open
        if known == value:
            self._open.pop(message.name, None)
            return ""
        if known is not None and armed:
            self._open.pop(message.name, None)
            return f"{message.name} announced anew while armed"
        if not asked:
            if known is not None:
                self._open[message.name] = _Question()
            return "parameter that was not asked for"
        self.values[message.name] = value
        self._open.pop(message.name, None)
        return ""

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
