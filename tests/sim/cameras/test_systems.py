"""Labs whose poses come by a camera system's protocol from this machine."""

import asyncio

import pytest

from formation.config import LabConfig
from formation.mocap_config import CAMERA_SYSTEMS
from mocap.sources.natnet.session import open_sockets
from sim.cameras.systems import OTHER_LOOPBACK, SOURCE_OF, lab_with, server_for
from sim.ports import private_link
from wire.clock import REAL_TIME


def lab(**mocap: object) -> LabConfig:
    followers = [{"body": "left", "sysid": 2, "offset_m": (0.0, 1.0, 0.0)}]
    return LabConfig.model_validate({"leader": {"body": "lead"}, "followers": followers, "mocap": mocap})


def test_every_camera_system_can_be_served() -> None:
    assert set(SOURCE_OF.values()) == set(CAMERA_SYSTEMS)
    for protocol, source in SOURCE_OF.items():
        config = lab_with(lab(rate_hz=50.0, axes=["x right", "y up", "z back"]), protocol)
        assert (config.mocap.source, config.mocap.rate_hz) == (source, 50.0)
        assert config.mocap.axes is not None
        assert server_for(config.mocap, ("lead", "left"), REAL_TIME) is not None


@pytest.mark.parametrize("first", ["client", "server"])
def test_natnets_two_ends_find_their_ports_whoever_starts_first(first: str) -> None:
    """One that had port 1511 of every address kept the other from starting."""

    async def both() -> None:
        server = server_for(config.mocap, ("lead", "left"), REAL_TIME)
        if first == "server":
            await server.start()
        with open_sockets(natnet, OTHER_LOOPBACK, print) as sockets:
            assert len(sockets) == 2
            if first == "client":
                await server.start()
        await server.close()

    with private_link("zenoh", ()) as link:
        config = lab_with(lab().model_copy(update={"link": link}), "natnet")
        natnet = config.mocap.natnet
        assert natnet is not None
        asyncio.run(both())
