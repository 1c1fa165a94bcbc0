"""One commanded drone as the flight handles it: its link, the goal its autopilot is brought to, and its landing."""

from dataclasses import dataclass

from formation.guidance.plan import HERE, IDLE, Mode, Setpoint
from gcs.drones.goal import Goal, is_reached, pursue
from gcs.drones.link_state import NEVER_NS, DroneLink
from wire.link_messages.status import LandedState

TOUCH_NS = 300_000_000
GONE_NS = 5_000_000_000
OWN_LANDING_NS = 2_500_000_000
REFUSED_DISARM_NS = 5_000_000_000
AIRBORNE_STATES = (LandedState.IN_AIR, LandedState.TAKEOFF, LandedState.LANDING)
NEAR_FLOOR_M = 0.03
PRESSING_M, PRESSED_NS = 0.2, 1_000_000_000
AT_REST_M_S = 0.08
LIFTED_M = 0.02
TAKE_OFF_S = 3.0  # thrust takes two to rise (formation.control.attitude), its own landing detector one to notice
IDLE_DISARM_WITHIN_S = 0.5


@dataclass(slots=True)
class Drone:
    """index: its place among the n vehicles. rest_z_m: height of its markers when it stood on the floor.

    checked: its parameters have been read and what is amiss with them was told. lifted: seen off the floor since it was
    last armed.
    """

    index: int
    link: DroneLink
    setpoint: Setpoint = IDLE
    goal: Goal = Goal.LEAVE
    goal_since_ns: int = NEVER_NS
    rest_z_m: float = 0.0
    released: bool = False
    resting_since_ns: int | None = None
    descending: bool = False
    touched: bool = False
    checked: bool = False
    lifted: bool = False

    def aim(self, goal: Goal, now_ns: int) -> None:
        """Bring the autopilot to another goal; the same goal again changes nothing."""
        if goal is not self.goal:
            self.goal, self.goal_since_ns = goal, now_ns

    @property
    def reached(self) -> bool:
        """Whether the drone has reported its goal since it was set."""
        return is_reached(self.goal, self.link, self.goal_since_ns)

    @property
    def flown(self) -> bool:
        """Whether it is sent setpoints: not once it was let go or cut."""
        return not self.released and self.goal is not Goal.CUT

    def grounded(self, now_ns: int) -> bool:
        """Whether its motors are known to be off, or it has been silent for so long that nothing will be known."""
        if now_ns - self.link.heartbeat_ns > GONE_NS and not self.flown:
            return True
        return self.goal in (Goal.DISARM, Goal.LAND, Goal.CUT) and self.reached

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

    def notice_lift(self, z_m: float) -> None:
        """Notice that it is off the floor."""
        rises = z_m - self.rest_z_m > LIFTED_M or self.link.telemetry.landed in AIRBORNE_STATES
        self.lifted = self.lifted or rises

    def stay_down(self, now_ns: int) -> None:
        """It stands on the floor, landed or never risen: no thrust any more, and disarmed."""
        self.touched, self.setpoint = True, IDLE
        if self.flown:
            self.aim(Goal.DISARM, now_ns)

    def pursue(self, now_ns: int) -> None:
        """One more step towards the goal; a disarm that a landed drone keeps refusing is forced."""
        since_ns = now_ns - self.goal_since_ns
        if self.goal is Goal.DISARM and not self.reached:
            if self.touched and self.link.telemetry.landed in AIRBORNE_STATES and since_ns < OWN_LANDING_NS:
                return  # it would refuse: its own landing detector has not seen yet what the mocap saw
            if since_ns > REFUSED_DISARM_NS:
                self.aim(Goal.CUT, now_ns)
        pursue(self.goal, self.link, self.goal_since_ns, now_ns)

    def release(self, now_ns: int) -> None:
        """Let go of it: no more setpoints, it lands by itself."""
        if not self.released and self.goal is not Goal.CUT:
            self.released = True
            self.aim(Goal.LAND, now_ns)

    def notice_landing(self, z_m: float, vz_m_s: float, above_reference_m: float, now_ns: int) -> None:
        """Notice touch-down: at rest at its own floor height, or at rest while told to be well below."""
        near = z_m - self.rest_z_m < NEAR_FLOOR_M
        if not (near or above_reference_m > PRESSING_M) or abs(vz_m_s) > AT_REST_M_S:
            self.resting_since_ns = None
            return
        if self.resting_since_ns is None:
            self.resting_since_ns = now_ns
        if now_ns - self.resting_since_ns >= (TOUCH_NS if near else PRESSED_NS) and not self.touched:
            self.stay_down(now_ns)

    def lead_to(self, setpoint: Setpoint, goal: Goal, now_ns: int) -> None:
        """A new phase: another setpoint, another goal; a drone that was let go or cut stays so."""
        self.setpoint = setpoint
        self.descending, self.touched, self.resting_since_ns = False, False, None
        if self.flown:
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
