"""The fail-safe of a drone whose ground falls silent, one for the simulated autopilot and for the bridge. Pure.

A stream of setpoints that goes stale is answered in stages; each side carries them out in its own way:

    FOLLOW --stale--> HOLD --land_s later--> LAND
    HOLD --a setpoint--> FOLLOW
    FOLLOW or HOLD --the autopilot's own time-out--> LOST
"""

from dataclasses import dataclass
from enum import Enum, auto

from formation.messages import Severity

LAND_AFTER_S = 1.0
"""Of holding, where nothing else is configured and a pose from outside is all there is."""
_SLOW_PERIODS = 3.0
_PERIOD_WEIGHT = 0.1
_PERIOD_MAX_NS = 1_000_000_000


class Stage(Enum):
    """What is done about the stream of setpoints."""

    FOLLOW = auto()
    HOLD = auto()
    """Stale: level and hold until it comes back."""
    LAND = auto()
    LOST = auto()
    """The autopilot's own time-out has taken the flight over."""


REPORTS = {
    Stage.HOLD: (Severity.WARNING, "Setpoints are stale: level and hold"),
    Stage.LAND: (Severity.CRITICAL, "Setpoints are stale: landing"),
}
"""What the operator is told as a stage begins."""
BACK = (Severity.INFO, "Setpoints are back")


@dataclass(slots=True)
class LinkMonitor:
    """When something regular last came, and how regularly it comes."""

    last_ns: int | None = None
    _period_ns: float = 0.0

    def note(self, now_ns: int) -> None:
        """It came."""
        if self.last_ns is not None:
            period = now_ns - self.last_ns
            if period > _PERIOD_MAX_NS:
                self._period_ns = 0.0
            elif self._period_ns == 0.0:
                self._period_ns = period
            else:
                self._period_ns += _PERIOD_WEIGHT * (period - self._period_ns)
        self.last_ns = now_ns

    def silent_at_ns(self, span_s: float) -> int | None:
        """When nothing will have come for `span_s`; None before the first."""
        return None if self.last_ns is None else self.last_ns + round(span_s * 1e9)

    def silent(self, now_ns: int, span_s: float) -> bool:
        """Whether nothing came for `span_s`, or nothing ever."""
        at_ns = self.silent_at_ns(span_s)
        return at_ns is None or now_ns >= at_ns

    def stale_at_ns(self, stale_s: float) -> int | None:
        """When it goes stale if nothing comes: after `stale_s`, or three of its own periods where that is longer.

        A client that streams slowly on purpose (an autopilot is content with 3 Hz) is judged by its own pace.
        """
        if self.last_ns is None:
            return None
        return self.last_ns + max(round(stale_s * 1e9), int(_SLOW_PERIODS * self._period_ns))


class StreamFailsafe:
    """The stages of one stream. Its owner says when it applies: armed, and following setpoints."""

    def __init__(self, stale_s: float, land_s: float | None) -> None:
        """stale_s: the silence a control loop's stream may have; 0: any. land_s: holds for this long; None: for ever.

        Either leaves the autopilot's own time-out to act.
        """
        self.stage = Stage.LOST
        self.monitor = LinkMonitor()
        self._stale_s = stale_s
        self._land_s = land_s
        self._held_since_ns = 0

    @property
    def lands(self) -> bool:
        """Whether a hold ends in a landing."""
        return self._land_s is not None

    def begin(self, stage: Stage = Stage.FOLLOW) -> None:
        """Setpoints rule from now on, or with LOST: would, if they came."""
        self.stage = stage

    def resume(self) -> bool:
        """Follow a setpoint that came, unless it is too late; whether it ended a hold."""
        held = self.stage is Stage.HOLD
        if self.stage is not Stage.LAND:
            self.stage = Stage.FOLLOW
        return held

    def deadline_ns(self, own_s: float | None = None) -> int | None:
        """When `advance` is next due, None while nothing is; own_s: the autopilot's own time-out, where it is known."""
        if self.stage is Stage.FOLLOW:
            stale_ns = self.monitor.stale_at_ns(self._stale_s) if self._stale_s else None
        elif self.stage is Stage.HOLD:
            stale_ns = None if self._land_s is None else self._held_since_ns + round(self._land_s * 1e9)
        else:
            return None
        own_ns = None if own_s is None else self.monitor.silent_at_ns(own_s)
        return min((ns for ns in (stale_ns, own_ns) if ns is not None), default=None)

    def advance(self, now_ns: int, own_s: float | None = None, *, blind: bool = False) -> Stage | None:
        """The stage that begins now, if one does; blind: there is no pose to hold by, so that a hold lands at once."""
        due_ns = self.deadline_ns(own_s)
        if due_ns is None or (now_ns < due_ns and not (blind and self.stage is Stage.HOLD)):
            return None
        if own_s is not None and self.monitor.silent(now_ns, own_s):
            self.stage = Stage.LOST
        elif self.stage is Stage.FOLLOW:
            self.stage, self._held_since_ns = Stage.HOLD, now_ns
        else:
            self.stage = Stage.LAND
        return self.stage
