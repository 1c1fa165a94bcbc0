"""When the bridge flies a real autopilot in the ground's place: the fail-safe's stages, and the pace of acting on them.

It acts only on an autopilot whose own heartbeat said armed and off-board after the last command that could have
changed that: a landing that the ground began must never be undone. No bytes.
"""

from typing import NamedTuple

from drone_agent.failsafe import Stage, StreamFailsafe
from wire.link_messages.commands import CommandAck, MavCommand, Result

STEP_NS = 10_000_000
_AGAIN_NS = 300_000_000


class Turn(NamedTuple):
    """What to do now: stages that begin, the one to fly an attitude target of, whether to command a landing."""

    begun: tuple[Stage, ...] = ()
    flown: Stage | None = None
    lands: bool = False


class Takeover:
    """Follows one stream and one autopilot's mode; `due` says what to do now."""

    def __init__(self, stale_s: float, land_s: float | None) -> None:
        self._stream = StreamFailsafe(stale_s, land_s)
        self._stream.begin()
        self._offboard = False
        self._mode_known = True
        self._next_ns = self._next_command_ns = 0
        self._done = False

    def note(self, now_ns: int) -> bool:
        """A setpoint passed; True where it ends a hold."""
        self._stream.monitor.note(now_ns)
        return self._stream.resume()

    def mode_unknown(self) -> None:
        """The ground sent a command that may change mode or arming."""
        self._mode_known = False

    def saw(self, *, offboard: bool) -> None:
        """A heartbeat: whether the autopilot is armed and follows setpoints."""
        self._mode_known, self._offboard = True, offboard
        if not offboard:
            self._done = False
            self._stream.begin()

    def acknowledged(self, ack: CommandAck) -> None:
        """The autopilot answered one of our commands."""
        if ack.command == MavCommand.NAV_LAND and ack.result is Result.ACCEPTED:
            self._done = True

    def deadline_ns(self) -> int | None:
        """When `due` is next worth asking; None while there is nothing to monitor."""
        if not (self._offboard and self._mode_known) or self._done:
            return None
        return self._stream.deadline_ns() if self._stream.stage is Stage.FOLLOW else self._next_ns

    def due(self, now_ns: int, *, fed: bool, stands: bool) -> Turn:
        """What to do now; fed: the body's own pose is fresh; stands: it was let down and sinks no more."""
        deadline_ns = self.deadline_ns()
        if deadline_ns is None or now_ns < deadline_ns:
            return Turn()
        begun: list[Stage] = []
        while (stage := self._stream.advance(now_ns, blind=not fed)) is not None:
            begun.append(stage)
        if Stage.HOLD in begun:
            self._next_command_ns = now_ns
        self._next_ns = now_ns + STEP_NS
        lands = (stands or not fed) and now_ns >= self._next_command_ns
        if lands:
            self._next_command_ns = now_ns + _AGAIN_NS
        return Turn(tuple(begun), self._stream.stage if fed else None, lands)
