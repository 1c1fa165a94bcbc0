"""The autopilot's fail-safes: a silent stream, a lost position, a low battery, a lost ground, a finished landing.

The agent's own rule (levels on a stale stream, then lands) is the last line of defence and comes first; the
make's own time-outs, from its parameters, come after it.
"""

from math import hypot

from drone_agent.autopilots.personality import Mode, Task
from drone_agent.config import AgentConfig
from drone_agent.flight.autopilot import Autopilot
from drone_agent.flight.stream import Watch
from formation.messages import Severity

_STALE_LAND_MOCAP_S = 1.0
_ON_POSITION = (Task.HOLD, Task.TAKEOFF, Task.RETURN, Task.LAND)


class Guards:
    """What is watched, and what was already said about it."""

    def __init__(self, config: AgentConfig, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._land_s = config.stale_land_s
        if self._land_s is None and config.pose == "mocap":
            self._land_s = _STALE_LAND_MOCAP_S
        self._landed_ns = 0
        self._flown = False
        self._ground_seen_ns: int | None = None
        self._battery_low_said = self._battery_acted = False

    def ground_seen(self, now_ns: int) -> None:
        """A ground station's heartbeat came."""
        self._ground_seen_ns = now_ns

    def stream_deadline_ns(self) -> int | None:
        """When `watch_stream` is next due; None while there is nothing to watch."""
        pilot, stream = self._autopilot, self._autopilot.stream
        if not pilot.in_stream_mode or stream.last_ns is None or stream.watch is Watch.GIVEN_UP:
            return None
        own_ns = stream.last_ns + int(pilot.stream_loss.after_s * 1e9)
        stale_ns = stream.stale_at_ns
        if stale_ns is None:
            return own_ns
        if stream.watch is Watch.LIVE:
            return min(own_ns, stale_ns)
        return own_ns if self._land_s is None else min(own_ns, stale_ns + int(self._land_s * 1e9))

    def watch_stream(self, now_ns: int) -> None:
        """Act on a stream that has been silent too long."""
        due_ns = self.stream_deadline_ns()
        if due_ns is None or now_ns < due_ns:
            return
        pilot, stream = self._autopilot, self._autopilot.stream
        loss = pilot.stream_loss
        if stream.silent_for(now_ns, loss.after_s):
            stream.watch = Watch.GIVEN_UP
            pilot.say(Severity.CRITICAL, pilot.personality.words.stream_lost)
            if loss.mode is not None:
                pilot.fail_safe(loss.mode, now_ns, loss.task)
            elif self._land_s is None:
                pilot.fly(loss.task, now_ns)
        elif stream.watch is Watch.LIVE:
            stream.watch = Watch.LEVELLED
            pilot.say(Severity.WARNING, "Setpoints are stale: level and hold")
            holds = pilot.positioning.valid(now_ns)
            pilot.fly(Task.HOLD if holds else Task.LEVEL, now_ns, level_first=True)
        else:
            stream.watch = Watch.GIVEN_UP
            pilot.say(Severity.CRITICAL, "Setpoints are stale: landing")
            pilot.fail_safe(Mode.LAND, now_ns)

    def look(self, now_ns: int, dt_s: float) -> None:
        """Everything that changes slowly: twenty times a second."""
        pilot = self._autopilot
        pilot.airframe.drain(dt_s)
        if not pilot.armed:
            self._flown = False
            self._landed_ns = now_ns
            return
        self._detect_landing(now_ns)
        self._disarm_when_done(now_ns)
        if pilot.armed and not pilot.landed:
            self._guard_position(now_ns)
            self._guard_battery(now_ns)
            self._guard_ground(now_ns)

    def _detect_landing(self, now_ns: int) -> None:
        pilot = self._autopilot
        frame, belief = pilot.airframe, pilot.belief(now_ns)
        vx, vy, vz = belief.vel_lab_m_s
        thrust = frame.profile.thrust_n_of(frame.setpoint.thrust_norm) / frame.profile.weight_n
        if not pilot.detector.update(now_ns, thrust, belief.pos_lab_m[2], vz, hypot(vx, vy)):
            return
        if pilot.landed:
            self._landed_ns = now_ns
            pilot.say(Severity.INFO, pilot.personality.words.landed)
        else:
            self._flown = True
            pilot.say(Severity.INFO, pilot.personality.words.takeoff)

    def _disarm_when_done(self, now_ns: int) -> None:
        pilot, timing = self._autopilot, self._autopilot.timing
        if not pilot.landed or not pilot.armed:
            return
        if not self._flown:
            wait_s, since_ns, reason = timing.disarm_idle_s, pilot.armed_ns, "auto preflight disarming"
        else:
            landing = pilot.task in (Task.LAND, Task.DESCEND)
            wait_s = timing.disarm_landing_s if landing else timing.disarm_flown_s
            since_ns, reason = self._landed_ns, "landing"
        if wait_s >= 0.0 and now_ns - since_ns >= round(wait_s * 1e9):
            pilot.disarm(force=False, reason=reason)

    def _guard_position(self, now_ns: int) -> None:
        pilot = self._autopilot
        if pilot.task in _ON_POSITION and not pilot.positioning.valid(now_ns):
            pilot.say(Severity.CRITICAL, pilot.personality.words.pose_lost)
            pilot.fail_safe(Mode.DESCEND, now_ns)

    def _guard_battery(self, now_ns: int) -> None:
        pilot, timing = self._autopilot, self._autopilot.timing
        left = pilot.airframe.pack.remaining
        if left < timing.battery_low and not self._battery_low_said:
            self._battery_low_said = True
            pilot.say(Severity.WARNING, pilot.personality.words.battery_low)
        if left < timing.battery_critical and not self._battery_acted:
            self._battery_acted = True
            pilot.say(Severity.CRITICAL, pilot.personality.words.battery_critical)
            if timing.battery_action is not None:
                pilot.fail_safe(timing.battery_action, now_ns)

    def _guard_ground(self, now_ns: int) -> None:
        pilot, timing = self._autopilot, self._autopilot.timing
        if self._ground_seen_ns is None or timing.ground_loss is None:
            return
        if now_ns - self._ground_seen_ns >= round(timing.ground_loss_s * 1e9):
            self._ground_seen_ns = None
            pilot.say(Severity.CRITICAL, pilot.personality.words.ground_lost)
            pilot.fail_safe(timing.ground_loss, now_ns)
