"""How long a landing may take: within height over rate of descent and ten seconds it has ended, whatever happens."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from formation.config import LabConfig
from gcs.drones.drone import Drone

HAND_OVER_S = 6.0
END_S = 10.0
LOOK_NS = 200_000_000
"""For so long a first frame is waited for, which tells how high the drones are."""


@dataclass(frozen=True, slots=True)
class Descent:
    """hand_over_ns: who has not landed by then is left to its autopilot's own landing; end_ns: when it is over."""

    hand_over_ns: int
    end_ns: int


def descent(drones: Iterable[Drone], config: LabConfig, begun_ns: int) -> Descent:
    """The times of a landing that began then; a drone whose height is not known is taken to be under the ceiling."""
    ceiling_m = config.limits.fence.high_m[2]
    heights_m = [ceiling_m if math.isnan(drone.height_m) else drone.height_m for drone in drones]
    way_s = max(0.0, *heights_m) / config.flight.descend_m_s
    return Descent(begun_ns + round((way_s + HAND_OVER_S) * 1e9), begun_ns + round((way_s + END_S) * 1e9))


def ended_text(drones: Iterable[Drone], now_ns: int) -> str:
    """With what a landing ends that has taken too long: who may still have motors turning, and what is known of it."""
    left = (drone for drone in drones if not drone.grounded(now_ns))
    said = "; ".join(f"{drone.link.name} {_state(drone, now_ns)}" for drone in left)
    return f"the landing has taken too long: {said}"


def _state(drone: Drone, now_ns: int) -> str:
    silent_s = drone.link.silent_s(now_ns)
    if silent_s > 1.0:
        return f"has been silent for {silent_s:.0f} s"
    return f"is still armed, in {drone.link.mode}" if drone.link.armed else "has not said that it is disarmed"
