"""Bounds on what a setpoint may ask of the vehicle, by the guard's rule. Pure."""

import math

import numpy as np

from formation.maths.arrays import Quat
from formation.maths.frames import canonical, from_rotation_vector, from_yaw, multiply, yaw
from formation.vehicle.profile import GRAVITY_M_S2, VehicleProfile
from wire.link_messages.setpoints import AttitudeSetpoint

TILT_MAX_RAD = math.radians(50.0)
"""Half as much again as the ground's own limit asks for; PX4's MPC_TILTMAX_AIR is 45 degrees."""
LIFT_MAX = 2.5
"""Of thrust over weight, where the vehicle has more."""
BEYOND = "setpoint beyond tilt, body rates or thrust"
"""The report of limited setpoints."""
_TILT_MAX_COS = math.cos(TILT_MAX_RAD)


def within_bounds(target: AttitudeSetpoint, profile: VehicleProfile | None) -> AttitudeSetpoint:
    """The setpoint itself where it asks for no more than the bounds, else one that asks for just so much.

    profile: whose body rates and thrust bound it; None: of a vehicle that is not known, tilt and 0..1 alone.
    """
    thrust_max, rates_max = 1.0, math.inf
    yaw_rate_max = math.inf
    if profile is not None:
        thrust_max = profile.thrust_norm_of(LIFT_MAX * profile.mass_kg * GRAVITY_M_S2)
        rates_max, yaw_rate_max = profile.rate_max_rad_s, profile.rate_yaw_max_rad_s
    _, x, y, _ = target.q_lab_from_flu.tolist()
    p, q, r = target.rate_flu_rad_s.tolist()
    tilted = 1.0 - 2.0 * (x * x + y * y) < _TILT_MAX_COS
    turning = max(abs(p), abs(q)) > rates_max or abs(r) > yaw_rate_max
    if not (tilted or turning or not 0.0 <= target.thrust_norm <= thrust_max):
        return target
    return target._replace(
        q_lab_from_flu=_tilted_less(target.q_lab_from_flu) if tilted else target.q_lab_from_flu,
        rate_flu_rad_s=np.clip(
            target.rate_flu_rad_s, (-rates_max, -rates_max, -yaw_rate_max), (rates_max, rates_max, yaw_rate_max)
        ),
        thrust_norm=min(max(target.thrust_norm, 0.0), thrust_max),
    )


def _tilted_less(q_lab_from_flu: Quat) -> Quat:
    """The same heading and direction of tilt, tilted by the bound; level where it is upside down."""
    w, x, y, z = q_lab_from_flu.tolist()
    up_x, up_y = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x)
    side = math.hypot(up_x, up_y)
    heading = from_yaw(np.array(yaw(q_lab_from_flu)))
    if side < 1e-6:
        return heading
    tilt = TILT_MAX_RAD * np.array([-up_y / side, up_x / side, 0.0])
    return canonical(multiply(from_rotation_vector(tilt), heading))
