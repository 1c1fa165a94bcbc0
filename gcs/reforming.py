"""A request for a shape or a trajectory, seen from the flight as it is: whether it fits, and a way into the slots."""

import numpy as np

from formation.config import PERSONAL_SPACE, LabConfig
from formation.control.relative_frame import lead_from_lab
from formation.control.stack import Stages
from formation.guidance.preview import Preview, beyond_text, expected_start, outside_m, preview, trajectory_from
from formation.guidance.shape import Shape, shape_for
from formation.guidance.shape_request import parse
from formation.guidance.trajectory import Trajectory
from formation.guidance.transition import Space, Transition, assigned, demand_room, transition
from formation.maths.arrays import Float
from formation.messages import OperatorRequest, Phase, Verb
from formation.safety.rules import Facts
from gcs.finding import Grade
from gcs.flight import Flight
from gcs.lab.keys import Keys
from gcs.lab.pace import judge_way, way_text

TRACKING_M = 0.02  # by so much together two followers may miss their references before the separation filter is asked
INSET_M = 0.2
FRESH_S = 0.2
LOOKS = 200  # along the leader's way; a look takes 15 us of a tick
CHANGES = frozenset({Verb.SHAPE, Verb.TRAJECTORY})
"""What may be asked for that changes no phase."""
CHOOSING = (Phase.GROUND, Phase.ARMED, Phase.TAKEOFF, Phase.HOLD)
"""Where the leader's trajectory may be chosen: it neither flies one nor waits for its slots to be taken."""


def ask(
    request: OperatorRequest, flight: Flight, facts: Facts, stages: Stages | None, now_ns: int
) -> tuple[str, ...]:  # fmt: skip
    """Carry out a request of CHANGES, or say why not."""
    if request.verb is Verb.SHAPE:
        return change(request.argument, flight, facts, stages, now_ns)
    return choose(request.argument, flight, facts, stages)


def start(flight: Flight, facts: Facts, stages: Stages | None, config: LabConfig) -> tuple[str, ...]:
    """Take the flight's shape up where the leader is; or why not, if it or the way from here would leave the fence."""
    unseen = leader_refusals(facts, config)
    if unseen or stages is None:
        return unseen
    ahead = foreseen(flight.shape, _leader_place(stages), None, 0.0, config)
    outside = way_refusals(ahead, config) + room_refusals(ahead, config)
    return outside or _set_out(flight.shape, flight, stages, config)


def change(asked: str, flight: Flight, facts: Facts, stages: Stages | None, now_ns: int) -> tuple[str, ...]:
    """Take another shape, or say why not; judged on the ground as in the air.

    In formation the followers set out at once. Else it is kept for the start, and judged above where the leader is, at
    the height of the take-off; or, while it is not seen, where the lab file expects it.
    """
    config = flight.config
    unseen, forming = leader_refusals(facts, config), flight.phase is Phase.FORMATION
    if forming and (unseen or stages is None):
        return unseen
    try:
        shape = requested(asked, stages, config)
    except ValueError as error:
        return (str(error),)
    place = _start_place(unseen, stages, config, aloft=forming)
    ahead = foreseen(shape, place, *flight.on_the_way(now_ns), config)
    if refusals := room_refusals(ahead, config):
        return refusals
    if forming and stages is not None:
        return _set_out(shape, flight, stages, config)
    flight.shape = shape
    return ()


def choose(asked: str, flight: Flight, facts: Facts, stages: Stages | None) -> tuple[str, ...]:
    """Have the leader fly another trajectory when it is started next, or say why not; judged from where it is now.

    On the ground at the height of the take-off, and while the leader is not seen from where the lab file expects it.
    """
    if refusals := choosing_refusals(flight):
        return refusals
    try:
        config = flight.lab.flying(asked)
    except ValueError as error:
        return (str(error),)
    place = _start_place(leader_refusals(facts, config), stages, config, aloft=flight.phase is Phase.HOLD)
    ahead = foreseen(flight.shape, place, None, 0.0, config)
    if refusals := trajectory_refusals(ahead, config):
        return refusals
    flight.choose(asked, way_text(config, ahead))
    return ()


def choosing_refusals(flight: Flight) -> tuple[str, ...]:
    """Why no trajectory of the leader's can be chosen now, whichever it is."""
    leader = flight.config.leader
    if leader.sysid is None:
        return (f"{leader.body}: it is only observed, and flies what it flies",)
    if flight.phase not in CHOOSING:
        names = ", ".join(phase.name for phase in CHOOSING)
        return (f"{Verb.TRAJECTORY} is for {names}, this is {flight.phase.name}",)
    return ()


def trajectory_refusals(ahead: Preview, config: LabConfig) -> tuple[str, ...]:
    """Why a trajectory of the leader's cannot be flown: fence, speed, tilt, thrust and turn, the slots' too."""
    pace = (finding.why for finding in judge_way(config, Keys(config), ahead) if finding.grade is Grade.FAIL)
    return (*way_refusals(ahead, config), *room_refusals(ahead, config), *pace)


def requested(text: str, stages: Stages | None, config: LabConfig) -> Shape:
    """The shape an operator asks for, its slots dealt for least travel from where the followers are led.

    ValueError says what is wrong with the words or the shape.
    """
    shape = shape_for(config, parse(text))
    demand_room(shape, space(config, 0.0), names(config))
    if stages is None:
        return shape
    return assigned(shape, _led_motion(stages, config)[:, 0, :3])


def way(shape: Shape, stages: Stages, config: LabConfig) -> Transition:
    """The way from where the followers are led now into the slots of `shape`; ValueError says why there is none."""
    room = space(config, float(stages.state.pos_lab_m[0, 2]))
    return transition(shape, _led_motion(stages, config), room, names(config))


def _set_out(shape: Shape, flight: Flight, stages: Stages, config: LabConfig) -> tuple[str, ...]:
    """Find everybody a way into the slots, or say why not."""
    try:
        flight.reform(way(shape, stages, config))
    except ValueError as error:
        return (str(error),)
    return ()


def foreseen(shape: Shape, place: Float, path: Trajectory | None, path_s: float, config: LabConfig) -> Preview:
    """Where the shape is led, taken up with the leader at `place` (4), on what is left of its path path_s along it.

    path: None, if it has not begun; it then begins here.
    """
    return preview(trajectory_from(config, place) if path is None else path, shape, place, path_s, LOOKS)


def leader_refusals(facts: Facts, config: LabConfig) -> tuple[str, ...]:
    """Why nothing can be formed now: no leader to see."""
    if facts.age_s[0] > FRESH_S:
        return (f"{config.leader.body}: no fresh pose, there is nothing to form on",)
    return ()


def room_refusals(ahead: Preview, config: LabConfig) -> tuple[str, ...]:
    """Which slots would be outside the fence, at once or where the leader's trajectory carries them."""
    fence, refusals = config.limits.fence, []
    at_start, on_way = outside_m(ahead.at_start, fence), outside_m(ahead.slots[:, :, 0], fence)
    for k, follower in enumerate(config.followers):
        look = int(np.argmax(on_way[:, k]))
        if at_start[k] > 0.0:
            where = beyond_text(ahead.at_start[k], fence)
            refusals.append(f"{follower.body}: its slot would be outside the fence, {where}")
        elif on_way[look, k] > 0.0:
            where = f"{beyond_text(ahead.slots[look, k, 0], fence)}, {ahead.t_s[look]:.1f} s on the leader's way"
            refusals.append(f"{follower.body}: its slot would be outside the fence, {where}")
    return tuple(refusals)


def way_refusals(ahead: Preview, config: LabConfig) -> tuple[str, ...]:
    """Where the leader itself would leave the fence on its trajectory."""
    out = outside_m(ahead.leader[:, 0, :3], config.limits.fence)
    look = int(np.argmax(out))
    if config.leader.sysid is None or out[look] <= 0.0:
        return ()
    where = f"{beyond_text(ahead.leader[look, 0, :3], config.limits.fence)}, {ahead.t_s[look]:.1f} s on its way"
    return (f"{config.leader.body}: it would be outside the fence, {where}",)


def names(config: LabConfig) -> tuple[str, ...]:
    """All vehicles, leader first."""
    return tuple(vehicle.body for vehicle in config.vehicles)


def space(config: LabConfig, leader_z_m: float) -> Space:
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


def _start_place(unseen: tuple[str, ...], stages: Stages | None, config: LabConfig, aloft: bool) -> Float:
    """Where the leader is when the formation is taken up: where it is, or while it is not seen is expected to be."""
    place = expected_start(config) if unseen or stages is None else _leader_place(stages)
    if not aloft and config.leader.sysid is not None:
        place[2] = config.flight.altitude_m
    return place


def _leader_place(stages: Stages) -> Float:
    """Where the leader is now, x, y, z, heading (4)."""
    return np.array([*stages.state.pos_lab_m[0], stages.state.yaw_rad[0]])


def _leader_motion(stages: Stages) -> Float:
    """The leader's estimated motion (3, 4) in `lab`."""
    state = stages.state
    motion = np.empty((3, 4))
    motion[0, :3], motion[0, 3] = state.pos_lab_m[0], state.yaw_rad[0]
    motion[1, :3], motion[1, 3] = state.vel_lab_m_s[0], state.yaw_rate_rad_s[0]
    motion[2, :3], motion[2, 3] = state.acc_lab_m_s2[0], state.yaw_acc_rad_s2[0]
    return motion
