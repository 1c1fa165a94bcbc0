"""One commanded drone as the flight handles it: the goal its autopilot is brought to, its link, and its landing.

A goal is what the ground wants of the autopilot: wanted against reported, every tick. An acknowledgement alone never
counts as done; the drone's next heartbeat does.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

from formation.guidance.plan import HERE, IDLE, Mode, Setpoint
from formation.model import Vec3Tuple
from gcs.drones.link_state import DroneLink
from gcs.drones.protocols import arm, cut, disarm, land, request_control
from gcs.drones.telemetry import NEVER_NS
from wire.link_messages import CommandLong, LandedState

STREAM_FIRST_NS = 1_200_000_000  # PX4 wants a second of setpoints before it changes to off-board
HOLD_OFF_NS = 1_000_000_000  # an answer stands until the next heartbeat can confirm it
WORDS_NS = 300_000_000  # an autopilot's reasons come beside its answer, before it or after
TOUCH_NS = 300_000_000
GONE_NS = 5_000_000_000
OWN_LANDING_NS = 2_500_000_000
REJECTED_DISARM_NS = 5_000_000_000
AIRBORNE_STATES = (LandedState.IN_AIR, LandedState.TAKEOFF, LandedState.LANDING)
NEAR_FLOOR_M = 0.03
PRESSING_M, PRESSED_NS = 0.2, 1_000_000_000
NOT_DESCENDING_M, NOT_DESCENDING_NS = 0.5, 1_000_000_000
AT_REST_M_S = 0.08
AT_REST_LAG_S = 0.15  # 4 mm of noise at 30 Hz are 0.02 m/s
LIFTED_M = 0.02
TAKE_OFF_S = 3.0  # thrust takes two to rise (formation.control.attitude), its own landing detector one to notice
IDLE_DISARM_WITHIN_S = 0.5
JOINING_NS = 5_000_000_000
LIFTING_THRUST = 1.1  # of what hovers it: who follows that does not stay on the floor
LOW_THRUST = 0.92  # of what it flew with: who follows that in the air is not at rest for 0.3 s
THRUST_MEMORY = 0.005


class Goal(StrEnum):
    """The state the drone's autopilot is to be brought to."""

    LEAVE = "leave as it is"
    FLY = "off-board and armed"
    JOIN = "off-board, following this ground"
    LAND = "landing by itself"
    DISARM = "disarmed"
    CUT = "motors cut"


@dataclass(slots=True)
class Drone:
    """index: its place among the n vehicles. rest_z_m: height of its markers when it stood on the floor. start_lab_m:
    where that was, None where it took off under no ground or another.

    excluded: takes no part in the flight, and stays on the floor; a stop stops it, too. leaving_to: the spot, x and y,
    where it lands alone while the others fly on.
    checked: its parameters have been read and wrong ones reported. lifted: seen off the floor since it was
    last armed. height_m: above where it stood, NaN unless that was seen. flying_thrust_norm: what it has been flying
    with of late, 0 before it flew. piloted: a pilot has taken it over, it is left alone. landing_itself: its
    autopilot was seen to land since it was commanded to. stopped_ns: when it reported its cut motors off.
    slow_height_m: height_m some time before slow_since_ns, in a landing. last_seen_lab_m: where the mocap last saw it
    while the swarm flew.
    """

    index: int
    link: DroneLink
    setpoint: Setpoint = IDLE
    goal: Goal = Goal.LEAVE
    goal_since_ns: int = NEVER_NS
    start_lab_m: Vec3Tuple | None = None
    excluded: bool = False
    leaving_to: tuple[float, float] | None = None
    rest_z_m: float = 0.0
    released: bool = False
    resting_since_ns: int | None = None
    not_descending_since_ns: int | None = None
    descending: bool = False
    touched: bool = False
    checked: bool = False
    lifted: bool = False
    height_m: float = math.nan
    last_seen_lab_m: Vec3Tuple | None = None
    flying_thrust_norm: float = 0.0
    piloted: bool = False
    landing_itself: bool = False
    stopped_ns: int | None = None
    slow_height_m: float = math.nan
    slow_since_ns: int = 0

    def aim(self, goal: Goal, now_ns: int) -> None:
        """Bring the autopilot to another goal; the same goal again changes nothing."""
        if goal is not self.goal:
            self.goal, self.goal_since_ns = goal, now_ns
            self.landing_itself, self.stopped_ns = False, None

    @property
    def reached(self) -> bool:
        """Whether the drone has reported its goal since it was set."""
        return is_reached(self.goal, self.link, self.goal_since_ns)

    @property
    def flown(self) -> bool:
        """Whether it is sent setpoints: not after a release or a motor cut, nor while a pilot flies it."""
        return not (self.excluded or self.released or self.piloted or self.goal is Goal.CUT)

    def rejects(self, now_ns: int) -> bool:
        """Whether its autopilot has rejected the step to the goal that was asked last, and its words have come."""
        step = None if self.reached else _next(self.goal, self.link)
        answer = None if step is None else self.link.commands.answers.get(step)
        if answer is None or answer.result is None or answer.accepted or answer.t_ns < self.goal_since_ns:
            return False
        return now_ns - answer.t_ns >= WORDS_NS

    def joining(self, now_ns: int) -> bool:
        """Whether it is only just being taken over, and is given time to follow."""
        return self.goal is Goal.JOIN and not self.reached and now_ns - self.goal_since_ns < JOINING_NS

    def awaited(self, now_ns: int) -> bool:
        """Whether it is being taken over and has not even accepted to follow: its motion is not ours yet."""
        if not self.joining(now_ns) or self.link.model is None or self.link.offboard:
            return False
        answer = self.link.commands.answers.get(self.link.model.set_offboard(self.link.target))
        return answer is None or not answer.accepted or answer.t_ns < self.goal_since_ns

    @property
    def is_landed(self) -> bool:
        """Whether it has reported its motors off since it was commanded to land, to disarm or to stop."""
        return self.goal in (Goal.DISARM, Goal.LAND, Goal.CUT) and self.reached

    @property
    def is_coming_down(self) -> bool:
        """Whether it has landed, or its autopilot lands it; a landing is not interrupted."""
        link = self.link
        return not link.armed or link.landing or link.telemetry.landed is LandedState.ON_GROUND

    def is_lost(self, now_ns: int) -> bool:
        """Whether it fell silent before it reported that its motors are off, and is sent no setpoints any more."""
        silent_ns = now_ns - max(self.link.received_ns, self.goal_since_ns)
        return self.goal in (Goal.LAND, Goal.CUT) and not self.reached and silent_ns > GONE_NS

    def is_awaited_down(self, now_ns: int) -> bool:
        """Whether a landing still waits for it: not for a pilot's drone, nor for a lost one."""
        return not (self.excluded or self.piloted or self.is_landed or self.is_lost(now_ns))

    def disarms_in_s(self, now_ns: int) -> float | None:
        """How long until it disarms by itself for want of a take-off; None where it is not about to."""
        since_ns, timeout_s = self.link.armed_clock.since_ns, self.link.idle_disarm_s
        if since_ns is None or timeout_s is None or self.lifted:
            return None
        return max(timeout_s - (now_ns - since_ns) * 1e-9, 0.0)

    @property
    def idle_disarm_text(self) -> str:
        """Why it is disarmed, where that was its own time-out; else the empty text."""
        timeout_s, model = self.link.idle_disarm_s, self.link.model
        waited = timeout_s is not None and self.link.armed_clock.lasted_s >= timeout_s - IDLE_DISARM_WITHIN_S
        if self.link.armed or self.lifted or model is None or not waited:
            return ""
        return f"{self.link.name} disarmed itself: no take-off in {timeout_s:g} s ({model.table.idle_disarm_parameter})"

    def detect_lift_off(self, pos_lab_m: Vec3Tuple, seen: bool, thrust_norm: float) -> None:
        """Detect lift-off: by the mocap's height, the autopilot's landed state, or the thrust setpoint that it follows.

        seen: in this frame; else the position is an estimate.
        """
        self.height_m = pos_lab_m[2] - self.rest_z_m
        self.last_seen_lab_m = pos_lab_m if seen else self.last_seen_lab_m
        self.lifted = self.lifted or self.height_m > LIFTED_M or self.link.telemetry.landed in AIRBORNE_STATES
        if not self.lifted and self.link.armed and self.link.offboard:
            self.lifted = thrust_norm > LIFTING_THRUST * self.link.hover_thrust_norm

    def update_flying_thrust(self, thrust_norm: float) -> None:
        """Update the mean thrust in flight, over some two seconds."""
        before = self.flying_thrust_norm or thrust_norm
        self.flying_thrust_norm = before + THRUST_MEMORY * (thrust_norm - before)

    def detect_pilot(self) -> bool:
        """Detect that a pilot has taken it over in flight; true once. A stop of the swarm still stops it."""
        landing_commanded = self.goal is Goal.LAND
        self.landing_itself = self.landing_itself or (landing_commanded and self.link.landing)
        if self.piloted or not self.lifted or self.goal is Goal.CUT or self.goal is Goal.JOIN or not self.link.piloted:
            return False
        if landing_commanded and not self.landing_itself:
            return False  # the command to land is still on its way
        self.piloted, self.goal = True, Goal.LEAVE
        return True

    def stay_down(self, now_ns: int) -> None:
        """It stands on the floor, landed or never risen: no thrust any more, and disarmed."""
        self.touched, self.setpoint = True, IDLE
        if self.flown:
            self.aim(Goal.DISARM, now_ns)

    def pursue(self, now_ns: int) -> None:
        """Take one more step towards the goal.

        If a landed drone keeps rejecting a disarm, the disarm is forced, provided that two independent estimates
        confirm the landing. Else the drone is released.
        """
        if self.goal is Goal.LEAVE:
            self.link.commands.calm()
            return
        since_ns = now_ns - self.goal_since_ns
        if self.goal is Goal.CUT:  # an acknowledgement may be another command's; armed again is not stopped
            self.stopped_ns = (self.stopped_ns or self.link.heartbeat_ns) if self.reached else None
        if self.goal is Goal.DISARM and not self.reached:
            if self.touched and self.link.telemetry.landed in AIRBORNE_STATES and since_ns < OWN_LANDING_NS:
                return  # it would refuse: its own landing detector has not seen yet what the mocap saw
            if since_ns > REJECTED_DISARM_NS:
                self._force_disarm(now_ns)
        pursue(self.goal, self.link, self.goal_since_ns, now_ns)

    def _force_disarm(self, now_ns: int) -> None:
        """Force the disarm if the landed state, or the height by the mocap, confirms the landing; else release it."""
        if self.link.piloted:
            self.aim(Goal.LEAVE, now_ns)
        elif self.height_m < NEAR_FLOOR_M or self.link.telemetry.landed is LandedState.ON_GROUND:
            self.aim(Goal.CUT, now_ns)
        else:
            self.release(now_ns)

    def release(self, now_ns: int) -> None:
        """Release it: no more setpoints; its autopilot lands it."""
        if not self.released and not self.piloted and self.goal is not Goal.CUT:
            self.released = True
            self.aim(Goal.LAND, now_ns)

    def detect_touch_down(self, vz_m_s: float, above_reference_m: float, thrust_norm: float, now_ns: int) -> None:
        """Detect touch-down: at rest at its floor height, or at rest well above its reference, and confirmed."""
        near = self.height_m < NEAR_FLOOR_M
        moves_m_s = min(abs(vz_m_s), abs(self._climb_m_s(now_ns)))
        rests = (near or above_reference_m > PRESSING_M) and moves_m_s <= AT_REST_M_S
        if not rests or not self._stands(near, thrust_norm):
            self.resting_since_ns = None
            return
        if self.resting_since_ns is None:
            self.resting_since_ns = now_ns
        if now_ns - self.resting_since_ns >= (TOUCH_NS if near else PRESSED_NS) and not self.touched:
            self.stay_down(now_ns)

    def _climb_m_s(self, now_ns: int) -> float:
        """How fast its height changes as it is seen, some 0.15 s old. On the floor the estimated speed is none:
        to the model too little thrust to fly with is a fall."""
        if math.isnan(self.slow_height_m):
            self.slow_height_m, self.slow_since_ns = self.height_m, now_ns
            return math.inf
        dt_s, self.slow_since_ns = (now_ns - self.slow_since_ns) * 1e-9, now_ns
        self.slow_height_m += dt_s / (dt_s + AT_REST_LAG_S) * (self.height_m - self.slow_height_m)
        return (self.height_m - self.slow_height_m) / AT_REST_LAG_S

    def is_not_descending(self, above_reference_m: float, now_ns: int) -> bool:
        """Whether it has been far above its landing reference for a second, off the floor: it does not descend."""
        if above_reference_m <= NOT_DESCENDING_M or self.height_m < NEAR_FLOOR_M or self.touched:
            self.not_descending_since_ns = None
            return False
        if self.not_descending_since_ns is None:
            self.not_descending_since_ns = now_ns
        return now_ns - self.not_descending_since_ns >= NOT_DESCENDING_NS

    def _stands(self, near: bool, thrust_norm: float) -> bool:
        """The independent confirmation of a touch-down: the landed state or, at floor height, a thrust too low to fly.

        Above the floor the thrust is no evidence: a hovering drone that does not follow its descent is sent as little.
        """
        low = thrust_norm < LOW_THRUST * (self.flying_thrust_norm or self.link.hover_thrust_norm)
        return self.link.telemetry.landed is LandedState.ON_GROUND or (near and low and self.link.offboard)

    def take_over(self, now_ns: int) -> None:
        """It flies under no ground: it is to follow this one, from where it is."""
        self.excluded = self.released = self.piloted = self.touched = False
        self.lifted, self.start_lab_m = True, None
        self.link.commands.reset_answer(request_control(self.link.target, self.link.codec.own))
        self.aim(Goal.JOIN, now_ns)

    def let_down(self, now_ns: int) -> None:
        """Nobody leads it: if it is armed, or was not heard of, its autopilot lands it."""
        self.released = self.piloted = self.touched = False
        self.goal = Goal.LEAVE
        if self.link.armed or self.link.telemetry.heartbeat is None:
            self.lifted = True
            self.release(now_ns)
        else:
            self.stay_down(now_ns)

    def lead_to(self, setpoint: Setpoint, goal: Goal, now_ns: int) -> None:
        """A new phase: another setpoint, another goal; a released or cut drone stays so."""
        self.setpoint = setpoint
        self.descending, self.touched, self.resting_since_ns, self.not_descending_since_ns = False, False, None, None
        self.slow_height_m = math.nan
        if self.flown and not (self.joining(now_ns) and goal is Goal.LEAVE):
            self.aim(goal, now_ns)


def take_off_setpoint(altitude_m: float, speed_m_s: float) -> Setpoint:
    """Straight up from where it stands."""
    return Setpoint(Mode.LAB, (None, None, altitude_m), speed_m_s=speed_m_s)


def hold_setpoint(speed_m_s: float) -> Setpoint:
    """Brake, and stay."""
    return Setpoint(Mode.LAB, HERE, speed_m_s=speed_m_s)


def land_setpoint(rest_z_m: float, speed_m_s: float) -> Setpoint:
    """Straight down, to well under the floor: the floor ends it."""
    return Setpoint(Mode.LAB, (None, None, rest_z_m - 1.0), speed_m_s=speed_m_s)


def aside_setpoint(x_m: float, y_m: float, speed_m_s: float) -> Setpoint:
    """To above another spot of the floor, at this height."""
    return Setpoint(Mode.LAB, (x_m, y_m, None), speed_m_s=speed_m_s)


def is_reached(goal: Goal, link: DroneLink, since_ns: int) -> bool:
    """Whether a heartbeat younger than `since_ns` reports the goal."""
    if goal is Goal.LEAVE:
        return True
    if link.heartbeat_ns <= since_ns:
        return False
    if goal is Goal.FLY:
        return link.armed and link.offboard
    if goal is Goal.JOIN:
        return link.offboard and _control_asked(link)
    return not link.armed


def pursue(goal: Goal, link: DroneLink, since_ns: int, now_ns: int) -> None:
    """Ask for the next command towards the goal; nothing when it is reached, or while one is on its way or settling."""
    if is_reached(goal, link, since_ns):
        link.commands.calm()
        return
    command = _next(goal, link)
    if goal is Goal.JOIN and link.model is not None and command == link.model.set_offboard(link.target):
        command = command if now_ns - since_ns >= STREAM_FIRST_NS else None
    if command is None:
        return
    answer = link.commands.answers.get(command)
    if goal is Goal.CUT:
        link.commands.urge(command)
    elif answer is None or now_ns - answer.t_ns >= HOLD_OFF_NS:
        link.commands.ask(command)


def _next(goal: Goal, link: DroneLink) -> CommandLong | None:
    match goal:
        case Goal.CUT:
            return cut(link.target)
        case Goal.DISARM:
            return disarm(link.target)
        case Goal.LAND:
            return None if link.landing else land(link.target)
        case Goal.JOIN if not _control_asked(link):
            return _control(link)
        case Goal.JOIN if link.model is not None and not link.offboard:
            return link.model.set_offboard(link.target)
        case Goal.FLY if link.model is not None:
            return arm(link.target) if link.offboard else link.model.set_offboard(link.target)
        case _:
            return None


def _control(link: DroneLink) -> CommandLong:
    return request_control(link.target, link.codec.own)


def _control_asked(link: DroneLink) -> bool:
    """Whether it was asked to follow this ground; a real autopilot answers that it does not know what that means."""
    return _control(link) in link.commands.answers
