"""Requests for a shape, a trajectory or who takes part: whether it fits, and the transition into the slots.

A request is judged as the flight is; nothing changes until `Judged.apply`. A new request is a row of
formation.requests.Verb, of `gcs.permissions.CONDITIONS` and, where it changes more than the phase, of `judge`.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from formation.config import PERSONAL_SPACE, LabConfig, TrajectoryConfig
from formation.control.stack import Stages
from formation.guidance.preview import Preview, beyond_text, expected_start, outside_m, preview, trajectory_from
from formation.guidance.shape import Shape, shape_for
from formation.guidance.shape_request import parse
from formation.guidance.trajectory import Trajectory, anchored
from formation.guidance.transition import Space, Transition, assigned, require_separation, transition
from formation.maths.arrays import Bool, Float
from formation.maths.frames import rotate_about_z
from formation.messages import OperatorRequest, Phase, Verb
from formation.paper.eq2_relative_frame import lead_from_lab
from formation.reasons import LAND_ALL, Reason, Reject
from formation.requests import time_ns
from formation.safety.rules import Facts
from formation.safety.rules_table import UNSEEN_S
from gcs import moves
from gcs.finding import Grade, Keys
from gcs.flight import Flight
from gcs.lab.feasibility import judge_trajectory, trajectory_text
from gcs.landing import free_spot
from gcs.permissions import lacking

TRACKING_M = 0.02  # by so much together two followers may miss their references before the separation filter is asked
INSET_M = 0.2
WAITED_NS = 3_600_000_000_000
SAMPLES = 200  # along the leader's path; a sample takes 15 us of a tick


class Judged(NamedTuple):
    """The reasons against a request, or what to do where there are none."""

    reasons: tuple[Reject, ...] = ()
    apply: Callable[[], None] = lambda: None


def judge(request: OperatorRequest, flight: Flight, facts: Facts, stages: Stages | None, now_ns: int) -> Judged:
    """Whether a start, a shape, a trajectory, a way home or a landing alone fits; other requests do.

    Called where gcs.permissions allows the request.
    """
    match request.verb:
        case Verb.START if stages is not None:
            return start(request.argument, flight, stages, now_ns)
        case Verb.RESUME if stages is not None:
            path_s = flight.interrupted_s or 0.0
            return _form(flight, stages, flight.trajectory, path_s, partial(flight.resume, now_ns=now_ns))
        case Verb.SHAPE:
            return change(request.argument, flight, facts, stages, now_ns)
        case Verb.TRAJECTORY:
            return choose(request.argument, flight, facts, stages)
        case Verb.HOME if stages is not None:
            return home(flight, stages, now_ns)
        case Verb.MOVE if stages is not None:
            return move(request.argument, flight, facts, stages, now_ns)
        case Verb.LAND if request.argument:
            return leave(request.argument, flight, stages, now_ns)
        case _:
            return Judged()


def participation(request: OperatorRequest, flight: Flight) -> tuple[frozenset[str], tuple[Reject, ...]]:
    """The bodies left out of the flight after a request, and every reason against that; most requests change nothing.

    argument: bodies, with commas between; `arm` names all that fly, or nobody, and then changes nothing. Any one drone
    may be armed alone, to see which it is: gcs.permissions rejects its take-off.
    """
    excluded, verb, config = frozenset(flight.excluded), request.verb, flight.config
    if verb not in (Verb.EXCLUDE, Verb.INCLUDE) and not (verb is Verb.ARM and request.argument):
        return excluded, ()
    named = frozenset(request.argument.split(","))
    drones = frozenset(vehicle.body for vehicle in config.vehicles if vehicle.sysid is not None)
    if unknown := sorted(named - drones):
        return excluded, (Reason.NO_DRONE.of(", ".join(unknown), ", ".join(names(config))),)
    after = {Verb.EXCLUDE: excluded | named, Verb.INCLUDE: excluded - named}.get(verb, drones - named)
    is_alone = verb is Verb.ARM and len(named) == 1
    return after, () if is_alone else tuple(lacking(config, after))


def home(flight: Flight, stages: Stages, now_ns: int) -> Judged:
    """Lead all to above where they took off, or why not.

    They form as they stood, by a transition that keeps them apart, and the leader then flies there.
    """
    config = flight.config
    shape, pose = flight.start_shape(), _leader_pose(stages)
    stay = anchored(TrajectoryConfig(), pose[:3], float(pose[3]))
    if reasons := slot_reject_reasons(foreseen(shape, pose, stay, 0.0, config), config):
        return Judged(reasons)
    return _set_out(shape, flight, stages, partial(flight.go_home, now_ns=now_ns))


def leave(body: str, flight: Flight, stages: Stages | None, now_ns: int) -> Judged:
    """Land one follower alone while the others fly on, or why not.

    It lands at the nearest spot that is clear of the others, of their slots and of where these are led.
    """
    config, bodies = flight.config, names(flight.config)
    followers = [follower.body for follower in config.followers]
    if body == config.leader.body:
        return Judged((Reason.LEADER_NEEDED.of(body, LAND_ALL),))
    if body not in followers:
        return Judged((Reason.NO_DRONE.of(body, ", ".join(bodies)),))
    if stages is None or not flight.forming[followers.index(body)]:
        return Judged((Reason.NOT_FLYING.of(body),))
    if np.count_nonzero(flight.forming) == 1:
        return Judged((Reason.NONE_LEFT.of(LAND_ALL),))
    ahead = foreseen(flight.shape, _leader_pose(stages), *flight.trajectory_progress(now_ns), config)
    others = [i for i, follower in enumerate(followers) if flight.forming[i] and follower != body]
    here_m, own = stages.state.pos_lab_m[:, :2], bodies.index(body)
    paths_m = np.vstack((ahead.leader[:, 0, :2], ahead.slots[:, others, 0, :2].reshape(-1, 2)))
    spot = free_spot(here_m[own], np.vstack((np.delete(here_m, own, axis=0), paths_m)), config.limits)
    return Judged(apply=partial(flight.leave, body, (float(spot[0]), float(spot[1]))))


def move(asked: str, flight: Flight, facts: Facts, stages: Stages, now_ns: int) -> Judged:
    """Have one drone go on at a velocity, within what its surroundings leave, or why not; in formation the leader."""
    config, bodies = flight.config, names(flight.config)
    found = moves.asked_of(asked)
    if found is None:
        return Judged((Reason.NO_VELOCITY.of(asked),))
    body, wanted = found
    drone, in_formation = flight.drone(body), flight.phase is Phase.FORMATION
    if drone is None:
        return Judged((Reason.NO_DRONE.of(body, ", ".join(bodies)),))
    if in_formation and drone.index != 0:
        return Judged((Reason.NOT_LEADER.of(body),))
    if flight.moved_body not in (None, body):
        return Judged((Reason.MOVED_ALREADY.of(flight.moved_body),))
    if not drone.flown or not drone.floor.lifted or drone.leaving_to is not None:
        return Judged((Reason.NOT_FLYING.of(body),))
    if facts.age_s[drone.index] > UNSEEN_S:
        return Judged((Reason.NO_POSE_TO_LEAD.of(body),))
    forming = flight.forming if in_formation else np.zeros(len(config.followers), np.bool_)
    others = [i for i in range(len(bodies)) if i != drone.index and not (i > 0 and forming[i - 1])]
    surroundings = moves.Surroundings(
        at_m=stages.reference.slot_lead_m[config.commanded.index(drone.index)],
        others_m=stages.state.pos_lab_m[others][facts.age_s[others] <= UNSEEN_S],
        clear_m=PERSONAL_SPACE * config.limits.min_separation_m,
        slots_m=rotate_about_z(stages.state.yaw_rad[0], flight.shape.offsets[forming]),
        fence=config.limits.fence,
        floor_m=drone.floor.rest_z_m,
        speed_m_s=min(config.flight.formation_change_m_s, config.limits.speed_m_s),
    )
    return Judged(apply=partial(flight.move, drone, moves.limited(wanted, surroundings), now_ns))


def start(at: str, flight: Flight, stages: Stages, now_ns: int) -> Judged:
    """Form the flight's shape about the leader, or why not: shape or transition would leave the fence.

    at: when the leader's trajectory is to begin, ns of the ground's clock; empty: as soon as all slots are taken.
    """
    if at and flight.config.leader.sysid is None:
        return Judged((Reason.LEADER_OBSERVED.of(flight.config.leader.body),))
    begin_ns = time_ns(at)
    if at and not (begin_ns is not None and now_ns < begin_ns < now_ns + WAITED_NS):
        return Judged((Reason.NO_TIME.of(),))
    return _form(flight, stages, None, 0.0, partial(flight.form, begin_ns=begin_ns))


def _form(
    flight: Flight, stages: Stages, path: Trajectory | None, path_s: float, apply: Callable[[Transition], None]
) -> Judged:
    """Set out for the slots of the flight's shape, on what is left of that path; or why not."""
    config = flight.config
    ahead = foreseen(flight.shape, _leader_pose(stages), path, path_s, config)
    outside = leader_path_reject_reasons(ahead, config) + slot_reject_reasons(ahead, config)
    return Judged(outside) if outside else _set_out(flight.shape, flight, stages, apply)


def change(asked: str, flight: Flight, facts: Facts, stages: Stages | None, now_ns: int) -> Judged:
    """Take another shape, or why not; judged on the ground as in the air.

    In formation the followers set out at once. Else it is kept for the start, and judged above where the leader is, at
    the height of the take-off; or, while it is not seen, where the lab file expects it.
    """
    config, forming = flight.config, flight.phase is Phase.FORMATION
    try:
        shape = requested(asked, stages, config, flight.forming)
    except ValueError as error:
        return Judged((Reason.NO_SHAPE.of(error),))
    pose = _start_pose(facts, stages, config, aloft=forming)
    ahead = foreseen(shape, pose, *flight.trajectory_progress(now_ns), config)
    if reasons := slot_reject_reasons(ahead, config):
        return Judged(reasons)
    if forming and stages is not None:
        return _set_out(shape, flight, stages, flight.change_formation)
    return Judged(apply=partial(flight.choose_shape, shape))


def choose(asked: str, flight: Flight, facts: Facts, stages: Stages | None) -> Judged:
    """Have the leader fly another trajectory when it is started next, or why not; judged from where it is now.

    On the ground at the height of the take-off, and while the leader is not seen from where the lab file expects it.
    """
    try:
        config = flight.lab.flying(asked)
    except ValueError as error:
        return Judged((Reason.NO_TRAJECTORY.of(error),))
    pose = _start_pose(facts, stages, config, aloft=flight.phase is Phase.HOLD)
    ahead = foreseen(flight.shape, pose, None, 0.0, config)
    infeasible = (
        Reason.INFEASIBLE.of(finding.why)
        for finding in judge_trajectory(config, Keys(config), ahead)
        if finding.grade is Grade.FAIL
    )
    reasons = (*leader_path_reject_reasons(ahead, config), *slot_reject_reasons(ahead, config), *infeasible)
    return Judged(reasons, partial(flight.choose, asked, trajectory_text(config, ahead)))


def requested(text: str, stages: Stages | None, config: LabConfig, forming: Bool) -> Shape:
    """The shape an operator asks for, its slots dealt for least travel from where those followers are led that form.

    ValueError says what is wrong with the words or the shape.
    """
    shape = shape_for(config, parse(text))
    require_separation(shape, space(config, 0.0), names(config))
    if stages is None:
        return shape
    return assigned(shape, _led_motion(stages, config)[:, 0, :3], forming)


def compute_transition(shape: Shape, stages: Stages, config: LabConfig, forming: Bool) -> Transition:
    """The transition from the references of the followers that form into their slots of `shape`.

    ValueError says why there is none.
    """
    motion_lead, leader_z_m = _led_motion(stages, config), float(stages.state.pos_lab_m[0, 2])
    rows = np.flatnonzero(forming).tolist()
    who = [config.leader.body, *(config.followers[i].body for i in rows)]
    found = transition(shape.part(rows), motion_lead[rows], space(config, leader_z_m), who)
    rise_m = np.zeros(len(forming))
    rise_m[rows] = found.rise_m
    return replace(found, shape=shape, rise_m=tuple(rise_m.tolist()))


def _set_out(shape: Shape, flight: Flight, stages: Stages, apply: Callable[[Transition], None]) -> Judged:
    """Have `apply` start the transition into the slots, or why there is none."""
    try:
        return Judged(apply=partial(apply, compute_transition(shape, stages, flight.config, flight.forming)))
    except ValueError as error:
        return Judged((Reason.NO_TRANSITION.of(error),))


def foreseen(shape: Shape, pose: Float, path: Trajectory | None, path_s: float, config: LabConfig) -> Preview:
    """Where the shape is led, taken up with the leader at `pose` (4), on what is left of its path path_s along it.

    path: None, if it has not begun; it then begins here.
    """
    return preview(trajectory_from(config, pose) if path is None else path, shape, pose, path_s, SAMPLES)


def slot_reject_reasons(ahead: Preview, config: LabConfig) -> tuple[Reject, ...]:
    """Which slots would be outside the fence, at once or where the leader's trajectory carries them."""
    fence, half_m, reasons = config.limits.fence, config.half_widths_m[1:], list[Reject]()
    at_start, on_path = outside_m(ahead.at_start, fence, half_m), outside_m(ahead.slots[:, :, 0], fence, half_m)
    for k, follower in enumerate(config.followers):
        sample = int(np.argmax(on_path[:, k]))
        if at_start[k] > 0.0:
            where = beyond_text(ahead.at_start[k], fence, half_m[k])
            reasons.append(Reason.SLOT_OUTSIDE.of(follower.body, where))
        elif on_path[sample, k] > 0.0:
            where = beyond_text(ahead.slots[sample, k, 0], fence, half_m[k])
            where = f"{where}, {ahead.t_s[sample]:.1f} s along the leader's path"
            reasons.append(Reason.SLOT_OUTSIDE.of(follower.body, where))
    return tuple(reasons)


def leader_path_reject_reasons(ahead: Preview, config: LabConfig) -> tuple[Reject, ...]:
    """Where the leader itself would leave the fence on its trajectory."""
    fence, half_m = config.limits.fence, config.half_widths_m[0]
    out = outside_m(ahead.leader[:, 0, :3], fence, half_m)
    sample = int(np.argmax(out))
    if config.leader.sysid is None or out[sample] <= 0.0:
        return ()
    where = f"{beyond_text(ahead.leader[sample, 0, :3], fence, half_m)}, {ahead.t_s[sample]:.1f} s along its path"
    return (Reason.LEADER_OUTSIDE.of(config.leader.body, where),)


def names(config: LabConfig) -> tuple[str, ...]:
    """All vehicles, leader first."""
    return tuple(vehicle.body for vehicle in config.vehicles)


def space(config: LabConfig, leader_z_m: float) -> Space:
    """The space that the lab's limits leave for a leader at that height."""
    limits = config.limits
    floor_m, ceiling_m = max(limits.fence.low_m[2], 0.0), limits.fence.high_m[2]
    return Space(
        min_separation_m=limits.min_separation_m,
        clearance_m=PERSONAL_SPACE * limits.min_separation_m + TRACKING_M,
        low_m=floor_m + INSET_M - leader_z_m,
        high_m=ceiling_m - INSET_M - leader_z_m,
        speed_m_s=config.flight.formation_change_m_s,
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


def _start_pose(facts: Facts, stages: Stages | None, config: LabConfig, aloft: bool) -> Float:
    """Where the leader is when the formation is taken up: where it is, or while it is not seen is expected to be."""
    pose = expected_start(config) if stages is None or facts.age_s[0] > UNSEEN_S else _leader_pose(stages)
    if not aloft and config.leader.sysid is not None:
        pose[2] = config.flight.altitude_m
    return pose


def _leader_pose(stages: Stages) -> Float:
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
