"""The flight: the phase, what each drone is led to in it, and how what is seen moves it on. No bytes, no control.

A new phase of flight is a row of formation.safety.phases.TABLE for each trigger that leads to it or from it, a row of
`PHASES` here, and the function of `Flight` that watches for its end.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from formation.config import CONFIGURED, FlightConfig, LabConfig
from formation.control.stack import Stages
from formation.guidance.plan import HERE, IDLE, STILL, Mode, Plan, Setpoint, Velocity
from formation.guidance.preview import trajectory_from
from formation.guidance.shape import Shape, configured
from formation.guidance.trajectory import Trajectory
from formation.guidance.transition import Transition
from formation.maths.arrays import Bool, Float, Vec3
from formation.maths.frames import rotate_about_z
from formation.messages import Cause, Event, EventCode, Phase, PhaseChange, Severity
from formation.safety.phases import AFTER_STOP, AIRBORNE, Trigger, advance
from formation.safety.rules import Verdict
from formation.safety.rules_table import LEADER_POSITION_ERROR_M
from gcs.drones.drone import TAKE_OFF_S, Drone
from gcs.drones.land_detector import NEAR_FLOOR_M
from gcs.drones.link_state import DroneLink
from gcs.drones.stages import Stage
from gcs.drones.stages import Trigger as DroneTrigger
from gcs.landing import FIRST_FRAME_NS, Descent, descent, landed_text, landing_spots, late_text
from gcs.moves import HELD_NS
from gcs.safety import OpenAlarms

HOME = "home"
"""The name of the shape in which the drones took off."""
ARMING_NS = 12_000_000_000
SETTLE_NS = 1_000_000_000
AT_HEIGHT_M = 0.05
RISING_NS = round(2e9 * TAKE_OFF_S)
LED_THERE_M, LED_AT_REST_M_S2 = 0.001, 0.001
IN_SLOT_M = 0.01
OVER_SPOT_M = 0.05


@dataclass(slots=True)
class Home:
    """A return to where the drones took off. shape_before: which is flown again after it; reached: they are there."""

    shape_before: Shape
    reached: bool = False


class Moved(NamedTuple):
    """A drone that an operator moves: at which velocity, since when."""

    drone: Drone
    velocity: Velocity
    at_ns: int


class Flight:
    """One phase for the swarm. `pull` is the only way it changes.

    armed: in ARMED, whether every drone has reported off-board and armed. trajectory: the leader's, as last begun at
    trajectory_start_ns, from x, y, z, heading trajectory_from (4). trajectory_name: of the one that is flown next, or
    now; config: the lab with that one, lab: as it was given. interrupted_s: how far along it a hold came, from where it
    goes on if it is resumed; begin_ns: when it is to begin, if that was asked for.
    """

    def __init__(self, config: LabConfig, drones: tuple[Drone, ...], t0_ns: int) -> None:
        self.phase = Phase.GROUND
        self.entered_ns = t0_ns
        self.cause, self.cause_code = "start", Cause.START
        self.shape: Shape = configured(config)
        self.rise_m: tuple[float, ...] = ()
        self.lab = self.config = config
        self.trajectory_name = CONFIGURED
        self.trajectory_start_ns: int | None = None
        self.trajectory: Trajectory | None = None
        self.trajectory_from: Float | None = None
        self.interrupted_s: float | None = None
        self.begin_ns: int | None = None
        self.armed = False
        self.start_yaw_rad = 0.0
        """The leader's heading as it took off."""
        self._home: Home | None = None
        self.alarms = OpenAlarms(drones)
        self._too_late = False
        self._moved: Moved | None = None
        self.events: list[Event] = []
        self.changes: list[PhaseChange] = [PhaseChange(Phase.GROUND, self.cause, self.cause_code)]
        self._drones = drones
        self._settled_since_ns: int | None = None
        self._spots: Float | None = None
        self._descent: Descent | None = None

    def _report(self, severity: Severity, text: str, code: EventCode, subject: str = "") -> None:
        self.events.append(Event(severity, "flight", text, code=code, subject=subject))

    def exclude(self, excluded: Collection[str], now_ns: int) -> None:
        """Leave out these drones, by body, and no others. In flight one that is taken in arms and rises alone."""
        for drone in self._drones:
            name, before = drone.link.name, drone.excluded
            drone.excluded = name in excluded
            if drone.excluded != before:
                drone.rises = not drone.excluded and self.phase is Phase.HOLD
                if drone.rises:
                    drone.setpoint = IDLE
                    drone.arm(now_ns)
                text = f"{name} is left out" if drone.excluded else f"{name} takes part again"
                self._report(Severity.NOTICE, text, EventCode.EXCLUDED, name)

    def exchange(self, drone: Drone, link: DroneLink, now_ns: int) -> None:
        """Have the drone behind that link take this one's place, on the ground."""
        before, name = drone.link.sysid, link.name
        drone.exchange(link, now_ns)
        text = f"{name}: system {link.sysid} takes the place of system {before}"
        self._report(Severity.NOTICE, text, EventCode.REPLACED, name)

    def leave(self, body: str, spot_m: tuple[float, float]) -> None:
        """Land that drone alone, there; the others fly on without it."""
        if drone := self.drone(body):
            drone.leaving_to, drone.rises = spot_m, False
            drone.floor.reset()
            text = f"{body} lands alone at x {spot_m[0]:.2f}, y {spot_m[1]:.2f}"
            self._report(Severity.NOTICE, text, EventCode.EXCLUDED, body)

    @property
    def is_led_home(self) -> bool:
        """Whether the drones are led to where they took off, or are there."""
        return self._home is not None

    @property
    def excluded(self) -> tuple[str, ...]:
        """The drones that take no part in the flight, by body."""
        return tuple(drone.link.name for drone in self._drones if drone.excluded)

    @property
    def _participants(self) -> list[Drone]:
        return [drone for drone in self._drones if not drone.excluded]

    @property
    def forming(self) -> Bool:
        """Which followers take a slot, (followers,)."""
        followers = self._drones[-len(self.config.followers) :]
        return np.array([not drone.excluded and drone.leaving_to is None for drone in followers])

    def plan(self) -> Plan:
        """The plan for the control now; a drone without setpoints is not led, and all others keep clear of it."""
        setpoints = tuple([drone.led_to for drone in self._drones])
        resumes = self.interrupted_s is not None
        return Plan(setpoints, self.shape, self.trajectory_start_ns, self.rise_m, self.trajectory_name, resumes)

    def choose(self, trajectory: str, about: str) -> None:
        """Have the leader fly that one of the lab's trajectories when it is started next; about: it in words."""
        self.trajectory_name, self.config, self.interrupted_s = trajectory, self.lab.flying(trajectory), None
        self._report(Severity.NOTICE, f"trajectory {trajectory}: {about}", EventCode.TRAJECTORY)

    def choose_shape(self, shape: Shape) -> None:
        """Have the next start take up that shape."""
        self.shape = shape

    def form(self, transition: Transition, begin_ns: int | None) -> None:
        """Take up the formation; the leader's trajectory begins then, or as soon as all slots are taken."""
        self.change_formation(transition)
        self.begin_ns = begin_ns

    def change_formation(self, transition: Transition) -> None:
        """Change the formation to a shape by a transition."""
        self.shape, self.rise_m = transition.shape, transition.rise_m
        change = (
            f"shape {transition.shape.name} in {transition.duration_s:.1f} s; "
            f"nearest on the way {transition.separation_m:.2f} m, "
            f"{np.count_nonzero(transition.rise_m)} of {len(transition.rise_m)} pass above or below"
        )
        self._report(Severity.NOTICE, change, EventCode.SHAPE)

    def start_shape(self) -> Shape:
        """The shape in which the drones took off, about their leader; who is left out keeps its slot."""
        x_m, y_m, _ = self._drones[0].start_lab_m or (0.0, 0.0, 0.0)
        offsets_m = list(self.shape.offset_lead_m)
        for k, drone in enumerate(self._drones[-len(offsets_m) :]):
            if drone.start_lab_m is not None:
                away_m = np.array([drone.start_lab_m[0] - x_m, drone.start_lab_m[1] - y_m, 0.0])
                x, y, _ = rotate_about_z(np.array(-self.start_yaw_rad), away_m).tolist()
                offsets_m[k] = x, y, 0.0
        return Shape(HOME, tuple(offsets_m), self.shape.yaw_offset_rad)

    def drone(self, body: str) -> Drone | None:
        """The drone of that body; None where there is none."""
        return next((drone for drone in self._drones if drone.link.name == body), None)

    @property
    def moved_body(self) -> str | None:
        """Whom an operator moves; None where nobody is moved."""
        return None if self._moved is None else self._moved.drone.link.name

    def move(self, drone: Drone, velocity: Velocity, now_ns: int) -> None:
        """Have a drone go on at a velocity for HELD_NS; that ends a leader's trajectory. Rest at first does nothing."""
        if self._moved is None and velocity == STILL:
            return
        if self._moved is None:
            self._report(Severity.NOTICE, f"{drone.link.name} is moved by hand", EventCode.MOVED, drone.link.name)
        self._moved = Moved(drone, velocity, now_ns)
        self.trajectory_start_ns = self.interrupted_s = None
        drone.setpoint = replace(_brake(self.config.flight), vel_lab=velocity)

    def go_home(self, transition: Transition, now_ns: int) -> None:
        """Take up the shape in which the drones took off, and have the leader lead them there."""
        self._home = self._home or Home(self.shape)
        self.pull(Trigger.START, Cause.OPERATOR, "operator: home", now_ns)
        self.trajectory_start_ns, self._settled_since_ns = None, None
        self.change_formation(transition)
        self._drones[0].setpoint = Setpoint(Mode.LAB, HERE, speed_m_s=self.config.flight.formation_change_m_s)

    def resume(self, transition: Transition, now_ns: int) -> None:
        """Take up the formation, and have the leader go on along its trajectory where a hold interrupted it."""
        self.change_formation(transition)
        interrupted_s = self.interrupted_s
        self.pull(Trigger.START, Cause.OPERATOR, "operator: resume", now_ns)
        self.interrupted_s = interrupted_s

    def first_to_disarm(self, now_ns: int) -> tuple[str, float] | None:
        """Whose own time-out ends first for want of a take-off, and in how many seconds; None where nobody's runs."""
        running = [(drone.disarms_in_s(now_ns), drone.link.name) for drone in self._drones]
        left = [(left_s, name) for left_s, name in running if left_s is not None]
        return (min(left)[1], min(left)[0]) if left else None

    def trajectory_done(self, now_ns: int) -> bool:
        """Whether the leader's trajectory has been flown to its end; a leader that is only observed has none."""
        start, path = self.trajectory_start_ns, self.trajectory
        return start is not None and path is not None and now_ns - start >= round(path.duration_s * 1e9)

    def trajectory_progress(self, now_ns: int) -> tuple[Trajectory | None, float]:
        """The leader's trajectory and the time along it, s; None, 0 before it has begun."""
        if self.trajectory is None or self.trajectory_start_ns is None:
            return None, 0.0
        return self.trajectory, (now_ns - self.trajectory_start_ns) * 1e-9

    @property
    def landing_end_ns(self) -> int | None:
        """When the landing that is going on is over at the latest; None where there is none."""
        return None if self._descent is None else self._descent.end_ns

    def pull(self, trigger: Trigger, code: Cause, cause: str, now_ns: int) -> None:
        """Change the phase, if the trigger means anything in this one. cause: the same as its code, in words."""
        after = advance(self.phase, trigger)
        if after is not None and after is not self.phase:
            self._enter(after, code, cause, now_ns)

    def stop(self, now_ns: int) -> None:
        """Have every drone's motors cut, whatever goes on and whoever takes part; then change the phase."""
        for drone in self._drones:
            drone.enter(DroneTrigger.STOP, now_ns)
            drone.pursue(now_ns)
        self.pull(Trigger.STOP, Cause.OPERATOR, "operator: stop", now_ns)

    def judge(self, verdict: Verdict, rejected: Sequence[int], now_ns: int) -> None:
        """Apply the verdict of the safety rules. rejected: why the mocap rejects each body's pose (Rejection)."""
        self.events += self.alarms.update(verdict.changes, rejected, now_ns)
        for drone in self._drones:
            if verdict.cut[drone.index]:
                drone.enter(DroneTrigger.CUT, now_ns)
            elif verdict.release[drone.index]:
                drone.enter(DroneTrigger.RELEASE, now_ns)
        fault, trigger = verdict.fault, verdict.trigger
        if fault is not None and trigger is not None:
            text = self.alarms.text(fault, rejected, now_ns) if fault.began else fault.text
            self.pull(trigger, Cause.FAULT, text, now_ns)

    def update(self, stages: Stages | None, now_ns: int) -> None:
        """Update the phase and every drone's stage. stages: of this tick's frame, if any."""
        if stages is not None and self.phase in AIRBORNE:
            self._detect_lift_off(stages)
        for drone in self._drones:
            if drone.detect_pilot(now_ns):
                name = drone.link.name
                text = f"{name}: a pilot flies it ({drone.link.mode}), it is left alone"
                self._report(Severity.WARNING, text, EventCode.PILOT, name)
        self._watch_moved(now_ns)
        PHASES[self.phase].watch(self, stages, now_ns)
        if stages is not None and self.phase in (Phase.HOLD, Phase.FORMATION):
            self._watch_leaving(stages, now_ns)
        for drone in self._drones:
            drone.pursue(now_ns)
            if (self.phase is Phase.GROUND or drone.stage is Stage.JOIN) and drone.reached:
                drone.enter(DroneTrigger.DONE, now_ns)

    def _enter(self, phase: Phase, code: Cause, cause: str, now_ns: int) -> None:
        before, self.phase, self.entered_ns = self.phase, phase, now_ns
        self.cause, self.cause_code = cause, code
        if phase is not Phase.FORMATION:
            self.begin_ns = None
        if phase is not Phase.HOLD:
            self.interrupted_s = None
        elif self.trajectory_start_ns is not None and not self.trajectory_done(now_ns):
            self.interrupted_s = self.trajectory_progress(now_ns)[1]
        self.trajectory_start_ns, self._settled_since_ns, self._spots, self._descent = None, None, None, None
        self.armed, self._too_late, self._moved = False, False, None
        if self._home is not None and phase is not Phase.FORMATION:
            self.shape, self._home = self._home.shape_before, None
        self.changes.append(PhaseChange(phase, cause, code))
        entered = f"{before.name} -> {phase.name}: {cause}"
        self._report(Severity.NOTICE, entered, EventCode.PHASE)
        for drone in self._drones:
            match before, phase:
                case _, Phase.ARMED:
                    drone.arm(now_ns)
                case Phase.GROUND, Phase.HOLD:
                    drone.join(now_ns)
                case Phase.GROUND, Phase.LAND:
                    drone.land_alone(now_ns)
                case _ if drone.joining(now_ns):
                    drone.enter(DroneTrigger.RELEASE, now_ns)
            drone.rises = False
            if drone.leaving_to is not None and phase in (Phase.HOLD, Phase.FORMATION):
                continue
            drone.leaving_to = None
            drone.lead(PHASES[phase].setpoint(self.config.flight), PHASES[phase].drones, now_ns)
            if phase is Phase.LAND and not drone.floor.lifted:
                drone.stand(now_ns)
            if phase is Phase.LAND and before is Phase.GROUND:
                drone.setpoint = IDLE  # its motion is not ours, and it is sent none

    def _detect_lift_off(self, stages: Stages) -> None:
        steady = self.phase in (Phase.FORMATION, Phase.HOLD)
        positions_m, ages_s = stages.state.pos_lab_m.tolist(), stages.state.age_s.tolist()
        for drone, thrust_norm in zip(self._drones, stages.target.thrust_norm.tolist(), strict=True):
            x_m, y_m, z_m = positions_m[drone.index]
            was_seen = ages_s[drone.index] < 0.1
            drone.floor.detect_lift_off(drone.link, (x_m, y_m, z_m), was_seen, thrust_norm)
            if steady and drone.leaving_to is None and not drone.rises:
                drone.floor.update_flying_thrust(thrust_norm)

    def _watch_arming(self, stages: Stages | None, now_ns: int) -> None:
        unready = [drone for drone in self._drones if not drone.reached]
        is_overdue = now_ns - self.entered_ns > ARMING_NS
        if stages is not None:
            self.start_yaw_rad = float(stages.state.yaw_rad[0])
            for drone in self._drones:
                drone.note_start(stages.state.pos_lab_m[drone.index], now_ns)
        if not unready:
            self._watch_countdown(now_ns)
        elif self.armed:
            cause = unready[0].idle_disarm_text or f"{unready[0].link.name} is no longer armed and off-board"
            self.pull(Trigger.DISARMED, Cause.DISARMED, cause, now_ns)
        elif failed := [d for d in unready if d.rejects(now_ns)] or (unready if is_overdue else []):
            self.pull(Trigger.DISARMED, Cause.NOT_ARMED, "; ".join(_why_not_armed(drone) for drone in failed), now_ns)

    def _watch_countdown(self, now_ns: int) -> None:
        """Report once how much time is left for a take-off, and once when it is too late."""
        before, self.armed = self.armed, True
        first = self.first_to_disarm(now_ns)
        if first is None:
            return
        name, left_s = first
        if not before:
            window_s = max(left_s - TAKE_OFF_S, 0.0)
            text = f"every drone is armed; {name} disarms itself in {left_s:.1f} s: take off within {window_s:.1f} s"
            self._report(Severity.NOTICE, text, EventCode.TAKE_OFF_WINDOW)
        if left_s < TAKE_OFF_S and not self._too_late:
            self._too_late = True
            text = f"too late for a take-off: {name} disarms itself in {left_s:.1f} s"
            self._report(Severity.WARNING, text, EventCode.TAKE_OFF_TOO_LATE)

    def _watch_take_off(self, stages: Stages | None, now_ns: int) -> None:
        """A drone that disarms on the floor ends the take-off for all; those in the air land, it is not in the air."""
        for drone in self._drones:
            if drone.flown and not drone.floor.lifted and not drone.link.armed:
                cause = drone.idle_disarm_text or f"{drone.link.name} is disarmed, still on the floor"
                self.pull(Trigger.LAND, Cause.DISARMED, cause, now_ns)
                return
        if stages is None:
            return
        flown = [i for i, drone in enumerate(self._drones) if drone.flown]
        if are_at_height(stages, flown, [self._drones[i].index for i in flown], self.config.flight.altitude_m):
            self.pull(Trigger.AT_HEIGHT, Cause.AT_HEIGHT, "every drone is at its height", now_ns)

    def _watch_joining(self, stages: Stages | None, now_ns: int) -> None:
        """A drone that began to land while it was being taken over is not led up again."""
        for i, drone in enumerate(self._drones):
            if drone.rises and stages is not None:
                self._watch_rising(i, drone, stages, now_ns)
            if drone.stage is Stage.JOIN and drone.is_coming_down:
                self.pull(Trigger.LAND, Cause.LANDS_ITSELF, f"{drone.link.name} has begun to land meanwhile", now_ns)
                return

    def _watch_rising(self, i: int, drone: Drone, stages: Stages, now_ns: int) -> None:
        """Arm and lead up who joins, alone; one that fails to do so lands alone, and nobody else is led anywhere."""
        name, lasted_ns, failed = drone.link.name, now_ns - drone.since_ns, ""
        here_m, flight = stages.state.pos_lab_m[drone.index], self.config.flight
        if drone.stage is Stage.ARM:
            drone.note_start(here_m, now_ns)
            if drone.reached:
                drone.lead(_take_off(flight), DroneTrigger.LEAD, now_ns)
            elif drone.rejects(now_ns) or lasted_ns > ARMING_NS:
                failed = _why_not_armed(drone)
        elif drone.stage is not Stage.FOLLOW:  # released, cut or piloted: each has its own end
            drone.rises = False
        elif are_at_height(stages, [i], [drone.index], flight.altitude_m):
            drone.rises, drone.setpoint = False, _brake(flight)
            self._report(Severity.NOTICE, f"{name} has joined: `gcs start` leads on", EventCode.EXCLUDED, name)
        elif not drone.link.armed or lasted_ns > RISING_NS + (flight.altitude_m / flight.climb_m_s) * 2e9:
            failed = "it does not rise to its height"
        elif float(np.linalg.norm(stages.command.e_lead_m[i, :2])) > LEADER_POSITION_ERROR_M:
            failed = "it drifts from where it rises"
        if failed:
            self._report(Severity.WARNING, f"{name} does not join: {failed}", EventCode.EXCLUDED, name)
            self.leave(name, (float(here_m[0]), float(here_m[1])))
            if not drone.floor.lifted or drone.floor.height_m < NEAR_FLOOR_M:
                drone.stand(now_ns)

    def _watch_moved(self, now_ns: int) -> None:
        """Hold a drone whose velocity nobody has confirmed: whoever moved it is gone, or cannot be heard."""
        moved = self._moved
        if moved is None or now_ns - moved.at_ns <= HELD_NS:
            return
        self._moved = None
        if moved.velocity == STILL:
            return
        name = moved.drone.link.name
        text = f"{name} is moved by nobody any more: no velocity for {HELD_NS * 1e-9:g} s"
        moved.drone.setpoint = _brake(self.config.flight)
        self._report(Severity.WARNING, text, EventCode.MOVED, name)
        self.pull(Trigger.HOLD, Cause.INPUT_LOST, text, now_ns)

    def _watch_slots(self, stages: Stages | None, now_ns: int) -> None:
        """Start the leader's trajectory once every slot has been taken for a second."""
        is_moved = self._home is None and self.config.leader.sysid and self._drones[0].setpoint.mode is Mode.LAB
        if stages is None or self.trajectory_start_ns is not None or is_moved:
            return
        if float(slot_distances_m(stages, self.shape)[self.forming].max()) > IN_SLOT_M:
            self._settled_since_ns = None
        elif self._settled_since_ns is None:
            self._settled_since_ns = now_ns
        elif self._home is not None and now_ns - self._settled_since_ns >= SETTLE_NS:
            self._lead_home(stages, self._home)
        elif now_ns >= max(self._settled_since_ns + SETTLE_NS, self.begin_ns or 0):
            self._begin_trajectory(stages, self._settled_since_ns + SETTLE_NS, now_ns)

    def _begin_trajectory(self, stages: Stages, settled_ns: int, now_ns: int) -> None:
        """Begin it now, resume it where it was interrupted, or have it begun at the time that was asked for."""
        if self.interrupted_s is not None:
            self.trajectory_start_ns = now_ns - round(self.interrupted_s * 1e9)
            return
        self.trajectory_start_ns = now_ns
        if self.begin_ns is not None and settled_ns <= self.begin_ns:
            self.trajectory_start_ns = self.begin_ns
        elif self.begin_ns is not None:
            text = (
                f"the trajectory begins {(now_ns - self.begin_ns) * 1e-9:.1f} s late: not every slot was taken in time"
            )
            self._report(Severity.WARNING, text, EventCode.TRAJECTORY)
        self.trajectory_from = np.array([*stages.state.pos_lab_m[0], stages.state.yaw_rad[0]])
        self.trajectory = trajectory_from(self.config, self.trajectory_from)

    def _lead_home(self, stages: Stages, home: Home) -> None:
        """Lead the leader to above where it took off, in the heading that it had."""
        leader, speed_m_s = self._drones[0], self.config.flight.formation_change_m_s
        if leader.start_lab_m is None:  # taken over since: then no home was asked for
            return
        x_m, y_m, _ = leader.start_lab_m
        leader.setpoint = Setpoint(Mode.LAB, (x_m, y_m, None), self.start_yaw_rad, speed_m_s)
        at_m = stages.state.pos_lab_m[leader.index]
        if not home.reached and hypot(at_m[0] - x_m, at_m[1] - y_m) < OVER_SPOT_M:
            home.reached = True
            text = "every drone is above where it took off: land"
            self._report(Severity.NOTICE, text, EventCode.HOME)

    def _watch_landing(self, stages: Stages | None, now_ns: int) -> None:
        if stages is not None:
            self._lead_down(stages, now_ns)
            for i in range(len(self._drones)):
                self._watch_descent(i, stages, now_ns)
        for drone in self._drones:  # a drone that lands or holds by itself does not follow
            if drone.link.armed and not drone.link.offboard and not drone.floor.touched and not drone.joining(now_ns):
                drone.enter(DroneTrigger.RELEASE, now_ns)
        if not any(drone.is_awaited_down(now_ns) for drone in self._drones):
            self._finish_landing(landed_text(self._participants, now_ns), now_ns)
        elif stages is not None or now_ns - self.entered_ns > FIRST_FRAME_NS:
            self._end_landing(now_ns)

    def _watch_descent(self, i: int, stages: Stages, now_ns: int) -> None:
        drone = self._drones[i]
        vz_m_s, above_m = float(stages.state.vel_lab_m_s[drone.index, 2]), float(stages.command.e_lead_m[i, 2])
        if drone.floor.detect_touch_down(drone.link, vz_m_s, above_m, float(stages.target.thrust_norm[i]), now_ns):
            drone.stand(now_ns)
        if drone.flown and drone.floor.is_not_descending(above_m, now_ns):
            self._hand_over(drone, "does not come down", now_ns)

    def _watch_leaving(self, stages: Stages, now_ns: int) -> None:
        """Those that land alone, until they are disarmed and take no part any more."""
        for i, drone in enumerate(self._drones):
            if drone.leaving_to is None:
                continue
            self._lead_over_and_down(drone, stages.state.pos_lab_m[drone.index], drone.leaving_to, now_ns)
            self._watch_descent(i, stages, now_ns)
            if drone.is_landed or drone.piloted:
                drone.excluded, drone.leaving_to = not drone.piloted, None
                end = "a pilot flies it" if drone.piloted else "has landed and is disarmed, the others fly on"
                name = drone.link.name
                text = f"{name}: {end}"
                self._report(Severity.NOTICE, text, EventCode.EXCLUDED, name)

    @property
    def not_landed(self) -> tuple[str, ...]:
        """The drones that were heard and have not reported their motors off, though the landing or the stop is over."""
        if self.phase not in (Phase.GROUND, Phase.STOPPED):
            return ()
        known = (d for d in self._drones if d.link.telemetry.heartbeat is not None and (d.link.armed or not d.excluded))
        return tuple(d.link.name for d in known if d.stage in (Stage.RELEASED, Stage.CUT) and not d.is_landed)

    def _finish_landing(self, text: str, now_ns: int) -> None:
        """End it; text: what is known of the drones, which is an alarm unless each has landed or has a pilot."""
        code = Cause.LEFT_TO_PILOT if any(drone.piloted for drone in self._drones) else Cause.LANDED
        if any(not drone.piloted and not drone.is_landed for drone in self._participants):
            code = Cause.NOT_LANDED
            self._report(Severity.CRITICAL, text, EventCode.NOT_LANDED)
        self.pull(Trigger.DISARMED, code, text, now_ns)

    def _end_landing(self, now_ns: int) -> None:
        """A landing that takes too long is left to the autopilots, and at last is over."""
        if self._descent is None:
            self._descent = descent(self._drones, self.config, self.entered_ns)
        if now_ns >= self._descent.end_ns:
            text = late_text(self._participants, now_ns)
            for drone in self._drones:
                if drone.is_awaited_down(now_ns):
                    drone.enter(DroneTrigger.RELEASE, now_ns)
            self._finish_landing(text, now_ns)
        elif now_ns >= self._descent.hand_over_ns:
            for drone in self._drones:
                if drone.flown and not drone.floor.touched:
                    self._hand_over(drone, "has not landed in time", now_ns)

    def _hand_over(self, drone: Drone, why: str, now_ns: int) -> None:
        """Release a drone to its autopilot's own landing, and report it."""
        name = drone.link.name
        text = f"{name} {why}: commanded to land by itself"
        self._report(Severity.ERROR, text, EventCode.RELEASED, name)
        drone.enter(DroneTrigger.RELEASE, now_ns)

    def _lead_down(self, stages: Stages, now_ns: int) -> None:
        """Straight down; but aside first, at its height, for a drone under which another will stand."""
        at_m = stages.state.pos_lab_m[[drone.index for drone in self._drones]]
        if self._spots is None:
            self._spots = landing_spots(at_m, self.config.limits)
        for drone, here, spot in zip(self._drones, at_m, self._spots, strict=True):
            self._lead_over_and_down(drone, here, spot, now_ns)

    def _lead_over_and_down(self, drone: Drone, here: Vec3, spot_m: Sequence[float], now_ns: int) -> None:
        flight, (x_m, y_m) = self.config.flight, map(float, spot_m)
        if drone.stage is not Stage.FOLLOW or drone.floor.touched or not drone.flown:
            return
        if hypot(here[0] - x_m, here[1] - y_m) < OVER_SPOT_M:
            # Straight down, to well under the floor: the floor ends it.
            down_m = (None, None, drone.floor.rest_z_m - 1.0)
            drone.setpoint = Setpoint(Mode.LAB, down_m, speed_m_s=flight.descend_m_s)
            drone.enter(DroneTrigger.OVER_SPOT, now_ns)
        else:
            drone.setpoint = Setpoint(Mode.LAB, (x_m, y_m, None), speed_m_s=flight.climb_m_s)


def armed_text(flight: Flight, now_ns: int) -> str:
    """The answer once every drone is armed: for how long they will be."""
    first = flight.first_to_disarm(now_ns)
    if first is None:
        return "every drone is armed"
    return f"every drone is armed; take off within {max(first[1] - TAKE_OFF_S, 0.0):.1f} s ({first[0]} disarms itself)"


def done_text(flight: Flight) -> str:
    """The answer to a request that was carried out at once."""
    trajectory = f", trajectory {flight.trajectory_name}" if flight.config.leader.trajectories else ""
    without = f", without {', '.join(flight.excluded)}" if flight.excluded else ""
    after = f"; {AFTER_STOP}" if flight.phase is Phase.STOPPED else ""
    return f"phase {flight.phase.name}, shape {flight.shape.name}{trajectory}{without}{after}"


class PhaseRow(NamedTuple):
    """drones: what every drone's stage is triggered by as the phase begins. setpoint: to what each is led then.

    watch: looks in every tick for what ends the phase.
    """

    drones: DroneTrigger
    setpoint: Callable[[FlightConfig], Setpoint]
    watch: Callable[[Flight, Stages | None, int], None] = lambda _flight, _stages, _now_ns: None


def _idle(_: FlightConfig) -> Setpoint:
    return IDLE


def _take_off(flight: FlightConfig) -> Setpoint:
    return Setpoint(Mode.LAB, (None, None, flight.altitude_m), speed_m_s=flight.climb_m_s)


def _form(flight: FlightConfig) -> Setpoint:
    return Setpoint(Mode.FORMATION, speed_m_s=flight.formation_change_m_s)


def _brake(flight: FlightConfig) -> Setpoint:
    """Brake, and stay; a landing begins where its first frame sees everybody."""
    return Setpoint(Mode.LAB, HERE, speed_m_s=flight.climb_m_s)


PHASES: Mapping[Phase, PhaseRow] = MappingProxyType(
    {
        Phase.GROUND: PhaseRow(DroneTrigger.DISARM, _idle),
        Phase.ARMED: PhaseRow(DroneTrigger.ARM, _idle, Flight._watch_arming),
        Phase.TAKEOFF: PhaseRow(DroneTrigger.LEAD, _take_off, Flight._watch_take_off),
        Phase.FORMATION: PhaseRow(DroneTrigger.LEAD, _form, Flight._watch_slots),
        Phase.HOLD: PhaseRow(DroneTrigger.LEAD, _brake, Flight._watch_joining),
        Phase.LAND: PhaseRow(DroneTrigger.LEAD, _brake, Flight._watch_landing),
        Phase.STOPPED: PhaseRow(DroneTrigger.STOP, _idle),
    }
)
"""What each phase makes of the drones; which trigger leads to which is formation.safety.phases.TABLE."""


def are_at_height(stages: Stages, flown: Sequence[int], bodies: Sequence[int], height_m: float) -> bool:
    """Whether the drones `flown` (among the commanded; bodies: among the vehicles) have risen to their height.

    They are led up to it and at rest there, and are there. What is asked of them next begins from where they are led:
    from a reference that still slows down, a hold would brake to rest some centimetres below.
    """
    away_m = np.abs(stages.state.pos_lab_m[bodies, 2] - height_m)
    led_away_m = np.abs(stages.reference.slot_lead_m[flown, 2] - height_m)
    at_rest = np.abs(stages.reference.slot_acc_lead_m_s2[flown]) < LED_AT_REST_M_S2
    return bool((away_m < AT_HEIGHT_M).all() and (led_away_m < LED_THERE_M).all() and at_rest.all())


def slot_distances_m(stages: Stages, shape: Shape) -> Float:
    """How far each follower is led from its slot of the shape, (followers,)."""
    offsets = shape.offsets
    distances_m: Float = np.linalg.norm(stages.reference.slot_lead_m[-len(offsets) :] - offsets, axis=-1)
    return distances_m


def _why_not_armed(drone: Drone) -> str:
    link = drone.link
    wanted = "armed" if link.offboard else "off-board"
    answers = ", ".join(str(answer) for answer in list(link.commands.answers.values())[-1:])
    words = f"; it says: {' / '.join(dict.fromkeys(link.reports.texts))}" if link.reports.texts else ""
    return f"{link.name} is not {wanted} ({answers or 'nothing asked'}{words})"
