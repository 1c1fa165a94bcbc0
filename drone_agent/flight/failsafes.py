"""The autopilot's fail-safes: a silent stream, a lost position, a low battery, a lost ground, a finished landing.

The agent's own (drone_agent.failsafe: level on a stale stream, then land) is the last line of defence and comes
first; the autopilot's time-outs, from its parameters, come after it.
"""

from math import hypot

from drone_agent.autopilots.model import Task
from drone_agent.failsafe import REPORTS, LinkMonitor, Stage
from drone_agent.flight.autopilot import Autopilot
from formation.messages import Severity
from wire.autopilots.table import FlightMode

_ON_POSITION = (Task.HOLD, Task.TAKEOFF, Task.RETURN, Task.LAND)


class Failsafes:
    """What is monitored, and what was already said about it."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._landed_ns = 0
        self._flown = False
        self._ground = LinkMonitor()
        self._battery_low_said = self._battery_acted = False

    def ground_seen(self, now_ns: int) -> None:
        """A ground station's heartbeat came."""
        self._ground.note(now_ns)

    def stream_deadline_ns(self) -> int | None:
        """When `check_stream` is next due; None while there is nothing to monitor."""
        pilot = self._autopilot
        return pilot.stream.deadline_ns(pilot.stream_loss.after_s) if pilot.in_stream_mode else None

    def check_stream(self, now_ns: int) -> None:
        """Act on a stream that has been silent too long."""
        pilot = self._autopilot
        if not pilot.in_stream_mode:
            return
        loss = pilot.stream_loss
        stage = pilot.stream.advance(now_ns, loss.after_s)
        if stage in REPORTS:
            pilot.say(*REPORTS[stage])
        match stage:
            case Stage.HOLD:
                holds = pilot.positioning.valid(now_ns)
                pilot.fly(Task.HOLD if holds else Task.LEVEL, now_ns, level_first=True)
            case Stage.LAND:
                pilot.fail_safe(FlightMode.LAND, now_ns)
            case Stage.LOST:
                pilot.say(Severity.CRITICAL, pilot.model.texts.stream_lost)
                if loss.mode is not None:
                    pilot.fail_safe(loss.mode, now_ns, loss.task)
                elif not pilot.stream.lands:
                    pilot.fly(loss.task, now_ns)

    def check(self, now_ns: int, dt_s: float) -> None:
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
            self._check_position(now_ns)
            self._check_battery(now_ns)
            self._check_ground(now_ns)

    def _detect_landing(self, now_ns: int) -> None:
        pilot = self._autopilot
        frame, belief = pilot.airframe, pilot.belief(now_ns)
        vx, vy, vz = belief.vel_lab_m_s
        thrust = frame.profile.thrust_n_of(frame.setpoint.thrust_norm) / frame.profile.weight_n
        if not pilot.detector.update(now_ns, thrust, belief.pos_lab_m[2], vz, hypot(vx, vy)):
            return
        if pilot.landed:
            self._landed_ns = now_ns
            pilot.say(Severity.INFO, pilot.model.texts.landed)
        else:
            self._flown = True
            pilot.say(Severity.INFO, pilot.model.texts.takeoff)

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

    def _check_position(self, now_ns: int) -> None:
        pilot = self._autopilot
        if pilot.task in _ON_POSITION and not pilot.positioning.valid(now_ns):
            pilot.say(Severity.CRITICAL, pilot.model.texts.pose_lost)
            pilot.fail_safe(FlightMode.DESCEND, now_ns)

    def _check_battery(self, now_ns: int) -> None:
        pilot, timing = self._autopilot, self._autopilot.timing
        left = pilot.airframe.pack.remaining
        if left < timing.battery_low and not self._battery_low_said:
            self._battery_low_said = True
            pilot.say(Severity.WARNING, pilot.model.texts.battery_low)
        if left < timing.battery_critical and not self._battery_acted:
            self._battery_acted = True
            pilot.say(Severity.CRITICAL, pilot.model.texts.battery_critical)
            if timing.battery_action is not None:
                pilot.fail_safe(timing.battery_action, now_ns)

    def _check_ground(self, now_ns: int) -> None:
        pilot, timing = self._autopilot, self._autopilot.timing
        if self._ground.last_ns is None or timing.ground_loss is None:
            return
        if self._ground.silent(now_ns, timing.ground_loss_s):
            self._ground = LinkMonitor()
            pilot.say(Severity.CRITICAL, pilot.model.texts.ground_lost)
            pilot.fail_safe(timing.ground_loss, now_ns)
