"""A landing: where each drone comes down, how long that may take, and with which words it ends. Pure."""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from formation.config import LabConfig, LimitsConfig
from formation.maths.arrays import Float
from gcs.drones.drone import Drone
from gcs.drones.land_detector import NEAR_FLOOR_M

CLEARANCE = 1.5  # of the minimum separation: drones on the floor are not led any more
INSET_M = 0.1
HAND_OVER_S = 6.0
END_S = 10.0
FIRST_FRAME_NS = 200_000_000
"""How long a landing waits for its first frame, which shows the drones' heights."""


def landing_spots(pos_lab_m: Float, limits: LimitsConfig) -> Float:
    """A spot on the floor for each drone, (m, 2); its own x, y where that is free of lower drones' spots.

    pos_lab_m: (m, 3). One above another gets the nearest free spot beside, inside the fence; if there is none, its own.
    """
    clear_m = CLEARANCE * limits.min_separation_m
    spots = pos_lab_m[:, :2].copy()
    occupied: list[int] = []
    for i in np.argsort(pos_lab_m[:, 2], kind="stable"):
        if occupied and _distance(spots[occupied], spots[i]) < clear_m:
            others = [j for j in range(len(spots)) if j != i]
            spots[i] = _beside(spots[i], spots[others], clear_m, limits)
        occupied.append(int(i))
    return spots


def free_spot(own: Float, others: Float, limits: LimitsConfig) -> Float:
    """Where one drone lands alone, (2): below itself, or at the nearest spot in the fence clear of others (k, 2).

    Its own where there is none: those that pass above keep the minimum separation.
    """
    clear_m = CLEARANCE * limits.min_separation_m
    return own if _distance(others, own) >= clear_m else _beside(own, others, clear_m, limits)


def _beside(own: Float, others: Float, clear_m: float, limits: LimitsConfig) -> Float:
    low = np.array(limits.fence.low_m[:2]) + INSET_M
    high = np.array(limits.fence.high_m[:2]) - INSET_M
    angles = 2.0 * np.pi * np.arange(16) / 16
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    for k in range(1, 13):
        candidates = own + 0.5 * k * clear_m * ring
        for spot in candidates[((candidates >= low) & (candidates <= high)).all(axis=-1)]:
            if _distance(others, spot) >= clear_m:
                return np.asarray(spot)
    return own


def _distance(spots: Float, spot: Float) -> float:
    return float(np.linalg.norm(spots - spot, axis=-1).min())


class Descent(NamedTuple):
    """hand_over_ns: who has not landed by then is left to its autopilot's own landing; end_ns: when it is over."""

    hand_over_ns: int
    end_ns: int


def descent(drones: Iterable[Drone], config: LabConfig, begun_ns: int) -> Descent:
    """The times of a landing that began then; a drone whose height is not known is taken to be under the ceiling."""
    ceiling_m = config.limits.fence.high_m[2]
    heights_m = [ceiling_m if math.isnan(drone.floor.height_m) else drone.floor.height_m for drone in drones]
    descent_s = max(0.0, *heights_m) / config.flight.descend_m_s
    return Descent(begun_ns + round((descent_s + HAND_OVER_S) * 1e9), begun_ns + round((descent_s + END_S) * 1e9))


def takeover_text(drones: Iterable[Drone]) -> str:
    """Why drones under no ground can only be landed: the names of those that land already; empty where all fly."""
    down = [drone.link.name for drone in drones if drone.is_coming_down]
    return f"control taken to land: {', '.join(down)} on the floor, or landing already" if down else ""


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
    silent_s = drone.link.ages(now_ns).silent_s
    if silent_s > 1.0:
        return f"unheard for {silent_s:.0f} s, {_last_seen(drone)}" if math.isfinite(silent_s) else "never heard"
    return f"is still armed, in {drone.link.mode}" if drone.link.armed else "has not said that it is disarmed"


def _last_seen(drone: Drone) -> str:
    """Where the mocap last saw it."""
    if drone.floor.last_seen_lab_m is None:
        return "never seen by the mocap"
    x_m, y_m, z_m = drone.floor.last_seen_lab_m
    where = "on the floor" if z_m - drone.floor.rest_z_m < NEAR_FLOOR_M else "in the air"
    return f"last seen {where} at x {x_m:.2f}, y {y_m:.2f}, z {z_m:.2f} m"
