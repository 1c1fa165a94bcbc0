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

    @property
    def words(self) -> str:
        """Who that is, for people."""
        return f"{'the ground' if self.system == GROUND_SYSTEM else 'system'}, {self}"


GROUND_COMPONENTS = range(25, 100)  # MAV_COMP_ID_USER1 to USER75
GROUND = Address(GROUND_SYSTEM, GROUND_COMPONENT)
EVERYONE = Address(BROADCAST, BROADCAST)


def ground_address(session: int) -> Address:
    """The ground's address in that ground session, the same on every link; a restarted ground has another."""
    return Address(GROUND_SYSTEM, GROUND_COMPONENTS[session % len(GROUND_COMPONENTS)])
