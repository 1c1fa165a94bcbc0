"""The stale-setpoint rule beside a real autopilot: when to hold it, when to let it down, when to land it. No bytes.

It acts only on an autopilot whose own heartbeat said armed and off-board after the last command that could have
changed that: a landing that the ground began must never be undone.
"""

from enum import Enum, auto

from drone_agent.flight.stream import StreamWatch
from wire.link_messages.commands import CommandAck, Result

STEP_NS = 10_000_000
_AGAIN_NS = 300_000_000


class Do(Enum):
    """One step of the rule."""

    SAY_STALE = auto()
    HOLD = auto()
    SAY_LANDING = auto()
    LET_DOWN = auto()
    LAND = auto()


class StaleRule:
    """Follows one stream and one autopilot's mode; `due` says what to do now."""

    def __init__(self, stale_s: float, land_s: float) -> None:
        self._stream = StreamWatch(stale_s)
        self._land_ns = round(land_s * 1e9)
        self._watched = False
        self._unknown_since_ns: int | None = None
        self._stale_ns: int | None = None
        self._next_ns = self._next_command_ns = 0
        self._landing = self._done = False

    def note(self, now_ns: int) -> bool:
        """A setpoint passed; True where it ends a silence that was being acted on."""
        self._stream.note(now_ns)
        if self._stale_ns is None or self._landing:
            return False
        self._stale_ns = None
        return True

    def mode_unknown(self, now_ns: int) -> None:
        """The ground sent a command that may change mode or arming."""
        self._unknown_since_ns = now_ns

    def saw(self, *, offboard: bool) -> None:
        """A heartbeat: whether the autopilot is armed and follows setpoints."""
        self._unknown_since_ns = None
        self._watched = offboard
        if not offboard:
            self._landing = self._done = False
            self._stale_ns = None

    def acknowledged(self, ack: CommandAck) -> None:
        """The autopilot answered one of our commands."""
        if ack.command == 21 and ack.result is Result.ACCEPTED:
            self._done = True

    def deadline_ns(self) -> int | None:
        """When `due` is next worth asking; None while there is nothing to watch."""
        if not self._acts or self._done:
            return None
        return self._stream.stale_at_ns if self._stale_ns is None else self._next_ns

    def due(self, now_ns: int, *, fed: bool, stands: bool) -> list[Do]:
        """What to do now; fed: the body's own pose is fresh; stands: it was let down and sinks no more."""
        deadline_ns = self.deadline_ns()
        if deadline_ns is None or now_ns < deadline_ns:
            return []
        steps: list[Do] = []
        if self._stale_ns is None:
            self._stale_ns = self._next_command_ns = now_ns
            steps.append(Do.SAY_STALE)
        self._next_ns = now_ns + STEP_NS
        if not self._landing and (not fed or now_ns - self._stale_ns >= self._land_ns):
            self._landing = True
            steps.append(Do.SAY_LANDING)
        if fed:
            steps.append(Do.LET_DOWN if self._landing else Do.HOLD)
        if (stands or not fed) and now_ns >= self._next_command_ns:
            self._next_command_ns = now_ns + _AGAIN_NS
            steps.append(Do.LAND)
        return steps

    @property
    def _acts(self) -> bool:
        return self._watched and self._unknown_since_ns is None
