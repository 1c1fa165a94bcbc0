"""A drone over the floor: lift-off and touch-down, each by what the mocap sees and what the autopilot says. Pure."""

import math
from dataclasses import dataclass

from formation.model import Vec3Tuple
from gcs.drones.link_state import DroneLink
from wire.link_messages import LandedState

AIRBORNE_STATES = (LandedState.IN_AIR, LandedState.TAKEOFF, LandedState.LANDING)
NEAR_FLOOR_M = 0.03
TOUCH_NS = 300_000_000
PRESSING_M, NOT_DESCENDING_M = 0.2, 0.5  # above its reference, for LASTING_NS
LASTING_NS = 1_000_000_000
AT_REST_M_S = 0.08
AT_REST_LAG_S = 0.15  # 4 mm of noise at 30 Hz are 0.02 m/s
LIFTED_M = 0.02
LIFTING_THRUST = 1.1  # of what hovers it: who follows that does not stay on the floor
LOW_THRUST = 0.92  # of what it flew with: who follows that in the air is not at rest for 0.3 s


@dataclass(slots=True)
class LandDetector:
    """rest_z_m: height of its markers when it stood on the floor. height_m: above that, NaN before it is seen.

    lifted: seen off the floor since it was last armed. touched: on the floor again since the phase began.
    last_seen_lab_m: where the mocap last saw it while the swarm flew. flying_thrust_norm: what it has been flying with
    of late, 0 before it flew.
    """

    rest_z_m: float = 0.0
    height_m: float = math.nan
    lifted: bool = False
    touched: bool = False
    last_seen_lab_m: Vec3Tuple | None = None
    flying_thrust_norm: float = 0.0
    _resting_since_ns: int | None = None
    _above_since_ns: int | None = None
    _slow_height_m: float = math.nan
    _slow_since_ns: int = 0

    def reset(self) -> None:
        """Another phase begins."""
        self.touched, self._resting_since_ns, self._above_since_ns = False, None, None
        self._slow_height_m = math.nan

    def detect_lift_off(self, link: DroneLink, pos_lab_m: Vec3Tuple, seen: bool, thrust_norm: float) -> None:
        """Detect lift-off: by the mocap's height, the autopilot's landed state, or the thrust setpoint that it follows.

        seen: in this frame; else the position is an estimate.
        """
        self.height_m = pos_lab_m[2] - self.rest_z_m
        self.last_seen_lab_m = pos_lab_m if seen else self.last_seen_lab_m
        self.lifted = self.lifted or self.height_m > LIFTED_M or link.telemetry.landed in AIRBORNE_STATES
        if not self.lifted and link.armed and link.offboard:
            self.lifted = thrust_norm > LIFTING_THRUST * link.hover_thrust_norm

    def update_flying_thrust(self, thrust_norm: float) -> None:
        """Update the mean thrust in flight, over some two hundred frames."""
        before = self.flying_thrust_norm or thrust_norm
        self.flying_thrust_norm = before + 0.005 * (thrust_norm - before)

    def detect_touch_down(
        self, link: DroneLink, vz_m_s: float, above_reference_m: float, thrust_norm: float, now_ns: int
    ) -> bool:
        """Detect touch-down: at rest at its floor height, or at rest well above its reference, and confirmed.

        True once, as it happens.
        """
        near = self.height_m < NEAR_FLOOR_M
        moves_m_s = min(abs(vz_m_s), abs(self._climb_m_s(now_ns)))
        at_rest = (near or above_reference_m > PRESSING_M) and moves_m_s <= AT_REST_M_S
        if not at_rest or not self._is_confirmed(link, near, thrust_norm):
            self._resting_since_ns = None
            return False
        if self._resting_since_ns is None:
            self._resting_since_ns = now_ns
        return now_ns - self._resting_since_ns >= (TOUCH_NS if near else LASTING_NS) and not self.touched

    def is_not_descending(self, above_reference_m: float, now_ns: int) -> bool:
        """Whether it has been far above its landing reference for a second, off the floor: it does not descend."""
        if above_reference_m <= NOT_DESCENDING_M or self.height_m < NEAR_FLOOR_M or self.touched:
            self._above_since_ns = None
            return False
        if self._above_since_ns is None:
            self._above_since_ns = now_ns
        return now_ns - self._above_since_ns >= LASTING_NS

    def _climb_m_s(self, now_ns: int) -> float:
        """How fast its height changes as it is seen, some 0.15 s old. On the floor the estimated speed is none:
        to the model too little thrust to fly with is a fall."""
        if math.isnan(self._slow_height_m):
            self._slow_height_m, self._slow_since_ns = self.height_m, now_ns
            return math.inf
        dt_s, self._slow_since_ns = (now_ns - self._slow_since_ns) * 1e-9, now_ns
        self._slow_height_m += dt_s / (dt_s + AT_REST_LAG_S) * (self.height_m - self._slow_height_m)
        return (self.height_m - self._slow_height_m) / AT_REST_LAG_S

    def _is_confirmed(self, link: DroneLink, near: bool, thrust_norm: float) -> bool:
        """The independent confirmation of a touch-down: the landed state or, at floor height, a thrust too low to fly.

        Above the floor the thrust is no evidence: a hovering drone that does not follow its descent is sent as little.
        """
        low = thrust_norm < LOW_THRUST * (self.flying_thrust_norm or link.hover_thrust_norm)
        return link.telemetry.landed is LandedState.ON_GROUND or (near and low and link.offboard)
