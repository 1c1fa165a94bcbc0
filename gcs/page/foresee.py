"""A shape or a start, judged and drawn before it is asked for: by the ground's own functions, in the page's process.

What the followers do at this instant is taken for rest; the ground judges anew when it is asked.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from formation.config import LabConfig
from formation.guidance.preview import Preview, expected_start, trajectory_from
from formation.guidance.shape import Shape, shape_for
from formation.guidance.shape_request import parse
from formation.guidance.transition import assigned, require_separation
from formation.maths.arrays import Float
from formation.messages import Phase, Verb
from formation.reasons import Reject
from formation.safety.rules_table import UNSEEN_S
from gcs.formation_change import (
    foreseen,
    leader_path_reject_reasons,
    names,
    slot_reject_reasons,
    space,
    trajectory_reject_reasons,
    transition_of,
)
from gcs.lab.feasibility import trajectory_text
from gcs.page.scene import Point, about
from wire.ground_state import DroneState, GroundState, ObservedBody

PATH_POINTS = 60


@dataclass(frozen=True, slots=True)
class Forecast:
    """Where the slots would be and the leader would go, what is against it, and what is to be said of it."""

    slots_lab_m: tuple[Point, ...]
    path_lab_m: tuple[Point, ...]
    against: tuple[str, ...]
    text: str


def shape(asked: str, state: GroundState, config: LabConfig) -> Forecast:
    """A shape in an operator's words, NAME [scale=S] [heading=DEGREES], asked for now."""
    try:
        wanted = shape_for(config, parse(asked))
        require_separation(wanted, space(config, 0.0), names(config))
    except ValueError as error:
        return Forecast((), (), (str(error),), "")
    return _judged(wanted, state, config, forming=state.phase is Phase.FORMATION, starting=False)


def start(state: GroundState, config: LabConfig) -> Forecast:
    """A start now, in the shape that is set."""
    return _judged(shape_for(config, parse(state.shape)), state, config, forming=True, starting=True)


def trajectory(asked: str, state: GroundState, config: LabConfig) -> Forecast:
    """One of the leader's trajectories, by name, flown from now on."""
    try:
        lab = config.flying(asked)
    except ValueError as error:
        return Forecast((), (), (str(error),), "")
    pose, _ = _leader_pose(state, config, aloft=state.phase is Phase.HOLD)
    ahead = foreseen(shape_for(config, parse(state.shape)), pose, None, 0.0, lab)
    against = (*state.allowed[Verb.TRAJECTORY], *_texts(trajectory_reject_reasons(ahead, lab)))
    return Forecast((), _leader_path(ahead), against, f"{asked}: {trajectory_text(lab, ahead)}")


def _judged(wanted: Shape, state: GroundState, config: LabConfig, forming: bool, starting: bool) -> Forecast:
    config = config.flying(state.trajectory)
    pose, seen = _leader_pose(state, config, forming)
    path, path_s = None, 0.0
    if state.trajectory_started and state.trajectory_from is not None and state.trajectory_s is not None:
        path, path_s = trajectory_from(config, np.array(state.trajectory_from)), state.trajectory_s[0]
    against: list[str] = []
    text = f"{wanted.name}: possible"
    if forming and seen:
        followers = state.drones[-len(config.followers) :]
        led, forming_now = _led(followers, pose), np.array([not drone.excluded for drone in followers])
        if led is not None:
            if not starting:
                wanted = assigned(wanted, led[:, 0, :3], forming_now)
            try:
                change = transition_of(wanted, led, float(pose[2]), config, forming_now)
                text = f"{wanted.name}: {change.duration_s:.1f} s, never nearer than {change.separation_m:.2f} m"
            except ValueError as error:
                against.append(str(error))
    ahead = foreseen(wanted, pose, path, path_s, config)
    against += _texts(leader_path_reject_reasons(ahead, config)) if starting else ()
    against += _texts(slot_reject_reasons(ahead, config))
    slots = about(_point(pose), float(pose[3]), wanted.offset_lead_m)
    return Forecast(slots, _leader_path(ahead) if config.leader.sysid is not None else (), tuple(against), text)


def _texts(rejects: Sequence[Reject]) -> tuple[str, ...]:
    return tuple(reject.text for reject in rejects)


def _leader_path(ahead: Preview) -> tuple[Point, ...]:
    """The leader's path, in a few points."""
    steps = np.linspace(0, len(ahead.leader) - 1, PATH_POINTS).astype(int)
    return tuple(_point(ahead.leader[k, 0]) for k in steps)


def _leader_pose(state: GroundState, config: LabConfig, aloft: bool) -> tuple[Float, bool]:
    """The leader's x, y, z, heading, at its flying height while it is not; and whether it is seen."""
    everybody: tuple[ObservedBody | DroneState, ...] = (*state.observed, *state.drones)
    leader = next((one for one in everybody if one.body == config.leader.body), None)
    pos, yaw = None if leader is None else leader.pos_lab_m, state.leader_yaw_rad
    if leader is None or pos is None or yaw is None or leader.age_s is None or leader.age_s > UNSEEN_S:
        return expected_start(config), False
    z = pos[2] if aloft or config.leader.sysid is None else config.flight.altitude_m
    return np.array([pos[0], pos[1], z, yaw]), True


def _led(followers: Sequence[DroneState], pose: Float) -> Float | None:
    """Where the followers are led now, at rest, as motions (followers, 3, 4) in the leader's frame.

    None where one that takes part is not led; who is left out has none.
    """
    nowhere = tuple(pose[:3].tolist())
    reported = [nowhere if drone.excluded else drone.reference_lab_m for drone in followers]
    if any(reference is None for reference in reported):
        return None
    c, s = math.cos(-float(pose[3])), math.sin(-float(pose[3]))
    motion = np.zeros((len(followers), 3, 4))
    away = np.array(reported) - pose[:3]
    motion[:, 0, 0], motion[:, 0, 1] = c * away[:, 0] - s * away[:, 1], s * away[:, 0] + c * away[:, 1]
    motion[:, 0, 2] = away[:, 2]
    return motion


def _point(pose: Float) -> Point:
    return float(pose[0]), float(pose[1]), float(pose[2])
