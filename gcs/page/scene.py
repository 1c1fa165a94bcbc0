"""The drawn scene: each body's position, reference and trail. Pure; `lab`, m, rad."""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from formation.config import LabConfig

Point = tuple[float, float, float]
TRAIL = 60
TRAIL_STEP_M = 0.02


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
    """Where each body has been; a point every two centimetres, the newest sixty."""

    def __init__(self) -> None:
        self._points: dict[str, deque[Point]] = {}

    def add(self, name: str, point: Point) -> tuple[Point, ...]:
        """The trail of a body that is there now."""
        trail = self._points.setdefault(name, deque(maxlen=TRAIL))
        if not trail or math.dist(trail[-1], point) >= TRAIL_STEP_M:
            trail.append(point)
        return (*trail, point)

    def last(self, name: str) -> Point | None:
        """Where a body that is not seen now was; None where it never was."""
        trail = self._points.get(name)
        return trail[-1] if trail else None


def scene(state: Mapping[str, Any], config: LabConfig, trails: Trails) -> Scene:
    """The scene of the ground's state."""
    drones = {str(drone["body"]): drone for drone in (*state["observed"], *state["drones"])}
    bodies = []
    for vehicle in config.vehicles:
        drone = drones.get(vehicle.body)
        if drone is None:
            continue
        pos = drone["pos_lab_m"]
        pos_lab_m = trails.last(vehicle.body) if pos is None else (float(pos[0]), float(pos[1]), float(pos[2]))
        if pos_lab_m is None:
            continue
        q, reference = drone["q_lab_from_flu"] or (1.0, 0.0, 0.0, 0.0), drone.get("reference_lab_m")
        bodies.append(
            Body(
                name=vehicle.body,
                pos_lab_m=pos_lab_m,
                q_lab_from_flu=(q[0], q[1], q[2], q[3]),
                size_m=config.profile_of(vehicle).wheelbase_m,
                leader=vehicle is config.leader,
                seen=pos is not None,
                rejected=bool(drone.get("rejected")),
                armed=bool(drone.get("armed")),
                reference_lab_m=None if reference is None else (reference[0], reference[1], reference[2]),
                trail_lab_m=trails.add(vehicle.body, pos_lab_m),
            )
        )
    separation_m = config.limits.min_separation_m
    return Scene(
        tuple(bodies),
        _slots(state, bodies, config),
        _near_pairs(bodies, 2.0 * separation_m),
        tuple((body.pos_lab_m, separation_m + 0.3) for body in bodies if not body.seen),
    )


def _slots(state: Mapping[str, Any], bodies: Sequence[Body], config: LabConfig) -> tuple[Point, ...]:
    """The slots about where the leader is; of a leader that stands on the floor, at the height it will fly at."""
    leader = next((body for body in bodies if body.leader), None)
    if leader is None or state["leader_yaw_rad"] is None:
        return ()
    grounded = state["phase"] in ("GROUND", "ARMED", "TAKEOFF") and config.leader.sysid is not None
    z = config.flight.altitude_m if grounded else leader.pos_lab_m[2]
    at = (leader.pos_lab_m[0], leader.pos_lab_m[1], z)
    return about(at, float(state["leader_yaw_rad"]), state["slots_lead_m"])


def about(leader_lab_m: Point, yaw_rad: float, slots_lead_m: Sequence[Sequence[float]]) -> tuple[Point, ...]:
    """Points of the leader's frame in `lab`."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    x0, y0, z0 = leader_lab_m
    return tuple((x0 + c * x - s * y, y0 + s * x + c * y, z0 + z) for x, y, z in slots_lead_m)


def _near_pairs(bodies: Sequence[Body], within_m: float) -> tuple[tuple[int, int, float], ...]:
    pairs = []
    for i, one in enumerate(bodies):
        for j in range(i):
            distance_m = math.dist(one.pos_lab_m, bodies[j].pos_lab_m)
            if distance_m < within_m:
                pairs.append((i, j, distance_m))
    return tuple(pairs)
