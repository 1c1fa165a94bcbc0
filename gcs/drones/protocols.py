"""The MAVLink protocols that the ground runs with one drone: commands, one in flight at a time, and parameters.

Each is repeated until it is answered, or has been asked often enough. Of a parameter that the autopilot reads only as
it boots, what it reports is not what it flies with until then (`BootParameters`).
"""

import math
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from gcs.drones.autopilot_model import GroundModel
from wire.link_messages import (
    DISARM_IN_FLIGHT,
    Address,
    CommandAck,
    CommandLong,
    MavAutopilot,
    MavCommand,
    ParamRequestRead,
    ParamValue,
    Result,
    command_long,
)
from wire.mavlink.codec import param_from_raw
from wire.mavlink.framing import MavlinkError

COMMAND_RETRY_NS = 250_000_000
URGENT_RETRY_NS = 10_000_000
PROGRESS_NS = 3_000_000_000
COMMAND_TRIES = 8
LATE_ACK_NS = 1_000_000_000  # a later acknowledgement counts as lost: half of the time for which a command is repeated
PARAMETER_RETRY_NS = 400_000_000
PARAMETER_TRIES = 6
PARAMETERS_AT_ONCE = 4


def arm(target: Address) -> CommandLong:
    """Start the motors, if the autopilot agrees."""
    return command_long(target, MavCommand.COMPONENT_ARM_DISARM, 1.0)


def disarm(target: Address) -> CommandLong:
    """Stop the motors of a landed drone."""
    return command_long(target, MavCommand.COMPONENT_ARM_DISARM, 0.0)


def cut(target: Address) -> CommandLong:
    """Stop the motors now, wherever the drone is."""
    return command_long(target, MavCommand.COMPONENT_ARM_DISARM, 0.0, DISARM_IN_FLIGHT)


def land(target: Address) -> CommandLong:
    """Land by itself, where it is."""
    return command_long(target, MavCommand.NAV_LAND)


def request_control(target: Address, ground: Address) -> CommandLong:
    """Follow this ground's setpoints from now on, whoever led it before (MAV_CMD_REQUEST_OPERATOR_CONTROL)."""
    return command_long(target, MavCommand.REQUEST_OPERATOR_CONTROL, float(ground.system), 1.0, 1.0)


def stream(target: Address, message_id: int, rate_hz: float) -> CommandLong:
    """Send us this message at this rate; not at all for zero."""
    interval_us = 1e6 / rate_hz if rate_hz > 0.0 else -1.0
    return command_long(target, MavCommand.SET_MESSAGE_INTERVAL, float(message_id), interval_us)


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer to a command: the drone's result, or None where it never answered."""

    result: Result | None
    t_ns: int

    @property
    def accepted(self) -> bool:
        """Whether the drone took it."""
        return self.result is Result.ACCEPTED

    def __str__(self) -> str:
        return "no answer" if self.result is None else self.result.name.lower().replace("_", " ")


@dataclass(slots=True)
class _Sent:
    """One sending of a command: its number, which start of a command it belongs to, until when its answer may come."""

    number: int
    start: int
    until_ns: int


@dataclass(slots=True)
class CommandChannel:
    """COMMAND_LONG with COMMAND_ACK (MAVLink command protocol). An unanswered command is given up after eight tries.

    An acknowledgement has the command's number and none of its parameters: arming, disarming and the motor cut share
    one, and so do all message intervals. It answers the oldest command of that number that is not answered yet.
    """

    answers: dict[CommandLong, Answer] = field(default_factory=dict)
    urgent_retry_ns: int = URGENT_RETRY_NS
    """How soon what is urgent is repeated."""
    queue: deque[CommandLong] = field(default_factory=deque)
    current: CommandLong | None = None
    """Commands that wait, and the one on its way; without any of them nothing is due."""
    urgent: bool = False
    """Whether that one is urgent: repeated whatever is answered, until `end_urgent`."""
    _tries: int = 0
    _retry_at_ns: int = 0
    _start_count: int = 0
    _sent: deque[_Sent] = field(default_factory=deque)
    """What was sent and not answered, the oldest first."""

    def ask(self, command: CommandLong) -> None:
        """Queue a command unless it is already on its way."""
        if command != self.current and command not in self.queue:
            self.queue.append(command)

    def reset_answer(self, command: CommandLong) -> None:
        """Discard the answer to a command, so that it is sent again."""
        self.answers.pop(command, None)

    def ask_urgently(self, command: CommandLong) -> None:
        """Drop everything for this one, repeated every `urgent_retry_ns`."""
        self.queue.clear()
        if command != self.current:
            self._start(command)
        self.urgent = True

    def end_urgent(self) -> None:
        """End the urgent command: nothing else ends it, no answer either."""
        self.current, self.urgent = None, False

    @property
    def urgent_ns(self) -> int | None:
        """When the urgent command is to be repeated; None where there is none."""
        return self._retry_at_ns if self.urgent else None

    def receive(self, ack: CommandAck, now_ns: int) -> None:
        """The drone's answer to the command in flight, or to one before; answers to others' commands are not ours."""
        sent = next((s for s in self._sent if s.number == ack.command and now_ns <= s.until_ns), None)
        if sent is None:
            return
        in_progress = ack.result is Result.IN_PROGRESS
        if in_progress:
            sent.until_ns = now_ns + PROGRESS_NS
        else:
            self._sent.remove(sent)
        if self.urgent or self.current is None or sent.start != self._start_count:
            return
        if in_progress:
            self._retry_at_ns = now_ns + PROGRESS_NS
        else:
            self._finish(Answer(ack.result, now_ns))

    def due(self, now_ns: int) -> CommandLong | None:
        """The command to send now, if any."""
        over = self._tries >= COMMAND_TRIES and not self.urgent
        if self.current is not None and now_ns >= self._retry_at_ns and over:
            self._finish(Answer(None, now_ns))
        if self.current is None and self.queue:
            self._start(self.queue.popleft())
        if self.current is None or now_ns < self._retry_at_ns:
            return None
        confirmation = min(self._tries, 255)
        self._tries += 1
        self._retry_at_ns = now_ns + (self.urgent_retry_ns if self.urgent else COMMAND_RETRY_NS)
        while self._sent and self._sent[0].until_ns < now_ns:
            self._sent.popleft()
        self._sent.append(_Sent(self.current.command, self._start_count, now_ns + LATE_ACK_NS))
        return replace(self.current, confirmation=confirmation)

    def _start(self, command: CommandLong) -> None:
        self.current, self._tries, self._retry_at_ns, self.urgent = command, 0, 0, False
        self._start_count += 1

    def _finish(self, answer: Answer) -> None:
        if self.current is not None:
            self.answers[self.current] = answer
        self.current, self.urgent = None, False


@dataclass(slots=True)
class _Question:
    tries: int = 0
    asked_ns: int = -PARAMETER_RETRY_NS


@dataclass(slots=True)
class ParameterReader:
    """PARAM_REQUEST_READ by name, four at a time. An autopilot stays silent on a name it does not have."""

    target: Address
    autopilot: MavAutopilot
    values: dict[str, float] = field(default_factory=dict)
    open: dict[str, _Question] = field(default_factory=dict)
    """The questions without an answer yet; without any nothing is due."""

    def ask(self, names: Iterable[str]) -> None:
        """Read these, again if they were read before."""
        self.open.update((name, _Question()) for name in names)

    @property
    def reading(self) -> bool:
        """Whether an answer is still hoped for."""
        return bool(self.open)

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
        known, asked = self.values.get(message.name), message.name in self.open
        if known == value:
            self.open.pop(message.name, None)
            return ""
        if known is not None and armed:
            self.open.pop(message.name, None)
            return f"{message.name} announced anew while armed"
        if not asked:
            if known is not None:
                self.open[message.name] = _Question()
            return "parameter that was not asked for"
        self.values[message.name] = value
        self.open.pop(message.name, None)
        return ""

    def due(self, now_ns: int) -> list[ParamRequestRead]:
        """The requests to send now. A name that has stayed silent through all tries is given up."""
        requests = []
        for name, question in list(self.open.items())[:PARAMETERS_AT_ONCE]:
            if now_ns - question.asked_ns < PARAMETER_RETRY_NS:
                continue
            if question.tries >= PARAMETER_TRIES:
                del self.open[name]
                continue
            question.tries, question.asked_ns = question.tries + 1, now_ns
            requests.append(ParamRequestRead(self.target, name))
        return requests


@dataclass(slots=True)
class BootParameters:
    """One autopilot's: when each was last written, or found not as wanted, on our clock.

    Right by now and not when it booted: a restart is missing. What others write while nobody here looks is not seen.
    """

    back_ns: int | None = None
    """When it was back after a silence in which it may have restarted."""
    _unmet_ns: dict[str, int] = field(default_factory=dict)

    def note_unmet(self, name: str, t_ns: int) -> None:
        """It was written, or found not as wanted, at `t_ns`."""
        self._unmet_ns[name] = max(t_ns, self._unmet_ns.get(name, t_ns))

    def read(self, name: str, value: float, model: GroundModel, now_ns: int) -> None:
        """Its value was read."""
        if name in model.table.read_at_boot and _breaks_rule(name, value, model):
            self.note_unmet(name, now_ns)

    def awaiting(
        self, booted_ns: int | None, values: Mapping[str, float], model: GroundModel | None
    ) -> tuple[str, ...]:  # fmt: skip
        """Those that count from a boot that is still to come; all that were noted where the last boot is not known.

        One that is not as wanted even now is left to its rule.
        """
        return tuple(
            name
            for name, t_ns in self._unmet_ns.items()
            if (booted_ns is None or booted_ns <= t_ns) and not _breaks_rule(name, values.get(name), model)
        )


def _breaks_rule(name: str, value: float | None, model: GroundModel | None) -> bool:
    rules = () if model is None or value is None else model.rules
    return any(rule.name == name and not rule.holds(value) for rule in rules if value is not None)
