"""Performance bound: how little any controller could deviate in the gust, by the motors' torque and the loop's delay.

It is told, one reaction time after the push begins, all of the push that is still to come, and steers without noise;
only its torque is limited. Small angles along one axis: the least largest deviation is a linear program.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import toeplitz
from scipy.optimize import linprog
from scipy.signal import cont2discrete

from drone_agent.simulation.disturbance import acceleration
from formation.maths.arrays import Float
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleProfile
from sim.scenario import Scenario

STEP_S = 0.002
HELD_STEPS = 5  # the torque changes as often as a frame of 100 Hz brings news
BEGUN = 0.01  # of its peak: the push has begun
BEFORE_S, AFTER_S = 0.3, 1.4
REACTIONS_S = (0.01, 0.02, 0.03, 0.04, 0.05, 0.06)


@dataclass(frozen=True, slots=True)
class GustPass:
    """One pass of the gust and the vehicle in it. push_m_s2 (T,): along the axis, from its beginning on."""

    push_m_s2: Float
    turn_max_rad_s2: float
    motor_lag_s: float


def gust_pass(scenario: Scenario) -> GustPass:
    """The first pass of the scenario's fan over its follower, and that follower's profile."""
    follower = scenario.lab.followers[0]
    profile = scenario.lab.profile_of(follower)
    push = _push(scenario, profile)
    begun = int(np.argmax(np.abs(push) > BEGUN * np.abs(push).max()))
    # A hovering vehicle's motors can stop or double: one side can have all the weight.
    return GustPass(push[begun:], profile.turn_1_m * GRAVITY_M_S2, profile.motor_lag_s)


def reaction_s(scenario: Scenario, gust: GustPass) -> float:
    """From the beginning of the push to the first torque against it, at the least.

    Until the push has moved the vehicle by the mocap's own noise nobody can see it; then cameras, half a frame, the
    link down and the vehicle's inside pass it on.
    """
    follower = scenario.lab.followers[0]
    moved_m = np.abs(np.cumsum(np.cumsum(gust.push_m_s2))) * STEP_S**2
    seen_s = STEP_S * float(np.argmax(moved_m > scenario.mocap.noise_m))
    on_its_way_s = scenario.mocap.delay_s + 0.5 / scenario.mocap.rate_hz + scenario.link.down_s
    return seen_s + on_its_way_s + scenario.lab.profile_of(follower).command_delay_s


def least_deviation_m(gust: GustPass, reaction: float) -> float:
    """The least largest deviation, m, of a controller that acts from `reaction` seconds on."""
    length = len(gust.push_m_s2)
    by_push, by_turn = _responses(gust.motor_lag_s, length)
    drift = np.convolve(by_push, gust.push_m_s2)[:length]
    starts = np.arange(round(reaction / STEP_S), length, HELD_STEPS)
    steered = np.add.reduceat(toeplitz(by_turn, np.zeros(length)), starts, axis=1)
    bound = -np.ones((length, 1))
    deviation = np.append(np.zeros(steered.shape[1]), 1.0)
    result = linprog(
        deviation,
        A_ub=np.block([[steered, bound], [-steered, bound]]),
        b_ub=np.concatenate([-drift, drift]),
        bounds=[(-gust.turn_max_rad_s2, gust.turn_max_rad_s2)] * steered.shape[1] + [(0.0, None)],
    )
    return float(deviation @ result.x)


def _push(scenario: Scenario, profile: VehicleProfile) -> Float:
    """The push along x on the place the follower holds, around the fan's first pass over its middle."""
    fan = scenario.air.fan
    if fan is None:
        raise ValueError(f"{scenario.name} has no fan")
    place = np.array(scenario.leader.pose.pos_lab_m) + np.array(scenario.lab.followers[0].offset_m)
    x, y, z = place.tolist()
    middle_s = fan.phase_s + fan.period_s * (1.0 + np.ceil((fan.start_s - fan.phase_s) / fan.period_s))
    times = np.arange(middle_s - BEFORE_S, middle_s + AFTER_S, STEP_S)
    return np.array([acceleration(scenario.air, float(t), (x, y, z), profile.reach_m)[0] for t in times])


def _responses(motor_lag_s: float, length: int) -> tuple[Float, Float]:
    """Position after one step of unit push, and after one step of unit angular acceleration asked for; (length,)."""
    a = np.zeros((5, 5))  # position, velocity, tilt, its rate, its acceleration
    a[0, 1], a[1, 2], a[2, 3], a[3, 4], a[4, 4] = 1.0, GRAVITY_M_S2, 1.0, 1.0, -1.0 / motor_lag_s
    b = np.zeros((5, 2))
    b[1, 0], b[4, 1] = 1.0, 1.0 / motor_lag_s
    step, into, *_ = cont2discrete((a, b, np.eye(5), np.zeros((5, 2))), STEP_S)
    state, pos_m = into, np.zeros((length, 2))
    for k in range(1, length):
        pos_m[k] = state[0]
        state = step @ state
    return pos_m[:, 0], pos_m[:, 1]
