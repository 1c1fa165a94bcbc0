"""Drones that fly under no ground, and grounds beside this one: what forbids to arm, and what an adoption needs."""

from collections.abc import Iterable, Sequence

from formation.safety.rules import Facts
from gcs.drones.checks import objections
from gcs.drones.drone import AIRBORNE_STATES, Drone
from wire.link_messages.status import LandedState

FRESH_S = 0.2
UNLED = "drones are flying under no ground: adopt, land or stop"


def flying(drones: Iterable[Drone]) -> tuple[Drone, ...]:
    """Those that are armed, or say that they are in the air."""
    return tuple(drone for drone in drones if drone.link.armed or drone.link.telemetry.landed in AIRBORNE_STATES)


def arming_refusals(up: Sequence[Drone], others: Sequence[str]) -> tuple[str, ...]:
    """Why this ground must not bring the drones to idle thrust now: some may be flying, or are another ground's."""
    reasons = [f"{drone.link.name}: {_state(drone)}" for drone in up]
    return (*((UNLED,) if up else ()), *reasons, *_other_grounds(others))


def adoption_refusals(
    drones: Sequence[Drone], facts: Facts, others: Sequence[str], seen: bool
) -> tuple[str, ...]:  # fmt: skip
    """Why the drones cannot be led from where they are; `land` and `stop` are possible all the same.

    seen: whether there is an estimate of where they are at all.
    """
    armed = [drone for drone in drones if drone.link.armed]
    if not armed:
        return ("no drone is armed: there is nothing to adopt",)
    blind = [d for d in armed if not seen or facts.age_s[d.index] > FRESH_S]
    reasons = [f"{drone.link.name}: no fresh pose to lead it from: land or stop" for drone in blind]
    reasons += [text for drone in armed for text in objections(drone.link)]
    return (*reasons, *_other_grounds(others))


def joining_refusals(drones: Iterable[Drone], now_ns: int) -> tuple[str, ...]:
    """Who does not follow this ground yet."""
    return tuple(f"{drone.link.name}: does not follow this ground yet" for drone in drones if drone.joining(now_ns))


def coming_down(drone: Drone) -> bool:
    """Whether it is down, or on its way by its autopilot's own landing: there is no turning back from that."""
    link = drone.link
    return not link.armed or link.landing or link.telemetry.landed is LandedState.ON_GROUND


def landing_text(drones: Iterable[Drone]) -> str:
    """Why those to be adopted can only be landed: who is coming down already; empty where all fly."""
    down = [drone.link.name for drone in drones if coming_down(drone)]
    return f"adopted to land: {', '.join(down)} on the floor, or landing already" if down else ""


def other_grounds(drones: Iterable[Drone], told: Iterable[str], now_ns: int) -> tuple[str, ...]:
    """Every sign of another ground that is alive: those on the bus, and drones that answer somebody else."""
    answers = (d.link.name for d in drones if d.link.answers_other_ground(now_ns))
    return (*(f"ground {name}" for name in told), *(f"{name} answers another ground" for name in answers))


def _other_grounds(others: Sequence[str]) -> tuple[str, ...]:
    return (f"another ground is alive ({', '.join(others)}): end it first",) if others else ()


def _state(drone: Drone) -> str:
    link = drone.link
    return f"armed, in {link.mode}" if link.armed else f"in the air, it says ({link.telemetry.landed.name})"
