"""The equations of motion of a quadcopter on SO(3): motors, drag, ground effect, floor. Kernels only.

The state is one flat array `x` (17): position and velocity in `lab`, q_lab_from_flu, body rate in `flu`, four
motor thrusts (front right, rear left, front left, rear right). Parameters are an array `numbers` (NUMBERS), which
`VehicleProfile.numbers` lays out by the names below.
"""

from math import cos, exp, hypot, sin, sqrt

import numpy as np

from formation.maths.arrays import Float
from formation.maths.kernel import kernel
from formation.maths.quaternion import matrix_into
from formation.vehicle import body, downwash
from formation.vehicle.body import (
    DRAG,
    GRAVITY_M_S2,
    GROUND_EFFECT,
    INERTIA,
    MASS,
    MOTOR_LAG,
    ROTOR_RADIUS,
    WHEELBASE,
    YAW_TORQUE,
)

CONTACT_DEPTH_M = 0.001  # the feet sink this far under the vehicle's weight
FRICTION = 0.6
FRICTION_SPEED_M_S = 0.03  # below this, Coulomb friction is viscous: a resting vehicle does not creep
GROUND_EFFECT_MAX = 1.3

thrust_norm = kernel(body.thrust_norm)
rotor_reach_m = kernel(body.rotor_reach_m)
jet_force_n = kernel(downwash.jet_force_n)


@kernel
def downwash_into(x: Float, numbers: Float, down_m_s2: Float) -> None:
    """What the jets of all others do to each of m vehicles that share their air, into down_m_s2 (m): acceleration down.

    x (m, 17): their states; numbers (m, NUMBERS): their parameters. The jets of several add up. What a vehicle in a jet
    gives the air itself is what is left of its thrust.
    """
    lift_n = x[:, 13:17].sum(axis=1)
    for i in np.argsort(-x[:, 2]):
        reach_m, rotor_m, force_n = rotor_reach_m(numbers[i, WHEELBASE]), numbers[i, ROTOR_RADIUS], 0.0
        for j in range(len(x)):
            aside_m = hypot(x[j, 0] - x[i, 0], x[j, 1] - x[i, 1])
            upper_m = rotor_reach_m(numbers[j, WHEELBASE])
            force_n += jet_force_n(aside_m, x[j, 2] - x[i, 2], lift_n[j], upper_m, reach_m, rotor_m)
        lift_n[i] = max(lift_n[i] - force_n, 0.0)
        down_m_s2[i] = force_n / numbers[i, MASS]


@kernel
def ground_effect_gain(height_m: float, rotor_radius_m: float, coefficient: float) -> float:
    """Thrust gain near the floor: 1 / (1 - k (R / 4z)^2), Cheeseman and Bennett (1955), bounded.

    The rotors turn one radius above the vehicle's feet.
    """
    ratio = rotor_radius_m / (4.0 * (max(height_m, 0.0) + rotor_radius_m))
    return min(1.0 / max(1.0 - coefficient * ratio * ratio, 0.1), GROUND_EFFECT_MAX)


@kernel
def add_floor(x: Float, rot: Float, numbers: Float, force_lab: Float, torque_flu: Float) -> None:
    """Adds what the floor at z = 0 does to the four feet under the motors: spring, damper, friction."""
    mass = numbers[MASS]
    reach = rotor_reach_m(numbers[WHEELBASE])
    stiffness = mass * GRAVITY_M_S2 / (4.0 * CONTACT_DEPTH_M)
    damping = 0.5 * mass * sqrt(GRAVITY_M_S2 / CONTACT_DEPTH_M)
    for foot in range(4):
        fx = reach if foot in (0, 2) else -reach
        fy = reach if foot in (1, 2) else -reach
        depth = -(x[2] + rot[2, 0] * fx + rot[2, 1] * fy)
        if depth <= 0.0:
            continue
        # Velocity of the foot: v + R (w x r), with r in the body's x-y plane.
        cx, cy, cz = -x[12] * fy, x[12] * fx, x[10] * fy - x[11] * fx
        vx = x[3] + rot[0, 0] * cx + rot[0, 1] * cy + rot[0, 2] * cz
        vy = x[4] + rot[1, 0] * cx + rot[1, 1] * cy + rot[1, 2] * cz
        vz = x[5] + rot[2, 0] * cx + rot[2, 1] * cy + rot[2, 2] * cz
        normal = max(stiffness * depth - damping * vz, 0.0)
        grip = -FRICTION * normal / max(sqrt(vx * vx + vy * vy), FRICTION_SPEED_M_S)
        hx, hy = grip * vx, grip * vy
        force_lab[0] += hx
        force_lab[1] += hy
        force_lab[2] += normal
        bx = rot[0, 0] * hx + rot[1, 0] * hy + rot[2, 0] * normal
        by = rot[0, 1] * hx + rot[1, 1] * hy + rot[2, 1] * normal
        bz = rot[0, 2] * hx + rot[1, 2] * hy + rot[2, 2] * normal
        torque_flu[0] += fy * bz
        torque_flu[1] -= fx * bz
        torque_flu[2] += fx * by - fy * bx


@kernel
def turn(x: Float, dt_s: float) -> None:
    """q <- q * exp(w dt / 2): the attitude after `dt_s` at the state's body rate, exactly."""
    rate = sqrt(x[10] * x[10] + x[11] * x[11] + x[12] * x[12])
    half = 0.5 * rate * dt_s
    c = cos(half)
    s = sin(half) / rate if rate > 1e-12 else 0.5 * dt_s
    i, j, k = s * x[10], s * x[11], s * x[12]
    qw, qx, qy, qz = x[6], x[7], x[8], x[9]
    nw = qw * c - qx * i - qy * j - qz * k
    nx = qw * i + qx * c + qy * k - qz * j
    ny = qw * j - qx * k + qy * c + qz * i
    nz = qw * k + qx * j - qy * i + qz * c
    norm = sqrt(nw * nw + nx * nx + ny * ny + nz * nz)
    scale = 1.0 / norm if nw >= 0.0 else -1.0 / norm
    x[6], x[7], x[8], x[9] = nw * scale, nx * scale, ny * scale, nz * scale


@kernel
def body_step(x: Float, motor_target_n: Float, numbers: Float, dist_lab_m_s2: Float, dt_s: float, work: Float) -> None:
    """Advances `x` in place by dt_s <= 2 ms: first-order motors, then Newton and Euler's equations.

    motor_target_n: (4) thrust demanded of each motor; dist_lab_m_s2: (3) external acceleration;
    work: (5, 3) scratch. Semi-implicit: velocity first, then position and attitude with the new velocity.
    """
    rot, force, torque = work[:3], work[3], work[4]
    mass, reach = numbers[MASS], rotor_reach_m(numbers[WHEELBASE])
    lag = 1.0 - exp(-dt_s / numbers[MOTOR_LAG])
    for motor in range(4):
        x[13 + motor] += lag * (motor_target_n[motor] - x[13 + motor])
        if x[13 + motor] < 1e-12:
            x[13 + motor] = 0.0  # a stopped motor must not run on in slow subnormal numbers
    fr, rl, fl, rr = x[13], x[14], x[15], x[16]
    matrix_into(x[6:10], rot)
    lift = (fr + rl + fl + rr) * ground_effect_gain(x[2], numbers[ROTOR_RADIUS], numbers[GROUND_EFFECT])
    for axis in range(3):
        force[axis] = lift * rot[axis, 2] + mass * dist_lab_m_s2[axis]
    for body_axis in range(3):
        speed = rot[0, body_axis] * x[3] + rot[1, body_axis] * x[4] + rot[2, body_axis] * x[5]
        for axis in range(3):
            force[axis] -= numbers[DRAG + body_axis] * speed * rot[axis, body_axis]
    force[2] -= mass * GRAVITY_M_S2
    jx, jy, jz = numbers[INERTIA], numbers[INERTIA + 1], numbers[INERTIA + 2]
    p, q, r = x[10], x[11], x[12]
    torque[0] = reach * (rl + fl - fr - rr) + (jy - jz) * q * r
    torque[1] = reach * (rl + rr - fr - fl) + (jz - jx) * p * r
    torque[2] = numbers[YAW_TORQUE] * (fr + rl - fl - rr) + (jx - jy) * p * q
    if x[2] < numbers[WHEELBASE]:
        add_floor(x, rot, numbers, force, torque)
    for axis in range(3):
        x[3 + axis] += dt_s * force[axis] / mass
        x[axis] += dt_s * x[3 + axis]
        x[10 + axis] += dt_s * torque[axis] / numbers[INERTIA + axis]
    turn(x, dt_s)
