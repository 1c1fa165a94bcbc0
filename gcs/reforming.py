"""A request for a shape, seen from the flight as it is: which slots, whose, and a way into them."""

import numpy as np

from formation.arrays import Float
from formation.config import PERSONAL_SPACE, LabConfig
from formation.control.stack import Stages
from formation.relative import lead_from_lab
from formation.shape import Shape, shape_for
from formation.shape_request import parse
from formation.transition import Space, Transition, assigned, demand_room, transition

TRACKING_M = 0.02  # by so much together two followers may miss their references before they repel each other
INSET_M = 0.2


def requested(text: str, stages: Stages | None, config: LabConfig) -> Shape:
    """The shape an operator asks for, its slots dealt for least travel from where the followers are led.

    ValueError says what is wrong with the words or the shape.
    """
    shape = shape_for(config, parse(text))
    demand_room(shape, _space(config, 0.0), _names(config))
    if stages is None:
        return shape
    return assigned(shape, _led_motion(stages, config)[:, 0, :3])


def way(shape: Shape, stages: Stages, config: LabConfig) -> Transition:
    """The way from where the followers are led now into the slots of `shape`; ValueError says why there is none."""
    space = _space(config, float(stages.state.pos_lab_m[0, 2]))
    return transition(shape, _led_motion(stages, config), space, _names(config))


def _names(config: LabConfig) -> tuple[str, ...]:
    return tuple(vehicle.body for vehicle in config.vehicles)


def _space(config: LabConfig, leader_z_m: float) -> Space:
    """What the lab's limits leave, for a leader at that height."""
    limits = config.limits
    floor_m, ceiling_m = max(limits.fence.low_m[2], 0.0), limits.fence.high_m[2]
    return Space(
        min_separation_m=limits.min_separation_m,
        clearance_m=PERSONAL_SPACE * limits.min_separation_m + TRACKING_M,
        low_m=floor_m + INSET_M - leader_z_m,
        high_m=ceiling_m - INSET_M - leader_z_m,
        speed_m_s=config.flight.reform_m_s,
    )


def _led_motion(stages: Stages, config: LabConfig) -> Float:
    """Where the followers are led, as motions (followers, 3, 4) in the leader's frame."""
    reference, followers = stages.reference, len(config.followers)
    motion = np.zeros((followers, 3, 4))
    rows = slice(-followers, None)
    motion[:, 0, :3], motion[:, 0, 3] = reference.slot_lead_m[rows], reference.slot_yaw_rad[rows]
    motion[:, 1, :3], motion[:, 1, 3] = reference.slot_vel_lead_m_s[rows], reference.slot_yaw_rate_rad_s[rows]
    motion[:, 2, :3] = reference.slot_acc_lead_m_s2[rows]
    leader = _leader_motion(stages)
    for i in np.flatnonzero(~reference.in_formation[rows]):
        in_lab = motion[i].copy()
        lead_from_lab(in_lab, leader, motion[i])
    return motion


def _leader_motion(stages: Stages) -> Float:
    """The leader's estimated motion (3, 4) in `lab`."""
    state = stages.state
    motion = np.empty((3, 4))
    motion[0, :3], motion[0, 3] = state.pos_lab_m[0], state.yaw_rad[0]
    motion[1, :3], motion[1, 3] = state.vel_lab_m_s[0], state.yaw_rate_rad_s[0]
    motion[2, :3], motion[2, 3] = state.acc_lab_m_s2[0], state.yaw_acc_rad_s2[0]
    return motion
