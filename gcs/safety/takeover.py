"""Drones that fly under no ground, and other grounds: why arming is rejected, and what taking control requires."""

from collections.abc import Iterable, Sequence

from formation.reasons import Reason, Reject
from formation.safety.rules import Facts
from formation.safety.rules_table import HEARTBEAT_S
from gcs.drones.checks import prearm_failures
from gcs.drones.drone import AIRBORNE_STATES, Drone
from wire.link_messages import LandedState

FRESH_S = 0.2


def flying(drones: Iterable[Drone]) -> tuple[Drone, ...]:
    """Drones that are armed, or report that they are in the air."""
    return tuple(drone for drone in drones if drone.link.armed or drone.link.telemetry.landed in AIRBORNE_STATES)


def arming_reject_reasons(up: Sequence[Drone], others: Sequence[str]) -> tuple[Reject, ...]:
    """Why this ground must not arm the drones now: some may be flying, or belong to another ground."""
    reasons = [Reason.ALOFT.of(drone.link.name, _state(drone)) for drone in up]
    return (*((Reason.FLYING.of(),) if up else ()), *reasons, *_other_grounds(others))


def take_control_reject_reasons(
    drones: Sequence[Drone], facts: Facts, others: Sequence[str], seen: bool
) -> tuple[Reject, ...]:  # fmt: skip
    """Why this ground cannot take control; `land` and `stop` remain possible.

    seen: whether there is an estimate of the drones' positions.
    """
    armed = [drone for drone in drones if drone.link.armed]
    if not armed:
        return (Reason.NONE_ARMED.of(),)
    unseen = [d for d in armed if not seen or facts.age_s[d.index] > FRESH_S]
    reasons = [Reason.NO_POSE_TO_LEAD.of(drone.link.name) for drone in unseen]
    reasons += [reason for drone in armed for reason in prearm_failures(drone.link)]
    return (*reasons, *_other_grounds(others))


def land_reject_reasons(drones: Sequence[Drone], now_ns: int) -> tuple[Reject, ...]:
    """Why nothing is left to land on the ground: every drone is heard, disarmed and not in the air."""
    unheard = any(drone.link.heartbeat_age_s(now_ns) > HEARTBEAT_S for drone in drones)
    return () if unheard or flying(drones) else (Reason.NONE_FLIES.of(),)


def joining_reject_reasons(drones: Iterable[Drone], now_ns: int) -> tuple[Reject, ...]:
    """Drones that do not follow this ground yet."""
    return tuple(Reason.JOINING.of(drone.link.name) for drone in drones if drone.joining(now_ns))


def coming_down(drone: Drone) -> bool:
    """Whether the drone has landed, or its autopilot lands it; a landing is not interrupted."""
    link = drone.link
    return not link.armed or link.landing or link.telemetry.landed is LandedState.ON_GROUND


def landing_text(drones: Iterable[Drone]) -> str:
    """Why the drones can only be landed: the names of those that are landing already; empty where all fly."""
    down = [drone.link.name for drone in drones if coming_down(drone)]
    return f"control taken to land: {', '.join(down)} on the floor, or landing already" if down else ""


def other_grounds(drones: Iterable[Drone], on_bus: Iterable[str], now_ns: int) -> tuple[str, ...]:
    """Every sign of another live ground: grounds on the bus, and drones that answer another ground."""
    answers = (d.link.name for d in drones if d.link.answers_other_ground(now_ns))
    return (*(f"ground {name}" for name in on_bus), *(f"{name} answers another ground" for name in answers))


def _other_grounds(others: Sequence[str]) -> tuple[Reject, ...]:
    return (Reason.OTHER_GROUND.of(", ".join(others)),) if others else ()


def _state(drone: Drone) -> str:
    link = drone.link
    return f"armed, in {link.mode}" if link.armed else f"in the air, it says ({link.telemetry.landed.name})"
