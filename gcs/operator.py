"""What an operator may ask, and the answers."""

from collections.abc import Sequence
from math import isfinite

from formation.config import LabConfig
from formation.messages import Phase
from formation.reasons import Reason, Reject
from formation.safety import arming
from formation.safety.phases import AFTER_STOP
from formation.safety.rules import Facts
from formation.safety.rules_table import HEARTBEAT_S
from gcs.drones.drone import TAKE_OFF_S, Drone
from gcs.flight import Flight


def takeoff_reject_reasons(
    facts: Facts, flight: Flight, drones: Sequence[Drone], config: LabConfig, now_ns: int
) -> tuple[Reject, ...]:
    """Why the swarm may not leave the floor now; as for arming, and every drone must have armed, and stay so."""
    not_armed = () if flight.armed else (Reason.NOT_ARMED.of(),)
    return arming.prearm_failures(facts, config.limits) + not_armed + _too_late(drones, now_ns)


def _too_late(drones: Sequence[Drone], now_ns: int) -> tuple[Reject, ...]:
    """Who would disarm by itself before it has lifted off."""
    left_s = [drone.disarms_in_s(now_ns) for drone in drones]
    return tuple(
        Reason.DISARMS_ITSELF.of(drone.link.name, left, TAKE_OFF_S)
        for drone, left in zip(drones, left_s, strict=True)
        if left is not None and left < TAKE_OFF_S
    )


def armed_text(flight: Flight, now_ns: int) -> str:
    """What is said when every drone is armed: for how long they will be."""
    first = flight.first_to_disarm(now_ns)
    if first is None:
        return "every drone is armed"
    return f"every drone is armed; take off within {max(first[1] - TAKE_OFF_S, 0.0):.1f} s ({first[0]} disarms itself)"


def done_text(flight: Flight) -> str:
    """What is said of a request that was carried out at once."""
    trajectory = f", trajectory {flight.trajectory_name}" if flight.config.leader.trajectories else ""
    after = f"; {AFTER_STOP}" if flight.phase is Phase.STOPPED else ""
    return f"phase {flight.phase.name}, shape {flight.shape.name}{trajectory}{after}"


def reset_reject_reasons(drones: Sequence[Drone], now_ns: int) -> tuple[Reject, ...]:
    """Why a stop is not over: whose motors are on, or may be."""
    armed = tuple(Reason.ARMED.of(drone.link.name) for drone in drones if drone.link.armed)
    return armed + tuple(
        Reason.MAY_BE_ARMED.of(drone.link.name, _last_heartbeat(drone.link.heartbeat_age_s(now_ns)))
        for drone in drones
        if drone.link.heartbeat_age_s(now_ns) > HEARTBEAT_S
    )


def _last_heartbeat(age_s: float) -> str:
    return f"last heard {age_s:.1f} s ago" if isfinite(age_s) else "never heard"
