"""A spare: another drone, of a system id of its own, that takes a body's place on the ground for what flies next. Pure.

It is listened for first, and takes the place once it has beaten. All that was learnt of the drone before it goes.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace

from formation.config import VehicleBody
from formation.messages import OperatorRequest
from formation.reasons import Reason, Reject
from formation.requests import SYSID_MOST
from formation.safety.rules_table import HEARTBEAT_S
from gcs.drones.drone import Drone
from gcs.drones.link_state import DroneLink
from gcs.permissions import Situation, nobody_flies

LISTEN_NS = round(HEARTBEAT_S * 1e9)


def asked_of(request: OperatorRequest) -> tuple[str, int]:
    """The body and the system id that a request names; 0 for what is no system id."""
    number, _, body = request.argument.partition(" ")
    sysid = int(number) if number.isascii() and number.isdigit() and len(number) < 4 else 0
    return body, sysid if sysid <= SYSID_MOST else 0


@dataclass(frozen=True, slots=True)
class Spare:
    """One that is listened for since asked_ns: whose place it is to take, its own link, and the request's id."""

    request: int
    drone: Drone
    link: DroneLink
    asked_ns: int

    def is_due(self, now_ns: int) -> bool:
        """Whether it has beaten, or was listened for long enough."""
        return self.link.telemetry.heartbeat is not None or now_ns - self.asked_ns >= LISTEN_NS

    @property
    def words(self) -> str:
        """What was done, and what would make it last."""
        sysid, name = self.link.sysid, self.link.name
        return f"{name} is system {sysid} until this ground ends: to keep it, write sysid = {sysid} into the lab file"

    def reject_reasons(self, now: Situation) -> tuple[Reject, ...]:
        """Why it may not take the place after all."""
        if self.link.telemetry.heartbeat is None:
            return (Reason.SPARE_UNHEARD.of(self.link.sysid, self.drone.link.name),)
        armed = (Reason.SPARE_ARMED.of(self.link.sysid),) if self.link.armed else ()
        return (*armed, *_flying(now, self.drone))


def reject_reasons(request: OperatorRequest, now: Situation, listened: Collection[int]) -> tuple[Reject, ...]:
    """Every reason for which no spare is even listened for. listened: the system ids that the ground listens to."""
    body, sysid = asked_of(request)
    drone = now.flight.drone(body)
    if drone is None:
        return (Reason.NO_DRONE.of(body, ", ".join(drone.link.name for drone in now.drones)),)
    if not sysid:
        return (Reason.NO_SYSID.of(request.argument.partition(" ")[0]),)
    owner = next((drone.link.name for drone in now.drones if drone.link.sysid == sysid), None)
    if owner is not None:
        return (Reason.SYSID_IN_USE.of(sysid, owner),)
    if sysid in listened:
        return (Reason.SPARE_AWAITED.of(),)
    return (*_of_lab(now, now.config.vehicles[drone.index], sysid), *_flying(now, drone))


def _of_lab(now: Situation, vehicle: VehicleBody, sysid: int) -> Iterator[Reject]:
    if vehicle.link is not None:
        yield Reason.OWN_LINK.of(vehicle.body, vehicle.link)
    if now.config.security is not None:
        yield Reason.KEYS_BY_SYSID.of(sysid)


def _flying(now: Situation, drone: Drone) -> Iterator[Reject]:
    """Nobody flies; what the one whose place is taken said counts no more once it is silent: switched off."""
    is_silent = drone.link.ages(now.now_ns).heartbeat_s > HEARTBEAT_S
    return nobody_flies(replace(now, drones=tuple(d for d in now.drones if not (is_silent and d is drone))))
