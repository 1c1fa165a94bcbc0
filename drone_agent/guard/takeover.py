"""When the bridge flies a real autopilot in the ground's place: the fail-safe's stages, and the pace of acting on them.

It begins, and commands, only where the autopilot's own heartbeat said armed and off-board after the last command that
could have changed that: a landing that the ground began must never be undone. The attitude targets of a stage that has
begun go on until a heartbeat reports another mode, in which they mean nothing: a landing may be rejected. No bytes.
"""

from typing import NamedTuple

from drone_agent.guard.failsafe import REST_NS, StreamFailsafe
from drone_agent.guard.stages import Stage, Trigger
from wire.link_messages import Address, CommandAck, MavCommand, Result

STEP_NS = 10_000_000
_AGAIN_NS = 100_000_000
_ALIVE_S = 2.0  # of a stream as a setpoint mode begins, which one heartbeat a second reports
_FLOWN = (Stage.HOLD, Stage.LAND, Stage.DESCEND)


class Turn(NamedTuple):
    """What to do now: stages that begin, the one to fly an attitude target of, whether to command a landing, a stop."""

    begun: tuple[Stage, ...] = ()
    flown: Stage | None = None
    lands: bool = False
    stops: bool = False


class Takeover:
    """Follows one stream and one autopilot's mode; `due` says what to do now."""

    def __init__(self, stale_s: float, land_s: float | None) -> None:
        self.stream = StreamFailsafe(stale_s, land_s)
        self.armed, self._offboard = True, False
        """As its last heartbeat said; armed, until the first."""
        self._mode_known = True
        self._next_ns = self._next_command_ns = 0
        self._done = False
        self._rest_since_ns = 0

    @property
    def is_flown_by_setpoints(self) -> bool:
        """Whether the autopilot is known to follow setpoints, armed."""
        return self._offboard and self._mode_known

    def note(self, source: Address, now_ns: int) -> bool:
        """A setpoint passed; True where it ends a hold."""
        return self.stream.follow(source, now_ns)

    def mode_unknown(self) -> None:
        """The ground sent a command that may change mode or arming."""
        self._mode_known = False

    def saw(self, now_ns: int, *, armed: bool, offboard: bool) -> None:
        """A heartbeat: whether the autopilot is armed, and follows setpoints."""
        began = armed and offboard and not self._offboard
        self._mode_known, self.armed, self._offboard = True, armed, armed and offboard
        if not armed:
            self.stream.pull(Trigger.DISARM, now_ns)
        else:
            self.stream.pull(Trigger.ARM, now_ns)
        if began:
            alive = not self.stream.monitor.silent(now_ns, _ALIVE_S)
            self.stream.pull(Trigger.STREAM if alive else Trigger.NO_STREAM, now_ns)
        elif not self._offboard:
            self.stream.pull(Trigger.OTHER_MODE, now_ns)
            self._done = False

    def stop(self, now_ns: int) -> None:
        """The ground stops the motors, or asks for them too early after that."""
        self.stream.pull(Trigger.STOP, now_ns)
        self._rest_since_ns = self._next_command_ns = now_ns

    def rest(self, now_ns: int, *, still: bool) -> None:
        """Whether the body is seen at rest: a stop is over after two seconds of it, disarmed."""
        if self.armed or not still:
            self._rest_since_ns = now_ns
        elif now_ns - self._rest_since_ns >= REST_NS:
            self.stream.pull(Trigger.RESTED, now_ns)

    def hand_over(self, source: Address, wants: bool, now_ns: int) -> Stage | None:
        """A ground asks for the stream, or gives it back; the stage that begins."""
        stage = self.stream.hand_over(source, wants, now_ns, in_mode=self._offboard)
        if stage is Stage.HOLD:
            self._next_ns = self._next_command_ns = now_ns
        return stage

    def on_fault(self, trigger: Trigger, now_ns: int) -> bool:
        """A detected fault pulls its trigger; returns whether a stage begins."""
        if not self.is_flown_by_setpoints or self.stream.pull(trigger, now_ns) is None:
            return False
        self._next_ns = self._next_command_ns = now_ns
        return True

    def acknowledged(self, ack: CommandAck) -> None:
        """The autopilot answered one of our commands."""
        if ack.command == MavCommand.NAV_LAND and ack.result is Result.ACCEPTED:
            self._done = True

    def deadline_ns(self) -> int | None:
        """When `due` is next worth asking; None while there is nothing to monitor."""
        if self._is_to_stop:
            return self._next_command_ns
        if not self._offboard or self._done:
            return None
        if self.stream.stage in _FLOWN:
            return self._next_ns
        return self.stream.deadline_ns if self._mode_known else None

    @property
    def _is_to_stop(self) -> bool:
        """Whether the motors must not turn, and the autopilot has not said that they do not."""
        return self.armed and self.stream.stage is Stage.STOPPED

    def due(self, now_ns: int, *, fed: bool, stands: bool) -> Turn:
        """What to do now; fed: the body's own pose is fresh; stands: it was let down and sinks no more."""
        deadline_ns = self.deadline_ns()
        if deadline_ns is None or now_ns < deadline_ns:
            return Turn()
        if self._is_to_stop:
            self._next_command_ns = now_ns + _AGAIN_NS
            return Turn(stops=True)
        begun: list[Stage] = []
        while (stage := self.stream.advance(now_ns, no_pose=not fed)) is not None:
            begun.append(stage)
        if Stage.HOLD in begun:
            self._next_command_ns = now_ns
        self._next_ns = now_ns + STEP_NS
        stage = self.stream.stage
        lands = (stands or stage is Stage.DESCEND) and self._mode_known and now_ns >= self._next_command_ns
        if lands:
            self._next_command_ns = now_ns + _AGAIN_NS
        return Turn(tuple(begun), stage, lands)
