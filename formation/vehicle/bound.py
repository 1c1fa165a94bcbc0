"""How little any controller could deviate in a push, by the vehicle's motors and the loop's delay.

One reaction time after the push begins, the ideal controller knows the rest of the push, and steers without noise.
A true lower bound at the place that is held, since each step gives it more than the vehicle can do:

- its tilt is at any time whatever the motors could have reached by then from level hover, all of their thrust on one
  side and none on the other, through their lag and up to the autopilot's body rate (sines and cosines as they are);
- at that tilt it has any thrust from none to all, at once, and need not keep its height; nor need the tilt be taken
  back, nor the thrust be followed, before the push ends: what it has of sideways force is any function of time within
  +-(full thrust / m) sin(tilt it could have reached);
- drag never works against it: it adds to that force as much as it could at the speed that the push alone gives.

Who commands attitudes has less: an autopilot that answers after a dead time and with a first-order lag, as the profile
says, and the lab's limit of tilt.

Force moves each later position its own way. So no force within the limits leaves a position less far along the push
than all of it against the push does, and the farthest of those is the bound.
"""

from dataclasses import dataclass
from math import tan

import numpy as np

from formation.maths.arrays import Float
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleProfile

STEP_S = 0.002


@dataclass(frozen=True, slots=True)
class Turning:
    """How fast and how hard motors turn a vehicle. turn_max_rad_s2, rate_max_rad_s: of the tilt; thrust_max_m_s2: full
    thrust over mass; drag_1_s: the largest of the body's axes over mass."""

    turn_max_rad_s2: float
    rate_max_rad_s: float
    motor_lag_s: float
    thrust_max_m_s2: float
    drag_1_s: float = 0.0


@dataclass(frozen=True, slots=True)
class AttitudeLoop:
    """How sideways force follows commands: after dead_s from the exposure that shows the push, with lag_s; at most."""

    dead_s: float
    lag_s: float
    most_m_s2: float
    drag_1_s: float = 0.0


def turning(profile: VehicleProfile) -> Turning:
    """A vehicle's, as its profile says: two motors full, two stopped."""
    thrust_max_m_s2 = profile.thrust_max_n / profile.mass_kg
    turn_max_rad_s2 = profile.turn_1_m * 0.5 * thrust_max_m_s2
    return Turning(turn_max_rad_s2, profile.rate_max_rad_s, profile.motor_lag_s, thrust_max_m_s2, _drag_1_s(profile))


def attitude_loop(profile: VehicleProfile, pose_delay_s: float, tilt_rad: float) -> AttitudeLoop:
    """A vehicle's, as its profile says, behind cameras of that delay, tilted so far at most."""
    dead_s = pose_delay_s + profile.response_dead_time_s
    return AttitudeLoop(dead_s, profile.response_lag_s, GRAVITY_M_S2 * tan(tilt_rad), _drag_1_s(profile))


def least_deviation_m(push_m_s2: Float, turning: Turning, reaction_s: float) -> float:
    """A lower bound of the largest deviation, m, of any controller that acts from reaction_s on; push (T) every STEP_S,
    from its beginning on."""
    acting_s = _since(reaction_s, push_m_s2)
    # Of a torque asked for at once, through the motors' lag: its integral is t - lag (1 - e^(-t / lag)).
    rate = turning.turn_max_rad_s2 * (acting_s - turning.motor_lag_s * -np.expm1(-acting_s / turning.motor_lag_s))
    # Summed at the ends of the steps while it grows: never less than the integral.
    tilt = np.minimum(STEP_S * np.cumsum(np.minimum(rate, turning.rate_max_rad_s)), 0.5 * np.pi)
    drag = turning.drag_1_s * STEP_S * np.cumsum(np.abs(push_m_s2))
    return _largest_m(push_m_s2 - turning.thrust_max_m_s2 * np.sin(tilt) - drag, 0.0)


def least_deviation_by_attitude_m(push_m_s2: Float, loop: AttitudeLoop) -> float:
    """The same of any law that commands attitudes through this loop."""
    against = loop.most_m_s2 * -np.expm1(-_since(loop.dead_s, push_m_s2) / loop.lag_s)
    return _largest_m(push_m_s2 - against, loop.drag_1_s)


def _drag_1_s(profile: VehicleProfile) -> float:
    return max(profile.drag_n_s_m) / profile.mass_kg


def _since(reaction_s: float, push_m_s2: Float) -> Float:
    """From the reaction to the end of each step; the force at the end of a step acts in all of it."""
    since_s: Float = np.maximum(STEP_S * np.arange(1, len(push_m_s2) + 1) - reaction_s, 0.0)
    return since_s


def _largest_m(acc_m_s2: Float, drag_1_s: float) -> float:
    """How far it gets from rest along the push."""
    pos_m = vel_m_s = largest_m = 0.0
    for acc in acc_m_s2.tolist():
        pos_m += STEP_S * (vel_m_s + 0.5 * STEP_S * acc)
        vel_m_s += STEP_S * (acc - drag_1_s * vel_m_s)
        largest_m = max(largest_m, pos_m)
    return largest_m
