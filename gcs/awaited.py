"""What a ground needs before it can arm drones, and what to do when it is missing."""

from typing import Protocol

from formation.config import LabConfig, VehicleBody
from wire.process.daemon import Awaited, bus_at
from wire.transport.zenoh_bus import ZenohBus


class ReceivedInputs(Protocol):
    """What a ground has received so far: the system ids of drones, and whether any frame."""

    received_sysids: set[int]
    has_frame: bool


def awaited_by_ground(config: LabConfig, bus: ZenohBus, ground: ReceivedInputs) -> list[Awaited]:
    """The bus where another listens, frames, and each drone."""
    awaited = []
    if not bus.listens:
        remedy = "nobody is there: start the router, or leave link.zenoh_connect out, and the ground listens itself"
        awaited.append(bus_at(config.link.zenoh_connect, lambda: bus.is_joined, remedy))
    if config.mocap.source != "mavlink":
        remedy = "none has come: `gcs mocap discover` finds camera systems, `gcs doctor` says what is amiss"
        awaited.append(Awaited(f"frames of mocap source {config.mocap.source!r}", lambda: ground.has_frame, remedy))
    return awaited + [_awaited_drone(config.vehicles[i], ground) for i in config.commanded]


def _awaited_drone(vehicle: VehicleBody, ground: ReceivedInputs) -> Awaited:
    sysid = vehicle.sysid or 0
    where = f"at its link {vehicle.link}" if vehicle.link else f"as system {sysid}"
    remedy = f"nothing is heard {where}: is it on, and its bridge (`drone-agent --sysid {sysid} --bridge ...`)?"
    return Awaited(f"drone {vehicle.body}", lambda: sysid in ground.received_sysids, remedy)
