"""The autopilot: armed or not, its mode, and who flies. It speaks no MAVLink; fail-safes: drone_agent.flight.failsafes.

One of three flies at any time: the stream of attitude targets (drone_agent.flight.guidance), the pilot
(drone_agent.flight.flying), or nobody (disarmed, or idling on the ground). What differs between autopilots is
asked of their model.
"""

from dataclasses import dataclass
from math import hypot

from drone_agent.autopilots.model import (
    AttitudeFailure,
    AutopilotModel,
    Fusion,
    ModeRow,
    Needs,
    StreamLoss,
    Task,
    Timing,
)
from drone_agent.autopilots.parameters import Parameters
from drone_agent.config import AutopilotConfig
from drone_agent.flight.flying import Pilot
from drone_agent.flight.landing import LandDetector
from drone_agent.flight.vehicle import Estimate, Vehicle
from drone_agent.guard.position import Belief
from formation.messages import Severity
from formation.model import Vec3Tuple
from formation.vehicle.profile import VehicleProfile
from wire.autopilots.table import STREAM_MODES, FlightMode
from wire.link_messages import Result

CONTROL_NS = 10_000_000
_CONTROL_S = CONTROL_NS * 1e-9


@dataclass(frozen=True, slots=True)
class Note:
    """A text for the operator."""

    severity: Severity
    text: str


class SetpointStream:
    """Of one vehicle. An autopilot asks neither whose setpoints they are nor how old."""

    def __init__(self) -> None:
        self.last_ns: int | None = None
        """When the newest came."""
        self.lost = False
        """Whether it timed out, and none has come since."""
        self._followed = False

    def note(self, now_ns: int, *, in_mode: bool) -> None:
        """A setpoint came; in_mode: the autopilot follows setpoints."""
        self.last_ns = now_ns
        self._followed, self.lost = in_mode, False

    def begin(self, now_ns: int, time_out_s: float) -> None:
        """A mode begins that follows setpoints: a stream that is alive may time out from now on."""
        self._followed, self.lost = not self.is_silent(now_ns, time_out_s), False

    def end(self) -> None:
        """Another mode begins, or the motors are off."""
        self._followed = self.lost = False

    def is_silent(self, now_ns: int, time_out_s: float) -> bool:
        """Whether none has come for so long, or ever."""
        return self.last_ns is None or now_ns >= self.last_ns + round(time_out_s * 1e9)

    def deadline_ns(self, time_out_s: float) -> int | None:
        """When it will have timed out; None while it is not followed."""
        if not self._followed or self.lost or self.last_ns is None:
            return None
        return self.last_ns + round(time_out_s * 1e9)


class Autopilot:
    """One vehicle's commander."""

    def __init__(
        self,
        config: AutopilotConfig,
        model: AutopilotModel,
        parameters: Parameters,
        vehicle: Vehicle,
        estimator: Estimate,
        configured: VehicleProfile,
    ) -> None:
        """configured: what it is set up for, whatever it really flies."""
        self.model = model
        self.parameters = parameters
        self.vehicle = vehicle
        self.estimator = estimator
        self.configured = configured
        self.armed = False
        self.mode = model.boot_mode
        self.failsafe = False
        self.home: Belief | None = None
        self.notes: list[Note] = []
        self.detector = LandDetector()
        self.stream = SetpointStream()
        self.carried = False  # by the floor, as the accelerometer against the thrust says
        self.armed_ns = 0
        self.origin: Vec3Tuple | None = config.origin if config.pose == "own" else None
        """Of the estimate's frame on the globe, if anybody has said."""
        self.pilot = Pilot(configured)
        self.piloted = False
        """Whether the agent flies by itself, so that `control` is due every CONTROL_NS."""
        self._mode_after_disarm = model.boot_mode
        self._rise_m: float | None = None
        parameters.on_change = self._reread
        self._reread()

    @property
    def row(self) -> ModeRow:
        """The present mode's row of the model's table."""
        return self.model.modes[self.mode]

    @property
    def landed(self) -> bool:
        """Whether it detects that it stands on the ground."""
        return self.detector.landed

    @property
    def task(self) -> Task:
        """What is being flown."""
        if not self.armed:
            return Task.OFF
        return self.pilot.task if self.piloted else Task.EXTERNAL

    @property
    def in_stream_mode(self) -> bool:
        """Whether attitude targets rule, or would if they came."""
        return self.armed and self.mode in STREAM_MODES

    @property
    def belief(self) -> Belief:
        """Where it thinks it is."""
        return self.estimator.belief()

    def report(self, severity: Severity, text: str, *fills: str) -> None:
        """Send the operator a text; an empty one is not sent."""
        if text:
            self.notes.append(Note(severity, text.format(*fills)))

    # Arming

    def arming_fault(self, now_ns: int) -> str | None:
        """Why it will not arm now, or None."""
        row = self.row
        if not row.may_arm:
            return self.model.texts.not_armable.format(row.label)
        if self.vehicle.pack.remaining < self.timing.battery_critical:
            return "low battery"
        return self.missing(row.needs, now_ns)

    def missing(self, needs: Needs, now_ns: int) -> str | None:
        """The first of a mode's needs that is not met, in words."""
        if Needs.POSITION in needs:
            fault = self.position_fault(now_ns)
            if fault is not None and not (self.armed and self.estimator.valid(now_ns)):
                return self.model.texts.no_position.format(fault)
        if Needs.GLOBE in needs and self.origin is None and self.armed:
            return "no valid global position estimate"
        if Needs.STREAM in needs and self.stream.is_silent(now_ns, self.stream_loss.after_s):
            return self.model.texts.stream_lost
        if Needs.PILOT in needs:
            return "manual control signal lost"
        return "no valid mission available" if Needs.MISSION in needs else None

    def position_fault(self, now_ns: int) -> str | None:
        """Why there is no position to arm on, or None."""
        if self.model.table.needs_origin and self.origin is None:
            return "EKF origin not set"
        return self.estimator.fault(now_ns)

    def arm(self, now_ns: int, *, force: bool = False) -> Result:
        """Arm after the checks, or past them by force; arming what is armed is accepted."""
        if self.armed:
            return Result.ACCEPTED
        fault = None if force else self.arming_fault(now_ns)
        if fault is not None:
            for words in self.model.texts.arm_rejected:
                self.report(Severity.CRITICAL, words, fault)
            return self.model.rejected
        self.armed = self.vehicle.armed = True
        self.failsafe = False
        self.armed_ns = now_ns
        self.home = self.belief
        self.pilot.set_home(self.home)
        self.report(Severity.INFO, self.model.texts.armed)
        self._start_task(now_ns)
        return Result.ACCEPTED

    def disarm(self, *, force: bool, reason: str) -> Result:
        """Stop the motors: on the ground, or anywhere by force."""
        if not (self.landed or force or not self.armed):
            self.report(Severity.CRITICAL, self.model.texts.disarm_rejected)
            return self.model.rejected
        self.stream.end()
        if not self.armed:
            return Result.ACCEPTED
        if not self.landed:
            self.vehicle.stop()
        self.armed = self.vehicle.armed = False
        self.vehicle.order_now(self.pilot.idle())
        self.piloted = self.failsafe = False
        self.detector.landed = True
        if self.model.restores_mode and self.mode is not FlightMode.TERMINATION:
            self.mode = self._mode_after_disarm
        self.report(Severity.INFO, self.model.texts.disarmed, reason)
        return Result.ACCEPTED

    def terminate(self) -> Result:
        """Motors off wherever it is."""
        if not self.armed:
            return Result.DENIED
        if FlightMode.TERMINATION in self.model.modes:
            self.mode = FlightMode.TERMINATION
        return self.disarm(force=True, reason="flight termination")

    # Modes

    def change_mode(self, mode: FlightMode, now_ns: int) -> Result:
        """The operator's choice of mode: any while disarmed (arming checks it), armed only what can be flown."""
        row = self.model.modes.get(mode)
        if row is None or self.mode is FlightMode.TERMINATION:
            return self.model.rejected
        fault = self.missing(row.needs, now_ns) if self.armed else None
        if fault is not None:
            self.report(Severity.CRITICAL, self.model.texts.mode_rejected, row.label, fault)
            return self.model.rejected
        self.failsafe = False
        self.enter(mode, now_ns)
        return Result.ACCEPTED

    def take_off(self, now_ns: int, height_m: float | None) -> Result:
        """Climb to `height_m` above here, or to the autopilot's own take-off height."""
        if self.model.takeoff_in_own_mode:
            self._rise_m = height_m
            return self.change_mode(FlightMode.TAKEOFF, now_ns)
        if not self.in_stream_mode or not self.landed or height_m is None or height_m <= 0.0:
            return self.model.rejected
        self.fly(Task.TAKEOFF, rise_m=height_m)
        return Result.ACCEPTED

    def land(self, now_ns: int) -> Result:
        """Come down here."""
        result = self.change_mode(FlightMode.LAND, now_ns)
        if result is Result.ACCEPTED:
            self.report(Severity.INFO, self.model.texts.landing)
        return result

    def go_to(self, now_ns: int, goal_lab_m: Vec3Tuple, yaw_rad: float | None) -> Result:
        """Hold at another position, in the estimate's frame."""
        if not self.armed or self.landed:
            return self.model.rejected
        if self.model.takeoff_in_own_mode:
            result = self.change_mode(FlightMode.HOLD, now_ns)
            if result is not Result.ACCEPTED:
                return result
        elif not self.in_stream_mode:
            return self.model.rejected
        self.fly(Task.HOLD)
        self.pilot.go_to(goal_lab_m, yaw_rad)
        return Result.ACCEPTED

    def enter(self, mode: FlightMode, now_ns: int) -> None:
        """Be in `mode` and, if armed, do what it does."""
        self.mode = mode
        if self.row.may_arm or mode is FlightMode.TERMINATION:
            self._mode_after_disarm = mode
        if self.armed:
            self._start_task(now_ns)

    def divert(self, mode: FlightMode, now_ns: int, task: Task | None = None) -> None:
        """Leave what was asked for: show `mode` and fly its task, or `task`; without a position, descend."""
        self.failsafe = True
        self.enter(mode, now_ns)
        if not self.armed:
            return
        flown = task or self.row.task
        if flown is Task.OFF:
            self.terminate()
        elif flown in (Task.HOLD, Task.RETURN, Task.LAND) and not self.estimator.valid(now_ns):
            self.fly(Task.DESCEND)
        elif task is not None:
            self.fly(task)

    def fly(self, task: Task, *, rise_m: float = 0.0) -> None:
        """Let the pilot take `task` up from here."""
        belief = self.belief
        goal_m = belief.pos_lab_m[2] + rise_m
        if task is Task.RETURN:
            goal_m = self._return_height_m(belief)
        self.pilot.begin(task, belief, goal_m=goal_m)
        self.piloted = True

    # The steady rate

    def control(self, now_ns: int) -> None:
        """The pilot's next setpoint, every CONTROL_NS while `piloted`."""
        if self.landed and not self.pilot.asks_to_rise:
            self.vehicle.order_now(self.pilot.idle())
            return
        belief = self.belief
        setpoint = self.pilot.step(belief, self.timing, _CONTROL_S, carried=self.carried)
        self.vehicle.order_now(setpoint)
        if not self.pilot.arrived(belief):
            return
        if self.pilot.task is Task.TAKEOFF:
            if self.model.takeoff_in_own_mode:
                self.enter(FlightMode.HOLD, now_ns)
            else:
                self.fly(Task.HOLD)
        elif self.pilot.task is Task.RETURN:
            self.fly(Task.LAND)

    def _start_task(self, now_ns: int) -> None:
        """Do what the mode does. A stream that is alive takes over with its next target; until then, hold."""
        task = self.row.task
        self.stream.end()
        if task is Task.EXTERNAL:
            self.stream.begin(now_ns, self.stream_loss.after_s)
            task = Task.HOLD if self.estimator.valid(now_ns) else Task.LEVEL
        if task is Task.TAKEOFF:
            rise_m = self._rise_m if self._rise_m is not None else self.timing.takeoff_height_m
            self._rise_m = None
            self.fly(task, rise_m=rise_m if self.landed else 0.0)
        elif task is not Task.OFF:
            self.fly(task)

    def _return_height_m(self, belief: Belief) -> float:
        """Height to fly home at: a cone over the home place, never below the present height."""
        home = self.home or belief
        dx, dy = (h - p for h, p in zip(home.pos_lab_m[:2], belief.pos_lab_m[:2], strict=True))
        timing = self.timing
        above_m = min(timing.return_height_m, timing.return_slope * hypot(dx, dy))
        return max(belief.pos_lab_m[2], home.pos_lab_m[2] + above_m)

    def _reread(self) -> None:
        """What the parameters say, as they are now."""
        self.timing: Timing = self.model.timing(self.parameters)
        """Its own waits."""
        self.stream_loss: StreamLoss = self.model.stream_loss(self.parameters)
        """What the autopilot itself does about a dead stream."""
        self.fusion: Fusion = self.model.fusion(self.parameters)
        """How its estimator fuses poses."""
        self.attitude_failure: AttitudeFailure | None = self.model.attitude_failure(self.parameters)
        """When it stops its motors since it lies on its side."""
