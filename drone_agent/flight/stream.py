"""Watches the stream of setpoints: when the last one came, how often they come, when the silence is too long."""

from enum import Enum, auto

_SLOW_PERIODS = 3.0
_PERIOD_WEIGHT = 0.1
_PERIOD_MAX_NS = 1_000_000_000


class Watch(Enum):
    """What became of the stream in off-board flight."""

    LIVE = auto()
    LEVELLED = auto()  # the agent's own rule: level and hold until it comes back
    GIVEN_UP = auto()  # the flight goes on without it


class StreamWatch:
    """One stream. `stale_s` is the silence a control loop's stream may have; 0 means no such rule.

    A client that streams slowly on purpose (an autopilot is content with 3 Hz) is judged by its own pace:
    stale after three of its periods, never earlier than `stale_s`.
    """

    def __init__(self, stale_s: float) -> None:
        self.watch = Watch.GIVEN_UP
        self.last_ns: int | None = None
        self.stale_at_ns: int | None = None
        """When the stream goes stale if nothing comes; None where there is no stream or no rule."""
        self.age_ms: float | None = None
        """From camera to drone, of the newest setpoint; None once told, or without a common clock."""
        self._stale_ns = round(stale_s * 1e9)
        self._period_ns = 0.0

    def note(self, now_ns: int) -> None:
        """A setpoint came."""
        if self.last_ns is not None:
            period = now_ns - self.last_ns
            if period > _PERIOD_MAX_NS:
                self._period_ns = 0.0
            elif self._period_ns == 0.0:
                self._period_ns = period
            else:
                self._period_ns += _PERIOD_WEIGHT * (period - self._period_ns)
        self.last_ns = now_ns
        if self._stale_ns:
            self.stale_at_ns = now_ns + max(self._stale_ns, int(_SLOW_PERIODS * self._period_ns))

    def take_age_ms(self) -> float | None:
        """The newest setpoint's age, once."""
        age_ms, self.age_ms = self.age_ms, None
        return age_ms

    def silent_for(self, now_ns: int, span_s: float) -> bool:
        """Whether nothing came for `span_s`."""
        return self.last_ns is None or now_ns - self.last_ns >= round(span_s * 1e9)
