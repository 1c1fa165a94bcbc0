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

    def __str__(self) -> str:
        return f"{self.system}/{self.component}"


GROUND = Address(GROUND_SYSTEM, GROUND_COMPONENT)
EVERYONE = Address(BROADCAST, BROADCAST)
_USER_COMPONENT, _USERS = 25, 75  # MAV_COMP_ID_USER1 and how many there are


def ground_address(epoch: int | None = None) -> Address:
    """The ground of that epoch, so that a drone tells one from the next; without one, any ground station's."""
    return GROUND if epoch is None else Address(GROUND_SYSTEM, _USER_COMPONENT + epoch % _USERS)
