"""`python -m bench.performance_bound --vehicle px4_quad`: how little any controller could deviate in the gust.

By the vehicle's motors and the loop's delay. One reaction time after the push begins, the ideal controller knows the
rest of the push, and steers without noise. A true lower bound at the place that is held, since each step gives it more
than the vehicle can do:

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

import json
from dataclasses import dataclass, replace
from math import tan

import numpy as np
import typer

from bench.command import Json, Vehicle
from drone_agent.simulation.disturbance import acceleration
from formation.maths.arrays import Float
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleProfile
from sim.cli.studies import vehicle_profile
from sim.research.experiments import Experiment, Job, scenario_of
from sim.scenario import Scenario

STEP_S = 0.002
BEFORE_S, AFTER_S = 0.3, 0.7
BEGUN = 0.01
"""Of its peak: the push has begun."""


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


def reaction_s(scenario: Scenario) -> float:
    """From the beginning of the push to the first torque against it, at the least.

    The camera exposes at that very moment and sees it, however little it has moved the drone; then the cameras, the
    link down and the vehicle's inside pass it on.
    """
    inside_s = scenario.lab.profile_of(scenario.lab.followers[0]).command_delay_s
    return scenario.mocap.delay_s + scenario.link.down_s + inside_s


def gust_push(scenario: Scenario) -> Float:
    """The first pass of the scenario's fan over the place that its follower holds, (T) every STEP_S, m/s^2, along the
    push, from its beginning on; ValueError without a fan."""
    fan = scenario.air.fan
    if fan is None:
        raise ValueError(f"{scenario.name} has no fan")
    follower = scenario.lab.followers[0]
    slot_lab_m = np.array(scenario.leader.pose.pos_lab_m) + np.array(follower.offset_m)
    x, y, z = slot_lab_m.tolist()
    middle_s = fan.phase_s + fan.period_s * (1.0 + np.ceil((fan.start_s - fan.phase_s) / fan.period_s))
    times = np.arange(middle_s - BEFORE_S, middle_s + AFTER_S, STEP_S)
    reach_m = scenario.lab.profile_of(follower).reach_m
    push = np.abs([acceleration(scenario.air, float(t), (x, y, z), reach_m)[0] for t in times])
    return np.asarray(push[int(np.argmax(push > BEGUN * push.max())) :])


def main(vehicle: Vehicle = "paper_40g", as_json: Json = False) -> None:
    """Print the least deviation in the gust that any controller could reach, by what it commands."""
    profile = vehicle_profile(vehicle)
    scenario = scenario_of(Job("cfc", Experiment.GUST, seed=1, vehicle=profile))
    push_m_s2 = gust_push(scenario)
    loop = attitude_loop(profile, scenario.mocap.delay_s, scenario.lab.limits.tilt_rad)
    sooner = replace(loop, dead_s=loop.dead_s - scenario.mocap.delay_s)  # no camera delays an accelerometer
    bounds_m = {
        "by motors": least_deviation_m(push_m_s2, turning(profile), reaction_s(scenario)),
        "by attitude commands": least_deviation_by_attitude_m(push_m_s2, loop),
        "with an accelerometer": least_deviation_by_attitude_m(push_m_s2, sooner),
    }
    for how, least_m in bounds_m.items():
        typer.echo(f"{how}: {1e3 * least_m:.2f} mm at least", err=as_json)
    if as_json:
        print(json.dumps(bounds_m))


if __name__ == "__main__":
    typer.run(main)
