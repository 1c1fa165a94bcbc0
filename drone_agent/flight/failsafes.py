"""The autopilot's fail-safes: a silent stream, a lost position, a low battery, a lost ground, a finished landing.

The agent's own (drone_agent.failsafe: level on a stale stream, then land) is the last line of defence and comes
first; the autopilot's time-outs, from its parameters, come after it.
"""

from math import hypot

from drone_agent.autopilots.model import Task
from drone_agent.failsafe import NEW_OWNER, REPORTS, REST_NS, LinkMonitor, pose_fault
from drone_agent.flight.autopilot import Autopilot
from drone_agent.flight.estimator import up_cos
from drone_agent.flight.landing import ContactDetector
from drone_agent.flight.motor_failure import MotorFailure
from drone_agent.stages import Stage, Trigger
from formation.messages import Severity
from formation.vehicle.profile import VehicleProfile
from wire.autopilots.table import FlightMode
from wire.link_messages.address import Address

_ON_POSITION = (Task.HOLD, Task.TAKEOFF, Task.RETURN, Task.LAND)
_LEVEL_AFTER_S, _DESCEND_AFTER_S = 0.2, 0.5
"""Without a pose that its estimator takes: no place to hold; nothing to land by."""
_REST_M_S, _REST_RAD_S = 0.1, 0.3
_POWERLESS = 0.8
"""Share of the thrust missing with which it falls as with none."""


class Failsafes:
    """What is monitored, and what was already said about it."""

    def __init__(self, autopilot: Autopilot, vehicle: VehicleProfile) -> None:
        """vehicle: what the autopilot is set up for, whatever it really flies."""
        self._autopilot, self._vehicle = autopilot, vehicle
        self._landed_ns = 0
        self._flown = False
        self._ground = LinkMonitor()
        self._battery_low_reported = self._battery_acted = False
        self._contact = ContactDetector(vehicle.drag_n_s_m[2] / vehicle.mass_kg)
        self._failure = MotorFailure(vehicle)
        self._rest_ns = 0
        self._levelled = False
        """Whether it flies level for want of a pose alone."""

    def ground_seen(self, now_ns: int) -> None:
        """A ground station's heartbeat came."""
        self._ground.note(now_ns)

    def stream_deadline_ns(self) -> int | None:
        """When `check_stream` is next due; None while there is nothing to monitor."""
        pilot = self._autopilot
        return pilot.stream.deadline_ns(pilot.stream_loss.after_s)

    def check_stream(self, now_ns: int) -> None:
        """Act on a stream that has been silent too long."""
        pilot = self._autopilot
        stage = pilot.stream.advance(now_ns, pilot.stream_loss.after_s)
        if stage in REPORTS and (stage is not Stage.HOLD or pilot.stream.reports_hold):
            pilot.report(*REPORTS[stage])
        self._execute(stage, now_ns)

    def hand_over(self, source: Address, wants: bool, now_ns: int) -> None:
        """A ground asks for the stream of setpoints, or gives it back: hold until its owner's come."""
        pilot = self._autopilot
        stage = pilot.stream.hand_over(source, wants, now_ns, in_mode=pilot.in_stream_mode)
        if stage is Stage.HOLD:
            pilot.report(*NEW_OWNER)
        self._execute(stage, now_ns)

    def check_pose(self, now_ns: int) -> None:
        """Ignore the ground's setpoints while the pose drifts: they would move the drone away."""
        pilot = self._autopilot
        if not pilot.positioning.is_drifting or pilot.landed or pilot.stream.stage is not Stage.FOLLOW:
            return
        pilot.stream.pull(Trigger.POSE_FAULT, now_ns)
        pilot.report(*pose_fault("pose drift"))
        pilot.fly(Task.HOLD, now_ns)

    def _execute(self, stage: Stage | None, now_ns: int) -> None:
        """Do what a stage that begins asks for."""
        pilot, loss = self._autopilot, self._autopilot.stream_loss
        match stage:
            case Stage.HOLD:
                holds = pilot.positioning.silent_s(now_ns) < _LEVEL_AFTER_S
                pilot.fly(Task.HOLD if holds else Task.LEVEL, now_ns, level_first=True)
            case Stage.LAND:
                if pilot.task not in (Task.LAND, Task.DESCEND):
                    pilot.divert(FlightMode.LAND, now_ns)
                pilot.pilot.brisk = True
            case Stage.DESCEND:
                pilot.divert(FlightMode.DESCEND, now_ns)
                pilot.pilot.brisk = True
            case Stage.LOST:
                pilot.report(Severity.CRITICAL, pilot.model.texts.stream_lost)
                if loss.mode is not None:
                    pilot.divert(loss.mode, now_ns, loss.task)
                elif not pilot.stream.lands:
                    pilot.fly(loss.task, now_ns)

    def check(self, now_ns: int, dt_s: float) -> None:
        """Everything that changes slowly: twenty times a second."""
        pilot = self._autopilot
        pilot.airframe.drain(dt_s)
        self._detect_contact()
        if not pilot.armed:
            self._flown = False
            self._landed_ns = now_ns
            self._unlatch(now_ns)
            return
        self._detect_landing(now_ns)
        self._disarm_when_done(now_ns)
        if pilot.armed and not pilot.landed:
            self._check_thrust(now_ns)
            self._check_position(now_ns)
            self._check_battery(now_ns)
            self._check_ground(now_ns)

    def _detect_contact(self) -> None:
        pilot = self._autopilot
        frame = pilot.airframe
        lift = frame.profile.thrust_n_of(frame.setpoint.thrust_norm) / frame.profile.mass_kg if pilot.armed else 0.0
        state = frame.state
        pilot.carried = self._contact.update(
            frame.t_ns, float(state.vel_lab_m_s[2]), lift * up_cos(state.q_lab_from_flu)
        )

    def _unlatch(self, now_ns: int) -> None:
        """After a stop: disarmed, and at rest for two seconds in which nobody asked it to arm."""
        pilot = self._autopilot
        state = pilot.airframe.state
        moves = hypot(*state.vel_lab_m_s) > _REST_M_S or hypot(*state.rate_flu_rad_s) > _REST_RAD_S
        self._rest_ns = now_ns if moves else max(self._rest_ns, pilot.latched_ns)
        if now_ns - self._rest_ns >= REST_NS:
            pilot.stream.pull(Trigger.RESTED, now_ns)

    def check_motors(self, now_ns: int) -> None:
        """Stop the motors of a drone that turns against its commands; a hundred times a second."""
        pilot = self._autopilot
        if self.watches_motors and self._failure.check(pilot.airframe):
            pilot.report(Severity.CRITICAL, "It turns against its commands, a motor may be dead: motors off")
            pilot.terminate(now_ns)

    @property
    def watches_motors(self) -> bool:
        """Whether `check_motors` is due at all."""
        pilot = self._autopilot
        return pilot.armed and not pilot.landed and "motor-failure" not in pilot.without

    def _check_thrust(self, now_ns: int) -> None:
        """Land on the remaining thrust where some is missing; stop the motors where it cannot keep the drone level."""
        pilot, missing = self._autopilot, self._contact.missing
        falls = self.watches_motors and self._failure.falls(now_ns, missing)
        attitude_lost = self._failure.is_attitude_lost(now_ns, pilot.airframe)
        pilot.pilot.set_thrust_share(self._failure.thrust_share if self._failure.fell else 1.0)
        if not falls:
            return
        if missing > _POWERLESS or attitude_lost:
            pilot.report(Severity.CRITICAL, "Its thrust is missing, a motor may be dead: motors off")
            pilot.terminate(now_ns)
            return
        if pilot.task not in (Task.LAND, Task.DESCEND):
            pilot.report(Severity.CRITICAL, "Part of its thrust is missing: landing on what is left")
            pilot.fail_safe(FlightMode.LAND, now_ns)

    def _detect_landing(self, now_ns: int) -> None:
        pilot = self._autopilot
        frame, belief = pilot.airframe, pilot.belief(now_ns)
        vx, vy, vz = belief.vel_lab_m_s
        thrust = frame.profile.thrust_n_of(frame.setpoint.thrust_norm) / frame.profile.weight_n
        quiet = pilot.carried or "touch-down" in pilot.without
        down = pilot.piloted and pilot.pilot.faded
        if not pilot.detector.update(now_ns, thrust, belief.pos_lab_m[2], vz, hypot(vx, vy), carried=quiet, faded=down):
            return
        if pilot.landed:
            self._landed_ns = now_ns
            pilot.stream.disown()
            pilot.report(Severity.INFO, pilot.model.texts.landed)
        else:
            self._flown = True
            self._failure = MotorFailure(self._vehicle)
            pilot.report(Severity.INFO, pilot.model.texts.takeoff)

    def _disarm_when_done(self, now_ns: int) -> None:
        pilot, timing = self._autopilot, self._autopilot.timing
        if not pilot.landed or not pilot.armed:
            return
        if not self._flown and pilot.stream.stage not in (Stage.LAND, Stage.DESCEND):
            wait_s, since_ns, reason = timing.disarm_idle_s, pilot.armed_ns, "auto preflight disarming"
        else:
            landing = pilot.task in (Task.LAND, Task.DESCEND)
            wait_s = timing.disarm_landing_s if landing else timing.disarm_flown_s
            since_ns, reason = self._landed_ns, "landing"
        if wait_s >= 0.0 and now_ns - since_ns >= round(wait_s * 1e9):
            pilot.disarm(now_ns, force=False, reason=reason)

    def _check_position(self, now_ns: int) -> None:
        """A place is held by a pose that is taken, and by level flight without one; then it comes down level."""
        pilot = self._autopilot
        silent_s = pilot.positioning.silent_s(now_ns)
        if pilot.task is Task.LEVEL and self._levelled and silent_s < _LEVEL_AFTER_S:
            self._levelled = False
            pilot.fly(Task.HOLD, now_ns)
        if pilot.task not in _ON_POSITION and not (pilot.task is Task.LEVEL and self._levelled):
            self._levelled = False
            return
        if silent_s >= _DESCEND_AFTER_S:
            self._levelled = False
            pilot.report(Severity.CRITICAL, pilot.model.texts.pose_lost)
            if pilot.stream.pull(Trigger.NO_POSE, now_ns) is None:
                pilot.fail_safe(FlightMode.DESCEND, now_ns)
            else:
                self._execute(Stage.DESCEND, now_ns)
        elif silent_s >= _LEVEL_AFTER_S and pilot.task is Task.HOLD and not pilot.positioning.is_drifting:
            self._levelled = True
            pilot.fly(Task.LEVEL, now_ns)

    def _check_battery(self, now_ns: int) -> None:
        pilot, timing = self._autopilot, self._autopilot.timing
        left = pilot.airframe.pack.remaining
        if left < timing.battery_low and not self._battery_low_reported:
            self._battery_low_reported = True
            pilot.report(Severity.WARNING, pilot.model.texts.battery_low)
        if left < timing.battery_critical and not self._battery_acted:
            self._battery_acted = True
            pilot.report(Severity.CRITICAL, pilot.model.texts.battery_critical)
            if timing.battery_action is not None:
                pilot.fail_safe(timing.battery_action, now_ns)

    def _check_ground(self, now_ns: int) -> None:
        pilot, timing = self._autopilot, self._autopilot.timing
        if self._ground.last_ns is None or timing.ground_loss is None:
            return
        if self._ground.silent(now_ns, timing.ground_loss_s):
            self._ground = LinkMonitor()
            pilot.report(Severity.CRITICAL, pilot.model.texts.ground_lost)
            pilot.fail_safe(timing.ground_loss, now_ns)
