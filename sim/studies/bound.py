"""How little any controller could deviate in the gust, by the vehicle's motors and the loop's delay.

One reaction time after the push begins, the ideal controller knows the rest of the push, and steers without noise.
A true lower bound for the push at the place that is held, since each step gives it more than the vehicle can do:

- its tilt is at any time whatever the motors could have reached by then from level hover, all of their thrust on one
  side and none on the other, through their lag and up to the autopilot's body rate (sines and cosines as they are);
- at that tilt it has any thrust from none to all, at once, and need not keep its height; nor need the tilt be taken
  back, nor the thrust be followed, before the push ends: what it has of sideways force is any function of time within
  +-(full thrust / m) sin(tilt it could have reached);
- drag never works against it: it adds to that force as much as it could at the speed that the push alone gives.

The least largest deviation under such a force is a linear program over exact steps of a double integrator; the force
may change at every step, and the limit of a step is that of its end.

Who commands attitudes has less: an autopilot that answers after a dead time and with a first-order lag, as the profile
says, and the lab's limit of tilt. The same program with that answer between command and force bounds every such law.
"""

from dataclasses import dataclass
from math import tan
from typing import Any

import numpy as np
from scipy import sparse
from scipy.optimize import linprog

from drone_agent.simulation.disturbance import acceleration
from formation.maths.arrays import Float
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleProfile
from sim.scenario import Scenario

STEP_S = 0.002
BEGUN = 0.01  # of its peak: the push has begun
BEFORE_S, AFTER_S = 0.3, 0.7


@dataclass(frozen=True, slots=True)
class GustPass:
    """One pass of the gust and the vehicle in it. push_m_s2 (T,): along the axis, from its beginning on.

    turn_max_rad_s2, rate_max_rad_s: of the tilt; thrust_max_m_s2: full thrust over mass; drag_1_s: the largest of the
    body's axes over mass.
    """

    push_m_s2: Float
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


def attitude_loop(scenario: Scenario) -> AttitudeLoop:
    """The follower's, as its profile says, behind the cameras' delay."""
    profile = scenario.lab.profile_of(scenario.lab.followers[0])
    most_m_s2 = GRAVITY_M_S2 * tan(scenario.lab.limits.tilt_rad)
    return AttitudeLoop(scenario.mocap.delay_s + profile.response_dead_time_s, profile.response_lag_s, most_m_s2)


def gust_pass(scenario: Scenario) -> GustPass:
    """The first pass of the scenario's fan over its follower, and that follower's profile."""
    follower = scenario.lab.followers[0]
    profile = scenario.lab.profile_of(follower)
    push = _push(scenario, profile)
    begun = int(np.argmax(np.abs(push) > BEGUN * np.abs(push).max()))
    thrust_max_m_s2 = profile.thrust_max_n / profile.mass_kg
    return GustPass(
        push[begun:],
        profile.turn_1_m * 0.5 * thrust_max_m_s2,  # two motors full, two stopped
        profile.rate_max_rad_s,
        profile.motor_lag_s,
        thrust_max_m_s2,
        max(profile.drag_n_s_m) / profile.mass_kg,
    )


def reaction_s(scenario: Scenario) -> float:
    """From the beginning of the push to the first torque against it, at the least.

    The camera exposes at that very moment and sees it, however little it has moved the drone; then the cameras, the
    link down and the vehicle's inside pass it on.
    """
    inside_s = scenario.lab.profile_of(scenario.lab.followers[0]).command_delay_s
    return scenario.mocap.delay_s + scenario.link.down_s + inside_s


def seen_s(scenario: Scenario, gust: GustPass) -> float:
    """An estimate, not a bound: from the beginning of the push until it has moved the drone by the mocap's noise."""
    moved_m = np.abs(np.cumsum(np.cumsum(gust.push_m_s2))) * STEP_S**2
    return STEP_S * float(np.argmax(moved_m > scenario.mocap.noise_m))


def least_deviation_m(gust: GustPass, reaction: float) -> float:
    """A lower bound of the largest deviation, m, of any controller that acts from `reaction` seconds on."""
    one, nothing = _shifted(gust, 0), _column(gust, 0.0)
    # Unknown: the force of each step, velocity and position at its end, and the largest deviation.
    steps: Any = sparse.block_array([[*row, nothing if k == 0 else None] for k, row in enumerate(_motion(gust, 0.0))])
    within: Any = sparse.block_array(
        [[0.0 * one, 0.0 * one, one, _column(gust, -1.0)], [None, None, -one, _column(gust, -1.0)]]
    )
    limits = [(-f, f) for f in _force_most_m_s2(gust, reaction).tolist()]
    return _least_m(steps, within, _impulses(gust), limits)


def least_deviation_by_attitude_m(gust: GustPass, loop: AttitudeLoop) -> float:
    """A lower bound of the largest deviation, m, of any law that commands attitudes through this loop."""
    one, nothing = _shifted(gust, 0), _column(gust, 0.0)
    share = -np.expm1(-STEP_S / loop.lag_s)
    answer = [-share * _shifted(gust, int(loop.dead_s / STEP_S)), one - (1.0 - share) * _shifted(gust, 1)]
    # Unknown: the command of each step before the others.
    steps: Any = sparse.block_array(
        [[*answer, None, None, nothing], *([None, *row, None] for row in _motion(gust, gust.drag_1_s))]
    )
    deviation = _column(gust, -1.0)
    within: Any = sparse.block_array(
        [[0.0 * one, 0.0 * one, 0.0 * one, one, deviation], [None, None, None, -one, deviation]]
    )
    impulses = np.concatenate([np.zeros(len(gust.push_m_s2)), _impulses(gust)])
    return _least_m(steps, within, impulses, [(-loop.most_m_s2, loop.most_m_s2)] * len(gust.push_m_s2))


def _motion(gust: GustPass, drag_1_s: float) -> list[list[Any]]:
    """Exact steps of a double integrator: force, velocity and position (columns) of two equations."""
    one, before = _shifted(gust, 0), _shifted(gust, 1)
    return [
        [-STEP_S * one, one - (1.0 - STEP_S * drag_1_s) * before, None],
        [-0.5 * STEP_S**2 * one, -STEP_S * before, one - before],
    ]


def _impulses(gust: GustPass) -> Float:
    return np.concatenate([STEP_S * gust.push_m_s2, 0.5 * STEP_S**2 * gust.push_m_s2])


def _shifted(gust: GustPass, steps: int) -> Any:
    """The matrix that takes each step's value from so many steps before."""
    return sparse.eye_array(len(gust.push_m_s2), k=-steps)


def _column(gust: GustPass, value: float) -> Any:
    return sparse.csr_array(np.full((len(gust.push_m_s2), 1), value))


def _least_m(steps: Any, within: Any, impulses: Float, limits: list[tuple[float, float]]) -> float:
    """The last unknown, minimised; limits: of the first unknowns, all others are free."""
    free = steps.shape[1] - len(limits) - 1
    result = linprog(
        np.append(np.zeros(steps.shape[1] - 1), 1.0),
        A_eq=steps,
        b_eq=impulses,
        A_ub=within,
        b_ub=np.zeros(within.shape[0]),
        bounds=[*limits, *[(None, None)] * free, (0.0, None)],
    )
    return float(np.asarray(result.x)[-1])


def _force_most_m_s2(gust: GustPass, reaction: float) -> Float:
    """The most sideways acceleration that the vehicle could have at the end of each step; (T,)."""
    ends_s = STEP_S * np.arange(1, len(gust.push_m_s2) + 1)
    acting_s = np.maximum(ends_s - reaction, 0.0)
    # Of a torque asked for at once, through the motors' lag: its integral is t - lag (1 - e^(-t / lag)).
    rate = gust.turn_max_rad_s2 * (acting_s - gust.motor_lag_s * -np.expm1(-acting_s / gust.motor_lag_s))
    # Summed at the ends of the steps while it grows: never less than the integral.
    tilt = np.minimum(STEP_S * np.cumsum(np.minimum(rate, gust.rate_max_rad_s)), 0.5 * np.pi)
    drag: Float = gust.drag_1_s * STEP_S * np.cumsum(np.abs(gust.push_m_s2))
    return np.asarray(gust.thrust_max_m_s2 * np.sin(tilt) + drag)


def _push(scenario: Scenario, profile: VehicleProfile) -> Float:
    """The push along x on the place the follower holds, around the fan's first pass over its middle."""
    fan = scenario.air.fan
    if fan is None:
        raise ValueError(f"{scenario.name} has no fan")
    slot_lab_m = np.array(scenario.leader.pose.pos_lab_m) + np.array(scenario.lab.followers[0].offset_m)
    x, y, z = slot_lab_m.tolist()
    middle_s = fan.phase_s + fan.period_s * (1.0 + np.ceil((fan.start_s - fan.phase_s) / fan.period_s))
    times = np.arange(middle_s - BEFORE_S, middle_s + AFTER_S, STEP_S)
    return np.array([acceleration(scenario.air, float(t), (x, y, z), profile.reach_m)[0] for t in times])
