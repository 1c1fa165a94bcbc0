"""The bound of formation.vehicle.bound in a scenario's gust: its push, and how soon that scenario's loop reacts."""

import numpy as np

from drone_agent.simulation.disturbance import acceleration
from formation.maths.arrays import Float
from formation.vehicle import bound
from formation.vehicle.bound import STEP_S, AttitudeLoop
from sim.scenario import Scenario

BEFORE_S, AFTER_S = 0.3, 0.7
BEGUN = 0.01
"""Of its peak: the push has begun."""


def attitude_loop(scenario: Scenario) -> AttitudeLoop:
    """The follower's, as its profile says, behind the cameras' delay."""
    lab = scenario.lab
    return bound.attitude_loop(lab.profile_of(lab.followers[0]), scenario.mocap.delay_s, lab.limits.tilt_rad)


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
