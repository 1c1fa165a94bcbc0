"""What a stream of setpoints does to the autopilot: attitude targets, body rates, positions and velocities.

Attitude and thrust go straight to the attitude loop; everything else is the
pilot's to fly. What autopilots read differently is asked of the model.
"""

import math

import numpy as np

from drone_agent.autopilots.model import Task
from drone_agent.flight.autopilot import Autopilot
from drone_agent.guard.position import NO_RATE, LoopSetpoint
from formation.maths.arrays import Quat, Vec3
from formation.maths.frames import from_rotation_vector, multiply
from wire.link_messages import AttitudeSetpoint, Ignore, LocalFrame, PositionIgnore, PositionSetpoint

_ATTITUDE, _THRUST = int(Ignore.ATTITUDE), int(Ignore.THRUST)  # plain, for every setpoint


class Guidance:
    """Takes setpoints in; only an autopilot that is armed and off-board follows them."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot

    def attitude(self, now_ns: int, target: AttitudeSetpoint) -> None:
        """An attitude target came."""
        autopilot = self._autopilot
        if not autopilot.model.accepts_target(target):
            if autopilot.in_stream_mode:
                autopilot.fly(Task.HOLD)
            return
        if not self._accepts(now_ns):
            return
        climb_m_s = autopilot.model.climb_rate_of(autopilot.parameters, target.thrust_norm)
        if climb_m_s is not None:
            if autopilot.task is not Task.LEVEL:
                autopilot.fly(Task.LEVEL)
            autopilot.pilot.follow(target.q_lab_from_flu, climb_m_s)
            return
        autopilot.piloted = False
        ignore = int(target.ignore)
        if ignore & _ATTITUDE:
            attitude, rate = self._ahead(target.rate_flu_rad_s), NO_RATE
        else:
            attitude, rate = target.q_lab_from_flu, target.rate_flu_rad_s
        thrust = 0.0 if ignore & _THRUST else target.thrust_norm
        autopilot.vehicle.order(now_ns, LoopSetpoint(attitude, rate, thrust))

    def position(self, now_ns: int, target: PositionSetpoint) -> None:
        """A position or velocity came; the pilot flies it, where there is an estimate to fly it in."""
        autopilot = self._autopilot
        goes = not target.ignore & PositionIgnore.POSITION
        drifts = not target.ignore & PositionIgnore.VELOCITY
        if not autopilot.estimator.valid(now_ns) or not (goes or drifts):
            return
        if goes and not autopilot.model.streams_positions:
            if not autopilot.in_stream_mode:
                return
        elif not self._accepts(now_ns):
            return
        belief = autopilot.belief
        turn_rad = belief.yaw_rad if target.frame in (LocalFrame.BODY, LocalFrame.BODY_OFFSET) else 0.0
        vector = _turned_flat(target.pos_m if goes else target.vel_m_s, turn_rad)
        if not all(map(math.isfinite, vector)):
            return
        if autopilot.task is not Task.HOLD:
            autopilot.fly(Task.HOLD)
        yaw_rad = (
            None if target.ignore & PositionIgnore.YAW or math.isnan(target.yaw_rad) else target.yaw_rad + turn_rad
        )
        if not goes:
            autopilot.pilot.drift(vector, yaw_rad)
            return
        x, y, z = belief.pos_lab_m if target.frame is not LocalFrame.LOCAL else (0.0, 0.0, 0.0)
        autopilot.pilot.go_to((x + vector[0], y + vector[1], z + vector[2]), yaw_rad)

    def _accepts(self, now_ns: int) -> bool:
        """Note a setpoint of the stream; whether it is to be followed."""
        in_mode = self._autopilot.in_stream_mode
        self._autopilot.stream.note(now_ns, in_mode=in_mode)
        return in_mode

    def _ahead(self, rate_flu_rad_s: Vec3) -> Quat:
        """The attitude so far ahead that the attitude loop, when it gets it, turns at this rate."""
        configured = self._autopilot.configured
        tilt_s, yaw_s = 1.0 / configured.attitude_p_1_s, 1.0 / configured.yaw_p_1_s
        ahead_s = np.array([tilt_s, tilt_s, yaw_s]) + configured.command_delay_s
        return multiply(self._autopilot.estimator.q_lab_from_flu, from_rotation_vector(rate_flu_rad_s * ahead_s))


def _turned_flat(vector: Vec3, yaw_rad: float) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return c * x - s * y, s * x + c * y, z
