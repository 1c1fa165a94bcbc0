"""One commanded drone as the flight handles it: its link, the goal its autopilot is brought to, and its landing."""

from dataclasses import dataclass

from formation.reference import HERE, IDLE, Leg, Mode
from gcs.goal import Goal, is_reached, pursue
from gcs.link_state import NEVER_NS, DroneLink
from wire.link_messages.status import LandedState

TOUCH_NS = 300_000_000
GONE_NS = 5_000_000_000
OWN_LANDING_NS = 2_500_000_000
REFUSED_DISARM_NS = 5_000_000_000
AIRBORNE_STATES = (LandedState.IN_AIR, LandedState.TAKEOFF, LandedState.LANDING)
NEAR_FLOOR_M = 0.03
PRESSING_M, PRESSED_NS = 0.2, 1_000_000_000
AT_REST_M_S = 0.08


@dataclass(slots=True)
class Drone:
    """index: its place among the n vehicles. rest_z_m: height of its markers when it stood on the floor.

    checked: its parameters have been read and what is amiss with them was told.
    """

    index: int
    link: DroneLink
    leg: Leg = IDLE
    goal: Goal = Goal.LEAVE
    goal_since_ns: int = NEVER_NS
    rest_z_m: float = 0.0
    released: bool = False
    resting_since_ns: int | None = None
    descending: bool = False
    touched: bool = False
    checked: bool = False

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

    def pursue(self, now_ns: int) -> None:
        """One more step towards the goal; a disarm that a landed drone keeps refusing is forced."""
        since_ns = now_ns - self.goal_since_ns
        if self.goal is Goal.DISARM and not self.reached:
            if self.touched and self.link.told.landed in AIRBORNE_STATES and since_ns < OWN_LANDING_NS:
                return  # it would refuse: its own landing detector has not seen yet what the mocap saw
            if since_ns > REFUSED_DISARM_NS:
                self.aim(Goal.CUT, now_ns)
        pursue(self.goal, self.link, self.goal_since_ns, now_ns)

    def release(self, now_ns: int) -> None:
        """Let go of it: no more setpoints, it lands by itself."""
        if not self.released and self.goal is not Goal.CUT:
            self.released = True
            self.aim(Goal.LAND, now_ns)

    def watch_landing(self, z_m: float, vz_m_s: float, above_reference_m: float, now_ns: int) -> None:
        """Notice touch-down: at rest at its own floor height, or at rest while told to be well below."""
        near = z_m - self.rest_z_m < NEAR_FLOOR_M
        if not (near or above_reference_m > PRESSING_M) or abs(vz_m_s) > AT_REST_M_S:
            self.resting_since_ns = None
            return
        if self.resting_since_ns is None:
            self.resting_since_ns = now_ns
        if now_ns - self.resting_since_ns >= (TOUCH_NS if near else PRESSED_NS) and not self.touched:
            self.touched, self.leg = True, IDLE
            if self.flown:
                self.aim(Goal.DISARM, now_ns)

    def lead_to(self, leg: Leg, goal: Goal, now_ns: int) -> None:
        """A new phase: another leg, another goal; a drone that was let go or cut stays so."""
        self.leg = leg
        self.descending, self.touched, self.resting_since_ns = False, False, None
        if self.flown:
            self.aim(goal, now_ns)


def take_off_leg(altitude_m: float, speed_m_s: float) -> Leg:
    """Straight up from where it stands."""
    return Leg(Mode.LAB, (None, None, altitude_m), speed_m_s=speed_m_s)


def hold_leg(speed_m_s: float) -> Leg:
    """Brake, and stay."""
    return Leg(Mode.LAB, HERE, speed_m_s=speed_m_s)


def land_leg(rest_z_m: float, speed_m_s: float) -> Leg:
    """Straight down, to well under the floor: the floor ends it."""
    return Leg(Mode.LAB, (None, None, rest_z_m - 1.0), speed_m_s=speed_m_s)


def aside_leg(x_m: float, y_m: float, speed_m_s: float) -> Leg:
    """To above another spot of the floor, at this height."""
    return Leg(Mode.LAB, (x_m, y_m, None), speed_m_s=speed_m_s)
