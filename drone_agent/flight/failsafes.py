"""The autopilot's own fail-safes: a silent stream, a lost position, a low battery, a lost ground, a finished landing.

Its times are its parameters'. What stands between it and a ground, and acts sooner, is the guard.
"""

from math import cos, hypot

from drone_agent.autopilots.model import Task
from drone_agent.flight.autopilot import Autopilot
from drone_agent.flight.estimator import up_cos
from drone_agent.flight.landing import ContactDetector
from drone_agent.guard.failsafe import LinkMonitor
from formation.messages import Severity
from wire.autopilots.table import FlightMode

_IDLE_NORM, _IDLE_NS = 0.01, 8_000_000_000
"""Who does not know whether it climbs has landed after so long without thrust: PX4's MulticopterLandDetector."""
_ON_POSITION = (Task.HOLD, Task.TAKEOFF, Task.RETURN, Task.LAND)


class Failsafes:
    """What is monitored, and what was already said about it."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._landed_ns = 0
        self._flown = False
        self._ground = LinkMonitor()
        self._battery_low_reported = self._battery_acted = False
        self._contact = ContactDetector(autopilot.configured.drag_n_s_m[2] / autopilot.configured.mass_kg)
        self._tilted_ns: int | None = None
        self._idle_since_ns = 0

    def ground_seen(self, now_ns: int) -> None:
        """A ground station's heartbeat came."""
        self._ground.note(now_ns)

    def stream_deadline_ns(self) -> int | None:
        """When `check_stream` is next due; None while there is nothing to monitor."""
        return self._autopilot.stream.deadline_ns(self._autopilot.stream_loss.after_s)

    def check_stream(self, now_ns: int) -> None:
        """Act on a stream that has been silent too long."""
        pilot, due_ns = self._autopilot, self.stream_deadline_ns()
        if due_ns is None or now_ns < due_ns:
            return
        pilot.report(Severity.CRITICAL, pilot.model.texts.stream_lost)
        loss = pilot.stream_loss
        if loss.mode is not None:
            pilot.divert(loss.mode, now_ns, loss.task)
        else:
            pilot.fly(loss.task)
            pilot.stream.lost = True

    def check(self, now_ns: int) -> None:
        """Everything that changes slowly: twenty times a second."""
        pilot = self._autopilot
        self._detect_contact()
        if not pilot.armed:
            if pilot.carried:  # it may have been disarmed in the air
                pilot.estimator.rest()
            self._flown = False
            self._landed_ns = now_ns
            return
        self._detect_landing(now_ns)
        self._disarm_when_done(now_ns)
        if pilot.armed and not pilot.landed:
            self._check_attitude(now_ns)
            self._check_position(now_ns)
            self._check_battery(now_ns)
            self._check_ground(now_ns)

    def _detect_contact(self) -> None:
        pilot = self._autopilot
        estimate, configured = pilot.estimator, pilot.configured
        lift = configured.thrust_n_of(pilot.vehicle.setpoint.thrust_norm) / configured.mass_kg if pilot.armed else 0.0
        pilot.carried = self._contact.update(
            estimate.t_ns,
            estimate.climbed_m_s,
            float(estimate.vel_lab_m_s[2]),
            lift * up_cos(estimate.q_lab_from_flu),
            flies=not pilot.landed and pilot.task not in (Task.LAND, Task.DESCEND),
        )
        pilot.pilot.set_thrust_scale(self._contact.thrust_scale)

    def _check_attitude(self, now_ns: int) -> None:
        """Stop the motors of a drone that has lain on its side for too long, where the autopilot is set up to."""
        pilot, limits = self._autopilot, self._autopilot.attitude_failure
        if limits is None or up_cos(pilot.estimator.q_lab_from_flu) >= cos(limits.tilt_rad):
            self._tilted_ns = None
            return
        self._tilted_ns = now_ns if self._tilted_ns is None else self._tilted_ns
        if now_ns - self._tilted_ns >= round(limits.after_s * 1e9):
            pilot.report(Severity.CRITICAL, pilot.model.texts.attitude_lost)
            pilot.terminate()

    def _detect_landing(self, now_ns: int) -> None:
        pilot = self._autopilot
        belief, configured = pilot.belief, pilot.configured
        vx, vy, vz = belief.vel_lab_m_s
        thrust = (
            self._contact.thrust_scale
            * configured.thrust_n_of(pilot.vehicle.setpoint.thrust_norm)
            / configured.weight_n
        )
        if pilot.estimator.valid(now_ns) or pilot.vehicle.setpoint.thrust_norm > _IDLE_NORM:
            self._idle_since_ns = now_ns
        faded = (pilot.piloted and pilot.pilot.faded) or now_ns - self._idle_since_ns >= _IDLE_NS
        if not pilot.detector.update(
            now_ns, thrust, belief.pos_lab_m[2], vz, hypot(vx, vy), carried=pilot.carried, faded=faded
        ):
            return
        if pilot.landed:
            self._landed_ns = now_ns
            pilot.report(Severity.INFO, pilot.model.texts.landed)
        else:
            self._flown = True
            pilot.report(Severity.INFO, pilot.model.texts.takeoff)

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
        """Where there is no position to fly by, it comes down level."""
        pilot = self._autopilot
        if pilot.task in _ON_POSITION and not pilot.estimator.valid(now_ns):
            pilot.report(Severity.CRITICAL, pilot.model.texts.pose_lost)
            pilot.divert(FlightMode.DESCEND, now_ns)

    def _check_battery(self, now_ns: int) -> None:
        pilot, timing = self._autopilot, self._autopilot.timing
        left = pilot.vehicle.pack.remaining
        if left < timing.battery_low and not self._battery_low_reported:
            self._battery_low_reported = True
            pilot.report(Severity.WARNING, pilot.model.texts.battery_low)
        if left < timing.battery_critical and not self._battery_acted:
            self._battery_acted = True
            pilot.report(Severity.CRITICAL, pilot.model.texts.battery_critical)
            if timing.battery_action is not None:
                pilot.divert(timing.battery_action, now_ns)

    def _check_ground(self, now_ns: int) -> None:
        pilot, timing = self._autopilot, self._autopilot.timing
        if self._ground.last_ns is None or timing.ground_loss is None:
            return
        if self._ground.silent(now_ns, timing.ground_loss_s):
            self._ground = LinkMonitor()
            pilot.report(Severity.CRITICAL, pilot.model.texts.ground_lost)
            pilot.divert(timing.ground_loss, now_ns)
