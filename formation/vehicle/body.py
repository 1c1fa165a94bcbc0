"""A quadcopter's body in numbers: where the kernels find each parameter, and what a profile computes from them.

Nothing is compiled here, so that reading a configuration waits for no compiler; see `formation.vehicle.rigid_body`.
"""

from math import sqrt

# Where each parameter is; INERTIA and DRAG are three each, along the body's axes.
MASS, INERTIA = range(2)
WHEELBASE, ROTOR_RADIUS, THRUST_MAX, THRUST_CURVE, YAW_TORQUE, MOTOR_LAG, DRAG = range(4, 11)
GROUND_EFFECT, ATTITUDE_P, YAW_P, RATE_P, RATE_YAW_P, RATE_MAX, RATE_YAW_MAX, RATE_FEED_FORWARD, NUMBERS = range(13, 22)

GRAVITY_M_S2 = 9.8


def thrust_norm(fraction: float, curve: float) -> float:
    """u of (1 - k) u + k u^2 = fraction, 0..1; `curve` is k."""
    linear = 1.0 - curve
    return 2.0 * fraction / (linear + sqrt(linear * linear + 4.0 * curve * fraction)) if fraction > 0.0 else 0.0


def rotor_reach_m(wheelbase_m: float) -> float:
    """How far each rotor stands off the centre along both horizontal body axes: they make a square."""
    reach_m: float = wheelbase_m / (2.0 * sqrt(2.0))
    return reach_m
