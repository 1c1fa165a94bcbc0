"""A lab on a bus of its own, on loopback."""

import os

from formation.config import LabConfig
from tests.free_ports import free_port
from wire.transport.zenoh_bus import ZenohBus


def a_lab() -> LabConfig:
    """A leader and a follower whose cameras stand a metre ahead of the lab's origin."""
    return LabConfig.model_validate(
        {
            "name": f"mocap-{os.getpid()}",
            "mocap": {"origin_lab_m": (1.0, 0.0, 0.0)},
            "leader": {"body": "lead"},
            "followers": [{"body": "left", "sysid": 2, "offset_m": (0, 1, 0)}],
            "link": {"zenoh_connect": (f"tcp/127.0.0.1:{free_port()}",)},
        }
    )


async def hub_of(config: LabConfig) -> ZenohBus:
    """The bus's listening end, in this process."""
    link = config.link.model_copy(update={"zenoh_listen": config.link.zenoh_connect, "zenoh_connect": ()})
    return await ZenohBus.open(link, config.name)
