"""Commands to one drone: those the ground gives, one in flight at a time, repeated until answered."""

from collections import deque
from dataclasses import dataclass, field, replace

from wire.link_messages.address import Address
from wire.link_messages.commands import DISARM_IN_FLIGHT, CommandAck, CommandLong, MavCommand, Result, command_long

RETRY_NS = 250_000_000
URGENT_RETRY_NS = 10_000_000
PROGRESS_NS = 3_000_000_000
TRIES = 8


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
    """What became of a command: the drone's result, or None where it never answered."""

    result: Result | None
    t_ns: int

    @property
    def accepted(self) -> bool:
        """Whether the drone took it."""
        return self.result is Result.ACCEPTED

    def __str__(self) -> str:
        return "no answer" if self.result is None else self.result.name.lower().replace("_", " ")


@dataclass(slots=True)
class CommandChannel:
    """COMMAND_LONG with COMMAND_ACK (MAVLink command protocol). An unanswered command is given up after eight tries."""

    answers: dict[CommandLong, Answer] = field(default_factory=dict)
    urgent_retry_ns: int = URGENT_RETRY_NS
    """How soon what is urgent is repeated."""
    _waiting: deque[CommandLong] = field(default_factory=deque)
    _current: CommandLong | None = None
    _tries: int = 0
    _retry_at_ns: int = 0
    _urgent: bool = False

    def ask(self, command: CommandLong) -> None:
        """Queue a command unless it is already on its way."""
        if command != self._current and command not in self._waiting:
            self._waiting.append(command)

    def forget(self, command: CommandLong) -> None:
        """It is to be asked anew: an answer to it from before counts no more."""
        self.answers.pop(command, None)

    def urge(self, command: CommandLong) -> None:
        """Drop everything for this one, repeated every `urgent_retry_ns`."""
        self._waiting.clear()
        if command != self._current:
            self._start(command)
        self._urgent = True

    def calm(self) -> None:
        """What was urgent is done, whether or not it was answered."""
        if self._urgent:
            self._current, self._urgent = None, False

    @property
    def urgent_ns(self) -> int | None:
        """When the urgent command is to be repeated; None where there is none."""
        return self._retry_at_ns if self._urgent else None

    def receive(self, ack: CommandAck, now_ns: int) -> None:
        """The drone's answer to the command in flight; answers to others' commands are not ours."""
        if self._current is None or ack.command != self._current.command:
            return
        if ack.result is Result.IN_PROGRESS:
            self._retry_at_ns = now_ns + PROGRESS_NS
            return
        self._finish(Answer(ack.result, now_ns))

    def due(self, now_ns: int) -> CommandLong | None:
        """The command to send now, if any."""
        if self._current is not None and now_ns >= self._retry_at_ns and self._tries >= TRIES and not self._urgent:
            self._finish(Answer(None, now_ns))
        if self._current is None and self._waiting:
            self._start(self._waiting.popleft())
        if self._current is None or now_ns < self._retry_at_ns:
            return None
        confirmation = min(self._tries, 255)
        self._tries += 1
        self._retry_at_ns = now_ns + (self.urgent_retry_ns if self._urgent else RETRY_NS)
        return replace(self._current, confirmation=confirmation)

    def _start(self, command: CommandLong) -> None:
        self._current, self._tries, self._retry_at_ns, self._urgent = command, 0, 0, False

    def _finish(self, answer: Answer) -> None:
        if self._current is not None:
            self.answers[self._current] = answer
        self._current, self._urgent = None, False
