"""The drawn scene: each body's position, reference and trail. Pure; `lab`, m, rad."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from formation.config import LabConfig
from formation.messages import Phase
from wire.ground_state import DroneState, GroundState, ObservedBody

Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Body:
    """One vehicle: size_m from motor to motor, seen now or not, and where it should be if it is led."""

    name: str
    pos_lab_m: Point
    q_lab_from_flu: tuple[float, float, float, float]
    size_m: float
    leader: bool
    seen: bool
    rejected: bool
    armed: bool
    reference_lab_m: Point | None
    trail_lab_m: tuple[Point, ...]


@dataclass(frozen=True, slots=True)
class Scene:
    """Everything that moves in the picture. pairs: those nearer than twice the least separation."""

    bodies: tuple[Body, ...]
    slots_lab_m: tuple[Point, ...]
    pairs: tuple[tuple[int, int, float], ...]
    keep_outs: tuple[tuple[Point, float], ...]


class Trails:
    """Where each body has been: a point every step, the newest of them."""

    def __init__(self, step_m: float = 0.02, newest: int = 60) -> None:
        self._step_m, self._newest = step_m, newest
        self._points: dict[str, deque[Point]] = {}

    def add(self, name: str, point: Point) -> tuple[Point, ...]:
        """The trail of a body that is there now."""
        trail = self._points.setdefault(name, deque(maxlen=self._newest))
        if not trail or math.dist(trail[-1], point) >= self._step_m:
            trail.append(point)
        return (*trail, point)

    def last(self, name: str) -> Point | None:
        """Where a body that is not seen now was; None where it never was."""
        trail = self._points.get(name)
        return trail[-1] if trail else None


def scene(state: GroundState, config: LabConfig, trails: Trails) -> Scene:
    """The scene of the ground's state."""
    everybody: tuple[ObservedBody | DroneState, ...] = (*state.observed, *state.drones)
    reported = {body.body: body for body in everybody}
    bodies = []
    for vehicle in config.vehicles:
        body = reported.get(vehicle.body)
        pos_lab_m = None if body is None else body.pos_lab_m or trails.last(vehicle.body)
        if body is None or pos_lab_m is None:
            continue
        drone = body if isinstance(body, DroneState) else None
        bodies.append(
            Body(
                name=vehicle.body,
                pos_lab_m=pos_lab_m,
                q_lab_from_flu=body.q_lab_from_flu or (1.0, 0.0, 0.0, 0.0),
                size_m=config.profile_of(vehicle).wheelbase_m,
                leader=vehicle is config.leader,
                seen=body.pos_lab_m is not None,
                rejected=vehicle.body in state.rejected,
                armed=drone is not None and drone.armed,
                reference_lab_m=None if drone is None else drone.reference_lab_m,
                trail_lab_m=trails.add(vehicle.body, pos_lab_m),
            )
        )
    separation_m = config.limits.min_separation_m
    return Scene(
        tuple(bodies),
        _slots(state, bodies, config),
        tuple(
            (i, j, distance_m)
            for i, one in enumerate(bodies)
            for j in range(i)
            if (distance_m := math.dist(one.pos_lab_m, bodies[j].pos_lab_m)) < 2.0 * separation_m
        ),
        tuple((body.pos_lab_m, separation_m + 0.3) for body in bodies if not body.seen),
    )


def _slots(state: GroundState, bodies: Sequence[Body], config: LabConfig) -> tuple[Point, ...]:
    """The slots about where the leader is; of a leader that stands on the floor, at the height it will fly at."""
    leader = next((body for body in bodies if body.leader), None)
    if leader is None or state.leader_yaw_rad is None:
        return ()
    grounded = state.phase in (Phase.GROUND, Phase.ARMED, Phase.TAKEOFF) and config.leader.sysid is not None
    z0 = config.flight.altitude_m if grounded else leader.pos_lab_m[2]
    (x0, y0, _), c, s = leader.pos_lab_m, math.cos(state.leader_yaw_rad), math.sin(state.leader_yaw_rad)
    return tuple((x0 + c * x - s * y, y0 + s * x + c * y, z0 + z) for x, y, z in state.slots_lead_m)
