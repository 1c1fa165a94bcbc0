"""The stale-setpoint rule beside a real autopilot: when to level it, when to let it hold, when to land it. No bytes.

It acts only on an autopilot whose own heartbeat said armed and off-board after the last command that could have
changed that: a landing that the ground began must never be undone.
"""

import math
from enum import Enum, auto

import numpy as np

from drone_agent.stream import StreamWatch
from formation.arrays import Quat
from formation.frames import IDENTITY, from_yaw, yaw
from wire.link_messages.address import Address
from wire.link_messages.commands import CommandAck, Result
from wire.link_messages.setpoints import AttitudeSetpoint, Ignore

_LEVEL_NS = 20_000_000
_HOLD_AFTER_NS = 300_000_000
_AGAIN_NS = 300_000_000
_THRUST_WEIGHT = 0.04


class Do(Enum):
    """One step of the rule."""

    SAY_STALE = auto()
    LEVEL = auto()
    HOLD = auto()
    LAND = auto()


class Seen(Enum):
    """What a heartbeat said."""

    OFFBOARD = auto()
    HOLDING = auto()
    OTHER = auto()


class StaleRule:
    """Follows one stream and one autopilot's mode; `due` says what to do now."""

    def __init__(self, stale_s: float, land_s: float) -> None:
        self._stream = StreamWatch(stale_s)
        self._land_ns = round(land_s * 1e9)
        self._watched = False
        self._unknown_since_ns: int | None = None
        self._stale_ns: int | None = None
        self._next_level_ns = self._next_command_ns = 0
        self._landing = self._done = False
        self._thrust = math.nan
        self._attitude: Quat = IDENTITY

    def note(self, target: AttitudeSetpoint, now_ns: int) -> bool:
        """A setpoint passed; True where it ends a silence that was being acted on."""
        self._stream.note(now_ns)
        self._attitude = target.q_lab_from_flu
        thrust = target.thrust_norm
        self._thrust = thrust if math.isnan(self._thrust) else self._thrust + _THRUST_WEIGHT * (thrust - self._thrust)
        if self._stale_ns is None or self._landing:
            return False
        self._stale_ns = None
        return True

    def mode_unknown(self, now_ns: int) -> None:
        """The ground sent a command that may change mode or arming."""
        self._unknown_since_ns = now_ns

    def saw(self, seen: Seen) -> None:
        """A heartbeat. A hold that follows our own request is still ours to end with a landing."""
        self._unknown_since_ns = None
        if seen is Seen.OFFBOARD or (seen is Seen.HOLDING and self._stale_ns is not None):
            self._watched = True
            return
        self._watched = self._landing = self._done = False
        self._stale_ns = None

    def acknowledged(self, ack: CommandAck) -> None:
        """The autopilot answered one of our commands."""
        if ack.command == 21 and ack.result is Result.ACCEPTED:
            self._done = True

    def deadline_ns(self) -> int | None:
        """When `due` is next worth asking; None while there is nothing to watch."""
        if not self._acts or self._done:
            return None
        if self._stale_ns is None:
            return self._stream.stale_at_ns
        return self._next_command_ns if self._landing else min(self._next_level_ns, self._next_command_ns)

    def due(self, now_ns: int, *, fed: bool) -> list[Do]:
        """What to do now; fed: the autopilot's pose is fresh, so that it can hold."""
        deadline_ns = self.deadline_ns()
        if deadline_ns is None or now_ns < deadline_ns:
            return []
        steps: list[Do] = []
        if self._stale_ns is None:
            self._stale_ns = now_ns
            self._next_level_ns = now_ns
            self._next_command_ns = now_ns + _HOLD_AFTER_NS
            steps.append(Do.SAY_STALE)
        if now_ns >= self._next_command_ns:
            self._next_command_ns = now_ns + _AGAIN_NS
            self._landing = self._landing or not fed or now_ns - self._stale_ns >= self._land_ns
            steps.append(Do.LAND if self._landing else Do.HOLD)
        if now_ns >= self._next_level_ns and not self._landing:
            self._next_level_ns = now_ns + _LEVEL_NS
            steps.append(Do.LEVEL)
        return steps

    def level_target(self, target: Address, t_boot_ms: int) -> AttitudeSetpoint:
        """Level at the last heading, with the thrust that carried it so far."""
        level = from_yaw(yaw(self._attitude))
        return AttitudeSetpoint(target, t_boot_ms, level, np.zeros(3), self._thrust, Ignore.BODY_RATES)

    @property
    def _acts(self) -> bool:
        return self._watched and self._unknown_since_ns is None
