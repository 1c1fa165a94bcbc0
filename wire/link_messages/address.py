"""Who speaks and who is spoken to on a MAVLink link."""

from typing import NamedTuple

BROADCAST = 0
GROUND_SYSTEM, GROUND_COMPONENT = 255, 190
DRONE_COMPONENT = 1
BRIDGE_COMPONENT = 191  # MAV_COMP_ID_ONBOARD_COMPUTER


class Address(NamedTuple):
    """A MAVLink system and component."""

    system: int
    component: int


GROUND = Address(GROUND_SYSTEM, GROUND_COMPONENT)
EVERYONE = Address(BROADCAST, BROADCAST)
