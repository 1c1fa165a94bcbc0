"""How long a landing may take: within height over rate of descent and ten seconds it has ended, whatever happens."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from formation.config import LabConfig
from gcs.drones.drone import NEAR_FLOOR_M, Drone

HAND_OVER_S = 6.0
END_S = 10.0
FIRST_FRAME_NS = 200_000_000
"""How long a landing waits for its first frame, which shows the drones' heights."""


@dataclass(frozen=True, slots=True)
class Descent:
    """hand_over_ns: who has not landed by then is left to its autopilot's own landing; end_ns: when it is over."""

    hand_over_ns: int
    end_ns: int


def descent(drones: Iterable[Drone], config: LabConfig, begun_ns: int) -> Descent:
    """The times of a landing that began then; a drone whose height is not known is taken to be under the ceiling."""
    ceiling_m = config.limits.fence.high_m[2]
    heights_m = [ceiling_m if math.isnan(drone.height_m) else drone.height_m for drone in drones]
    descent_s = max(0.0, *heights_m) / config.flight.descend_m_s
    return Descent(begun_ns + round((descent_s + HAND_OVER_S) * 1e9), begun_ns + round((descent_s + END_S) * 1e9))


def late_text(drones: Iterable[Drone], now_ns: int) -> str:
    """With what a landing ends that has taken too long: which drones may have motors turning, and what is known."""
    left = [drone for drone in drones if not drone.piloted and not drone.is_landed]
    return f"the landing has taken too long: {_states(left, now_ns)}"


def landed_text(drones: Iterable[Drone], now_ns: int) -> str:
    """With what a landing ends that waits for no drone any more."""
    lost = [drone for drone in drones if drone.is_lost(now_ns)]
    if lost:
        return f"LAND ended: {_states(lost, now_ns)}"
    piloted = [drone.link.name for drone in drones if drone.piloted]
    return f"landed, but for {', '.join(piloted)}: a pilot's" if piloted else "every drone has landed and is disarmed"


def _states(drones: Iterable[Drone], now_ns: int) -> str:
    return "; ".join(f"{drone.link.name} {_state(drone, now_ns)}" for drone in drones)


def _state(drone: Drone, now_ns: int) -> str:
    silent_s = drone.link.silent_s(now_ns)
    if silent_s > 1.0:
        return f"unheard for {silent_s:.0f} s, {_last_seen(drone)}" if math.isfinite(silent_s) else "never heard"
    return f"is still armed, in {drone.link.mode}" if drone.link.armed else "has not said that it is disarmed"


def _last_seen(drone: Drone) -> str:
    """Where the mocap last saw it."""
    if drone.last_seen_lab_m is None:
        return "never seen by the mocap"
    x_m, y_m, z_m = drone.last_seen_lab_m
    where = "on the floor" if z_m - drone.rest_z_m < NEAR_FLOOR_M else "in the air"
    return f"last seen {where} at x {x_m:.2f}, y {y_m:.2f}, z {z_m:.2f} m"
