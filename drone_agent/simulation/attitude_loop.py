"""The fast inner loop of a simulated autopilot: attitude P, rate loop, mixer, motors and body, in one compiled call.

The structure is PX4's: tilt error first, yaw by the rest, rate setpoint bounded, torques mixed onto four motors
with roll and pitch before yaw. The target's own delay (`VehicleProfile.command_delay_s`) is the caller's queue.
"""

from dataclasses import dataclass
from math import acos, asin, cos, sin, sqrt
from typing import Protocol

import numpy as np

from drone_agent.guard.position import LoopSetpoint
from formation.maths.arrays import Float
from formation.maths.copying import copy_into
from formation.maths.kernel import kernel
from formation.maths.quaternion import multiply_into
from formation.vehicle.body import (
    ATTITUDE_P,
    INERTIA,
    RATE_FEED_FORWARD,
    RATE_MAX,
    RATE_P,
    RATE_YAW_MAX,
    RATE_YAW_P,
    THRUST_CURVE,
    THRUST_MAX,
    WHEELBASE,
    YAW_P,
    YAW_TORQUE,
)
from formation.vehicle.profile import VehicleProfile, VehicleState
from formation.vehicle.rigid_body import body_step, rotor_reach_m

STEP_MAX_S = 0.002
WHOLE_MOTORS: Float = np.ones(4)


def advance(
    state: VehicleState,
    profile: VehicleProfile,
    setpoint: LoopSetpoint,
    armed: bool,
    dist_lab_m_s2: Float,
    dt_s: float,
    steps: int,
    thrust_scale: float = 1.0,
    motor_gain: Float = WHOLE_MOTORS,
) -> VehicleState:
    """The state `steps` steps of `dt_s` later; the input is not changed.

    dist_lab_m_s2: (3) external acceleration; dt_s <= 2 ms, else ValueError; thrust_scale: what the battery
    leaves of the full thrust; motor_gain: (4) each motor's share of its commanded thrust, front right, rear left, front
    left, rear right. Unarmed motors are off. Deterministic to the bit.
    """
    if not 0.0 < dt_s <= STEP_MAX_S:
        raise ValueError(f"attitude loop step must lie in (0, {STEP_MAX_S}] s, got {dt_s}")
    x = state.x.copy()
    advance_into(
        x,
        profile.numbers,
        setpoint.target,
        armed,
        thrust_scale,
        motor_gain,
        dist_lab_m_s2,
        dt_s,
        steps,
    )
    return VehicleState(x)


@kernel
def turn_target(q_lab_from_flu: Float, q_estimated: Float, asked: Float, target: Float) -> None:
    """The target (8) that a loop flies whose attitude estimate is q_estimated where it should be q_lab_from_flu."""
    back, turn = -q_estimated, np.empty(4)
    back[0] = q_estimated[0]
    multiply_into(q_lab_from_flu, back, turn)
    multiply_into(turn, asked[0:4], target[0:4])
    copy_into(asked[4:8], target[4:8])


@kernel
def rate_setpoint(x: Float, target: Float, numbers: Float, rate_sp: Float) -> None:
    """Body rates that turn the attitude onto the target: tilt by the shortest arc, yaw by its own gain.

    target: a LoopSetpoint's. After Brescianini et al. 2013, as PX4's AttitudeControl.
    """
    w, i, j, k = x[6], -x[7], -x[8], -x[9]
    tw, tx, ty, tz = target[0], target[1], target[2], target[3]
    ew = w * tw - i * tx - j * ty - k * tz
    ex = w * tx + i * tw + j * tz - k * ty
    ey = w * ty - i * tz + j * tw + k * tx
    ez = w * tz + i * ty - j * tx + k * tw
    if ew < 0.0:
        ew, ex, ey, ez = -ew, -ex, -ey, -ez
    # q_err = tilt * yaw, the yaw about the target's own z.
    flat = sqrt(ew * ew + ez * ez)
    if flat < 1e-6:
        tilt_w, tilt_x, tilt_y, yaw_half = 0.0, ex, ey, 0.0
    else:
        tilt_w = flat
        tilt_x = (ew * ex - ez * ey) / flat
        tilt_y = (ew * ey + ez * ex) / flat
        yaw_half = asin(min(max(ez / flat, -1.0), 1.0))
    tilt = 2.0 * acos(min(tilt_w, 1.0))
    sine = sqrt(tilt_x * tilt_x + tilt_y * tilt_y)
    gain = numbers[ATTITUDE_P] * (2.0 * sin(0.5 * tilt) / sine if sine > 1e-9 else 2.0)
    limit, limit_yaw = numbers[RATE_MAX], numbers[RATE_YAW_MAX]
    honoured = numbers[RATE_FEED_FORWARD]
    rate_sp[0] = min(max(gain * tilt_x + honoured * target[4], -limit), limit)
    rate_sp[1] = min(max(gain * tilt_y + honoured * target[5], -limit), limit)
    # The yaw feed-forward is always honoured, seen in the body's own axes.
    yaw_rate = numbers[YAW_P] * 2.0 * yaw_half * cos(tilt) + target[6]
    rate_sp[2] = min(max(yaw_rate, -limit_yaw), limit_yaw)


@kernel
def mix(collective_n: float, torque: Float, numbers: Float, motor_max_n: float, motors: Float) -> None:
    """Motor thrusts that give the collective and as much of the torque as fits: roll and pitch first, then yaw."""
    reach = rotor_reach_m(numbers[WHEELBASE])
    roll, pitch, yaw = torque[0] / (4.0 * reach), torque[1] / (4.0 * reach), torque[2] / (4.0 * numbers[YAW_TORQUE])
    tilt = abs(roll) + abs(pitch)
    # As PX4 without air-mode: too much thrust gives way to the torque, too little thrust cuts the torque.
    base = min(max(0.25 * collective_n, 0.0), max(motor_max_n - tilt, 0.5 * motor_max_n))
    headroom = min(base, motor_max_n - base)
    tilt_scale = min(1.0, headroom / tilt) if tilt > 0.0 else 1.0
    left = headroom - tilt_scale * tilt
    yaw = min(max(yaw, -left), left)
    motors[0] = base + tilt_scale * (-roll - pitch) + yaw
    motors[1] = base + tilt_scale * (roll + pitch) + yaw
    motors[2] = base + tilt_scale * (roll - pitch) - yaw
    motors[3] = base + tilt_scale * (pitch - roll) - yaw


@kernel
def advance_into(
    x: Float, numbers: Float, target: Float, armed: bool, thrust_scale: float, motor_gain: Float,
    dist_lab_m_s2: Float, dt_s: float, steps: int,
) -> None:  # fmt: skip
    """`steps` turns of attitude loop, mixer and body, in place."""
    rate_sp, torque, motors, thrusts = np.zeros(3), np.zeros(3), np.zeros(4), np.zeros(4)
    work = np.zeros((5, 3))
    u = min(max(target[7], 0.0), 1.0)
    full_n = numbers[THRUST_MAX] * thrust_scale
    collective_n = full_n * ((1.0 - numbers[THRUST_CURVE]) * u + numbers[THRUST_CURVE] * u * u)
    for _ in range(steps):
        if armed:
            rate_setpoint(x, target, numbers, rate_sp)
            torque[0] = numbers[INERTIA] * numbers[RATE_P] * (rate_sp[0] - x[10])
            torque[1] = numbers[INERTIA + 1] * numbers[RATE_P] * (rate_sp[1] - x[11])
            torque[2] = numbers[INERTIA + 2] * numbers[RATE_YAW_P] * (rate_sp[2] - x[12])
            mix(collective_n, torque, numbers, 0.25 * full_n, motors)
        for motor in range(4):
            thrusts[motor] = motors[motor] * motor_gain[motor]
        body_step(x, thrusts, numbers, dist_lab_m_s2, dt_s, work)


class Advance(Protocol):
    """As drone_agent.simulation.attitude_loop.advance."""

    def __call__(
        self,
        state: VehicleState,
        profile: VehicleProfile,
        setpoint: LoopSetpoint,
        armed: bool,
        dist_lab_m_s2: Float,
        dt_s: float,
        steps: int,
        thrust_scale: float,
        motor_gain: Float,
    ) -> VehicleState:
        """The state `steps` steps of `dt_s` later; the input is left alone."""


@dataclass(frozen=True, slots=True)
class Physics:
    """A model, and the grid it is advanced on."""

    step_ns: int
    advance: Advance


OWN = Physics(1_000_000, advance)
"""Ours, at 1 kHz."""
