"""How the processes of a lab reach each other, as the lab file says it."""

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from formation.model import Endpoint, Host, Model, NoFlag, PortBase
from formation.requests import ENDPOINT


class LinkConfig(Model):
    """How drones are reached: one Zenoh bus, or one UDP socket a drone (base ports plus sysid).

    imu_rate_hz: of HIGHRES_IMU, by which a push is known before it moves the drone; 0: not asked for.
    """

    kind: Literal["zenoh", "udp"] = "zenoh"
    """Transport of MAVLink for drones without a `link` of their own."""
    host: Host = "127.0.0.1"
    """Host of the drones on UDP."""
    ground_port_base: PortBase = 14540
    """UDP port of the ground for a drone: base plus sysid."""
    drone_port_base: PortBase = 14580
    """UDP port of a drone: base plus sysid."""
    zenoh_listen: tuple[Endpoint, ...] = ()
    """Endpoints at which the ground listens on the bus."""
    zenoh_connect: tuple[Endpoint, ...] = (ENDPOINT,)
    """Endpoints of the bus to which every program connects; where only `zenoh_listen` is given, that."""
    imu_rate_hz: Annotated[float, NoFlag, Field(ge=0.0, le=250.0)] = 0.0

    @model_validator(mode="before")
    @classmethod
    def _connect_where_it_listens(cls, values: Any) -> Any:
        alone = isinstance(values, dict) and values.get("zenoh_listen") and "zenoh_connect" not in values
        return {**values, "zenoh_connect": ()} if alone else values

    @property
    def joined(self) -> "LinkConfig":
        """The same bus for a process that does not listen at the lab's own endpoint: where the ground does, join it."""
        return self.model_copy(update={"zenoh_listen": (), "zenoh_connect": self.zenoh_connect or self.zenoh_listen})

    @property
    def listening(self) -> "LinkConfig":
        """The same bus for the process that listens where the others connect."""
        return self.model_copy(update={"zenoh_listen": self.zenoh_connect, "zenoh_connect": ()})

    @property
    def names_bus(self) -> bool:
        """Whether the lab file says where the bus is; where it does not, the ground itself listens."""
        return not self.model_fields_set.isdisjoint({"zenoh_listen", "zenoh_connect"})
