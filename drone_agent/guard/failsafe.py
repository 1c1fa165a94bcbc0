"""The guard's fail-safe of a drone whose ground falls silent, and when the guard flies it in the ground's place. Pure.

The stages are in `drone_agent.guard.stages`; here are times, who owns the stream, and the pace of acting on a stage.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

from drone_agent.guard.stages import RULED, TABLE, Stage, Trigger
from formation.messages import Severity
from wire.link_messages import Address, CommandAck, MavCommand, Result

LAND_AFTER_S = 1.0
"""Time of holding, where nothing else is configured and a pose from outside is all there is."""
_OWN_PERIODS = 3
_PERIODS_MEASURED = 20
"""Number of periods averaged for a stream's rate; a single one may be short, as a sender catches up."""
_PAUSE_NS = 1_000_000_000
_REPORT_PERIOD_NS = 1_000_000_000

REPORTS = {
    Stage.HOLD: (Severity.WARNING, "Setpoints are stale: level and hold"),
    Stage.LAND: (Severity.CRITICAL, "Setpoints are stale: landing"),
    Stage.DESCEND: (Severity.CRITICAL, "No pose to land on: coming down level"),
}
"""The report to the operator as a stage begins."""
THRUST_LOSS = (Severity.CRITICAL, "Part of its thrust is missing: landing on what is left")
ATTITUDE_LOSS = (Severity.CRITICAL, "It turns against its commands, a motor may be dead: motors off")
LANDS_ITSELF = (Severity.WARNING, "Landing commanded, pose rejected: the guard lands it")
NEW_OWNER = (Severity.WARNING, "Another ground takes over: level and hold")
BACK = (Severity.INFO, "Setpoints are back")
STOPPED = "stopped: ask again after 2 s at rest"
"""Why one does not arm after a stop."""
REST_NS = 2_000_000_000
"""So long after a stop it must have been at rest, asked by nobody."""


def pose_fault(name: str) -> tuple[Severity, str]:
    """The report of a pose fault of that name."""
    return Severity.CRITICAL, f"Pose rejected, {name}: hold"


@dataclass(slots=True)
class LinkMonitor:
    """When something regular last came, and how regularly it comes."""

    last_ns: int | None = None
    _came_ns: deque[int] = field(default_factory=lambda: deque(maxlen=_PERIODS_MEASURED + 1))
    _quickest_ns: int = 0
    """The shortest time that _PERIODS_MEASURED periods in a row have taken; 0 until there were so many."""

    def note(self, now_ns: int, *, may_begin: bool = True) -> None:
        """It came; may_begin: after a pause it counts as a new stream, of its own pace."""
        came_ns = self._came_ns
        if self.last_ns is not None and now_ns - self.last_ns > _PAUSE_NS and may_begin:
            came_ns.clear()
            self._quickest_ns = 0
        came_ns.append(now_ns)
        if len(came_ns) > _PERIODS_MEASURED:
            span_ns = now_ns - came_ns[0]
            self._quickest_ns = min(self._quickest_ns or span_ns, span_ns)
        self.last_ns = now_ns

    def silent_at_ns(self, span_s: float) -> int | None:
        """When nothing will have come for `span_s`; None before the first."""
        return None if self.last_ns is None else self.last_ns + round(span_s * 1e9)

    def silent(self, now_ns: int, span_s: float) -> bool:
        """Whether nothing came for `span_s`, or nothing ever."""
        at_ns = self.silent_at_ns(span_s)
        return at_ns is None or now_ns >= at_ns

    def stale_at_ns(self, stale_s: float) -> int | None:
        """When it goes stale if nothing comes: after `stale_s`, or three periods of its own pace, whichever is longer.

        A client may stream slowly on purpose: MAVSDK at 20 Hz, and an autopilot is content with 3. The pace is the
        quickest since it began, so a fast stream that becomes lossy is judged as before.
        """
        if self.last_ns is None:
            return None
        return self.last_ns + max(round(stale_s * 1e9), _OWN_PERIODS * self._quickest_ns // _PERIODS_MEASURED)


class StreamFailsafe:
    """One stream of setpoints: its stage, its owner, its times."""

    def __init__(self, stale_s: float, land_s: float | None) -> None:
        """stale_s: the silence a control loop's stream may have; 0: any. land_s: holds for this long; None: for ever.

        0 and None leave it to the autopilot's own time-out.
        """
        self.stage = Stage.DISARMED
        self.monitor = LinkMonitor()
        self.owner: Address | None = None
        """Whose setpoints are obeyed; None: whose come next."""
        self.reports_hold = True
        """Whether the present hold is reported: at most one a second, however lossy the link."""
        self._reported_ns: int | None = None
        self._next_owner: Address | None = None
        self._stale_s = stale_s
        self._land_s = land_s
        self._held_since_ns = 0
        self.broken = False
        """Whether the stream broke off, and has not come back: one setpoint alone is none."""
        self.deadline_ns: int | None = None
        """When `advance` is next due, None while nothing is."""

    def pull(self, trigger: Trigger, now_ns: int) -> Stage | None:
        """The stage that begins, or begins anew; None where the trigger means nothing now."""
        after = TABLE.get((self.stage, trigger))
        if after is None:
            return None
        if after is Stage.HOLD:
            self._held_since_ns = now_ns
            self.reports_hold = self._reported_ns is None or now_ns - self._reported_ns >= _REPORT_PERIOD_NS
            self._reported_ns = now_ns if self.reports_hold else self._reported_ns
        if after not in RULED:
            self.owner = None
        elif trigger in (Trigger.STREAM, Trigger.NO_STREAM):
            self.owner, self._next_owner = self._next_owner, None
        self.stage, self.broken = after, trigger is Trigger.STALE
        self._find_deadline()
        return after

    # The owner

    def obeys(self, source: Address) -> bool:
        """Whether setpoints of `source` count."""
        return self.stage not in RULED or self.owner in (None, source)

    def hand_over(self, source: Address, wants: bool, now_ns: int, *, in_mode: bool) -> Stage | None:
        """`source` wants the stream, now or when a setpoint mode begins, or gives it back; the stage that begins."""
        if not wants:
            if source not in (self.owner, self._next_owner):
                return None
            self.owner = self._next_owner = None
            return self.pull(Trigger.NEW_OWNER, now_ns) if in_mode else None
        if not in_mode or self.stage not in RULED:
            self._next_owner = source
            return None
        if self.owner == source:
            return None
        self.owner = source
        return self.pull(Trigger.NEW_OWNER, now_ns)

    def follow(self, source: Address, now_ns: int) -> bool:
        """Receive an obeyed setpoint; returns whether it ended a reported hold."""
        ruled = self.stage in RULED
        due_ns = self.monitor.stale_at_ns(self._stale_s) if self.broken else None
        self.monitor.note(now_ns, may_begin=not ruled)
        if not ruled:
            return False
        if self.owner is None:
            self.owner = source
        if due_ns is not None and now_ns > due_ns:
            # The next one in time makes it a stream again; setpoints below the minimum rate end in hold and landing.
            return False
        held = self.stage is Stage.HOLD and self.reports_hold
        return self.pull(Trigger.SETPOINT, now_ns) is not None and held

    # The times

    def advance(self, now_ns: int, *, no_pose: bool = False) -> Stage | None:
        """The stage that begins now, if one does; no_pose: there is no pose for a hold, so a hold lands at once."""
        if no_pose and self.stage in (Stage.HOLD, Stage.LAND):
            return self.pull(Trigger.NO_POSE, now_ns)
        if self.deadline_ns is None or now_ns < self.deadline_ns:
            return None
        return self.pull(Trigger.STALE if self.stage is Stage.FOLLOW else Trigger.HELD, now_ns)

    def _find_deadline(self) -> None:
        self.deadline_ns = None
        if self.stage is Stage.FOLLOW and self._stale_s:
            self.deadline_ns = self.monitor.stale_at_ns(self._stale_s)
        elif self.stage is Stage.HOLD and self._land_s is not None:
            self.deadline_ns = self._held_since_ns + round(self._land_s * 1e9)


STEP_NS = 10_000_000
_AGAIN_NS = 100_000_000
_ALIVE_S = 2.0  # of a stream as a setpoint mode begins, which one heartbeat a second reports
_FLOWN = (Stage.HOLD, Stage.LAND, Stage.DESCEND)


class Turn(NamedTuple):
    """The actions now: stages that begin, the one whose target is flown, whether to command a landing, a stop."""

    begun: tuple[Stage, ...] = ()
    flown: Stage | None = None
    lands: bool = False
    stops: bool = False


class Takeover:
    """Follows one stream and one autopilot's mode; `due` says what to do now.

    It begins, and commands, only where the autopilot's own heartbeat said armed and off-board after the last command
    that could have changed that: a landing that the ground began must never be undone. The attitude targets of a stage
    that has begun go on until a heartbeat reports another mode, in which they mean nothing: a landing may be rejected.
    """

    def __init__(self, stale_s: float, land_s: float | None) -> None:
        self.stream = StreamFailsafe(stale_s, land_s)
        self.armed, self._offboard = True, False
        """As its last heartbeat said; armed, until the first."""
        self._mode_known = True
        self._next_ns = self._next_command_ns = 0
        self._done = self._descends_alone = False
        self._rest_since_ns = 0

    @property
    def descends_alone(self) -> bool:
        """Whether the guard alone brings it down, by attitude and thrust, whatever its poses look like by now."""
        return self._descends_alone and self.stream.stage is Stage.DESCEND

    @property
    def is_flown_by_setpoints(self) -> bool:
        """Whether the autopilot is known to follow setpoints, armed."""
        return self._offboard and self._mode_known

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
        """When `due` is to be asked; None while there is nothing to monitor."""
        if self.armed and self.stream.stage is Stage.STOPPED:
            return self._next_command_ns
        if not self._offboard or self._done:
            return None
        if self.stream.stage in _FLOWN:
            return self._next_ns
        return self.stream.deadline_ns if self._mode_known else None

    def due(self, now_ns: int, *, fed: bool, down: bool, alone: bool = False) -> Turn:
        """The actions at `deadline_ns`; fed: the body's own pose is fresh; down: it was let down and sinks no more;
        alone: a descent that begins now is no matter for the autopilot's own landing.

        A stopped drone's motors must not turn, and are stopped until the autopilot says that they do not.
        """
        if self.stream.stage is Stage.STOPPED:
            self._next_command_ns = now_ns + _AGAIN_NS
            return Turn(stops=True)
        begun: list[Stage] = []
        while (stage := self.stream.advance(now_ns, no_pose=not fed)) is not None:
            begun.append(stage)
        if Stage.HOLD in begun:
            self._next_command_ns = now_ns
        if Stage.DESCEND in begun:
            self._descends_alone = alone
        self._next_ns = now_ns + STEP_NS
        stage = self.stream.stage
        lands = down or (stage is Stage.DESCEND and not self._descends_alone)
        lands = lands and self._mode_known and now_ns >= self._next_command_ns
        if lands:
            self._next_command_ns = now_ns + _AGAIN_NS
        return Turn(tuple(begun), stage, lands)
