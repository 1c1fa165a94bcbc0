"""The bridge's own hold: keeps a body over its place, and lets it down, by what the mocap says of it alone. No bytes.

An autopilot's hold is no better than its estimate, which indoors wanders by decimetres, and it may refuse: PX4's needs
a position on the globe. Attitude targets it follows in the mode it is in, from one moment to the next.
"""

import math

import numpy as np

from drone_agent.bridge.hover_thrust import HoverThrust
from drone_agent.bridge.reckoning import Motion
from drone_agent.flight.estimator import Belief
from drone_agent.flight.position import NO_RATE, Demand, PositionController
from drone_agent.simulation.attitude_loop import LoopSetpoint
from formation.maths.arrays import Quat, Vec3
from formation.maths.frames import IDENTITY, from_yaw, yaw
from formation.maths.quaternion import thrust_axis
from formation.vehicle.body import GRAVITY_M_S2
from wire.link_messages.setpoints import AttitudeSetpoint

_LEAN_MAX_M_S2 = 0.5
_SHARE, _SHARE_VEL = 0.3, 0.05  # of a position's innovation, and of its rate: believed within 40 ms
_GAP_MAX_S = 0.2
_STOP_S = 0.4  # its place is where the present speed would come to rest
_SINK_M_S = 0.35
_THRUST_LEAST = 0.85  # of what carries it, coming down: what stands in the air by a wrong pose must not fall
_BLIND_THRUST, _BLIND_S, _BLIND_FADE_1_S = 0.95, 3.0, 0.3  # 1.5 m in 2.5 s, down at 1.2 m/s
_STILL_M_S = 0.1
_STANDS_M_S, _STANDS_NS = 0.08, 400_000_000


class BridgeHold:
    """One body. `see` and `note` follow it in flight; `begin`, then `step` at a steady rate."""

    def __init__(self) -> None:
        self.stands = False
        """Whether it was let down and sinks no more."""
        self._pos: Vec3 | None = None
        self._vel: Vec3 = np.zeros(3)
        self._capture_ns = 0
        self._yaw_rad = 0.0
        self._hover = HoverThrust()
        self._carries, self._sinks = math.nan, False
        self._lean_lab_m_s2: Vec3 = np.zeros(3)
        self._loop = PositionController(self._thrust_of)
        self._place = (0.0, 0.0)
        self._height_m = 0.0
        self._sinks_ns = 0
        self._blind_s = 0.0

    @property
    def still(self) -> bool:
        """Whether it is seen at rest."""
        return self._pos is not None and float(np.linalg.norm(self._vel)) < _STILL_M_S

    @property
    def faded(self) -> bool:
        """Whether a blind descent has taken the thrust away."""
        return self._blind_share() <= 0.0

    def see(self, t_capture_ns: int, pos_lab_m: Vec3, q_lab_from_flu: Quat) -> None:
        """Its pose: the velocity is carried on by its tilt and put right by its place."""
        dt_s = (t_capture_ns - self._capture_ns) * 1e-9
        if self._pos is None or not 0.0 < dt_s < _GAP_MAX_S:
            if self._pos is None or dt_s > 0.0:
                self.take_over(t_capture_ns, Motion(pos_lab_m, np.zeros(3)))
            return
        x, y, z = thrust_axis(q_lab_from_flu)
        push = GRAVITY_M_S2 / max(z, 0.5) * np.array([x, y, 0.0])
        ahead = self._pos + dt_s * self._vel
        missed = pos_lab_m - ahead
        self._pos = ahead + _SHARE * missed
        self._vel = self._vel + dt_s * push + _SHARE_VEL / dt_s * missed
        self._capture_ns = t_capture_ns
        self._hover.climbs(float(self._vel[2]))

    def feel(self, lift_m_s2: float, now_ns: int) -> None:
        """What its accelerometer shows along the body's z axis."""
        self._hover.feel(lift_m_s2, now_ns)

    def take_over(self, t_ns: int, motion: Motion) -> None:
        """Go on from a place and a velocity that are known otherwise."""
        self._hover.climbs(float(motion.vel_lab_m_s[2]), anew=True)
        self._pos, self._vel, self._capture_ns = motion.pos_lab_m.copy(), motion.vel_lab_m_s.copy(), t_ns

    def note(self, target: AttitudeSetpoint, now_ns: int) -> None:
        """A setpoint of the ground's: its heading is kept, its thrust and its lean are what carries it."""
        self._yaw_rad = float(yaw(target.q_lab_from_flu))
        x, y, _ = thrust_axis(target.q_lab_from_flu)
        lean = GRAVITY_M_S2 * np.array([x, y, 0.0])
        share = self._hover.fly(target.thrust_norm, now_ns, seen=self._is_seen(now_ns))
        self._lean_lab_m_s2 = self._lean_lab_m_s2 + share * (lean - self._lean_lab_m_s2)

    def _is_seen(self, now_ns: int) -> bool:
        """Whether its motion is known; nothing is asked of one that no camera ever saw."""
        return self._pos is None or now_ns - self._capture_ns <= round(_GAP_MAX_S * 1e9)

    def begin(self, now_ns: int) -> None:
        """Hold from here on, or where it would come to rest."""
        lean = np.clip(self._lean_lab_m_s2, -_LEAN_MAX_M_S2, _LEAN_MAX_M_S2)
        self._loop.reset((float(lean[0]), float(lean[1]), 0.0))
        x, y, z = (IDENTITY[1:] if self._pos is None else self._pos).tolist()
        self._place = (x + _STOP_S * float(self._vel[0]), y + _STOP_S * float(self._vel[1]))
        self._height_m, self._sinks_ns, self.stands = z, now_ns, False
        self._blind_s = 0.0
        self._carries, self._sinks = self._hover.thrust_norm, False

    def step(self, now_ns: int, dt_s: float, *, down: bool) -> LoopSetpoint:
        """The next attitude and thrust. Level, with the thrust that carried it, before it was ever seen."""
        if self._pos is None:
            return self._loop.step(Demand(self._yaw_rad), Belief((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), self._yaw_rad), dt_s)
        x, y, z = self._pos.tolist()
        vx, vy, vz = self._vel.tolist()
        demand = Demand(self._yaw_rad, self._place, height_m=self._height_m)
        if not down or vz < -_STANDS_M_S:
            self._sinks_ns = now_ns
        if down:
            self._begin_to_sink()
            demand = Demand(self._yaw_rad, self._place, climb_m_s=-_SINK_M_S)
            self.stands = self.stands or now_ns - self._sinks_ns >= _STANDS_NS
        flown = self._loop.step(demand, Belief((x, y, z), (vx, vy, vz), self._yaw_rad), dt_s)
        least = _THRUST_LEAST * self._carries
        if down and flown.thrust_norm < least:
            return LoopSetpoint(flown.q_lab_from_flu, flown.rate_flu_rad_s, least)
        if not down:
            self._hover.fly(flown.thrust_norm, now_ns, seen=self._is_seen(now_ns))
        return flown

    def sink_blind(self, dt_s: float) -> LoopSetpoint:
        """Down by attitude and thrust alone: level, a little less than what carries it, and none in the end."""
        self._begin_to_sink()
        self._blind_s += dt_s
        thrust = self._carries if math.isfinite(self._carries) else 0.0
        return LoopSetpoint(from_yaw(np.array(self._yaw_rad)), NO_RATE, self._blind_share() * thrust)

    def _begin_to_sink(self) -> None:
        """Weigh it for the last time, by the thrust that held it: the ground's may not have been followed."""
        if not self._sinks:
            self._carries, self._sinks = self._hover.thrust_norm, True

    def _blind_share(self) -> float:
        return max(_BLIND_THRUST - _BLIND_FADE_1_S * max(self._blind_s - _BLIND_S, 0.0), 0.0)

    def _thrust_of(self, force_m_s2: float) -> float:
        return min(max(self._carries * force_m_s2 / GRAVITY_M_S2, 0.0), 1.0)
