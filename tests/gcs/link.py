"""A drone's link with somebody at its other end who says what a test wants said."""

from formation.config import VehicleBody
from formation.vehicle.profile import profile
from gcs.drones.link_state import DroneLink
from wire.link_messages import Address, Heartbeat, LinkMessage, MavAutopilot, ParamType, ParamValue
from wire.mavlink.codec import Codec, param_to_raw

MS = 1_000_000
PAPER = profile("paper_40g")


class Drone:
    """The other end of a link, said what to say."""

    def __init__(self, sysid: int = 3, component: int = 1) -> None:
        self.codec = Codec(Address(sysid, component))

    def say(self, link: DroneLink, message: LinkMessage, now_ns: int = 0) -> None:
        link.receive(self.codec.encode(message), now_ns)


def a_link(name: str = "paper_40g") -> DroneLink:
    return DroneLink(VehicleBody(body="left", sysid=3), 3, profile(name))


def beat(autopilot: MavAutopilot = MavAutopilot.PX4, armed: bool = False, mode: int = 0) -> Heartbeat:
    return Heartbeat(autopilot, 2, 1 | (128 if armed else 0), mode, 3)


def tell(link: DroneLink, values: dict[str, float], autopilot: MavAutopilot) -> None:
    """Answer for these parameters, asked for once more."""
    drone = Drone()
    link.parameters.ask(values)
    for name, value in values.items():
        kind = ParamType.INT32 if isinstance(value, int) else ParamType.REAL32
        drone.say(link, ParamValue(name, param_to_raw(value, kind, autopilot), kind, 9, 0))
