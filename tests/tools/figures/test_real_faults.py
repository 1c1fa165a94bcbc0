"""One flight each of what `real_faults.py` flies in numbers (the ground's kill: tests/end_to_end), and the relay."""

import asyncio
import socket
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from formation.config import LinkConfig
from sim.faults.fault import Family, Fault
from tests.free_ports import free_port
from tools.figures.real_cases import CASES, POOR_LINK
from tools.figures.real_faults import SPEED, setting_of
from tools.figures.real_flight import LinkKind, room
from tools.figures.udp_relay import relay
from wire.clock import REAL_TIME, Clock

LOW_M = 0.5


@pytest.mark.nightly
@pytest.mark.processes
@pytest.mark.flights
@pytest.mark.timeout(900)
@pytest.mark.parametrize(("name", "link"), [("bridge-killed", "udp"), ("poor-link", "udp")])
def test_real_processes_are_harmed_and_nobody_is_hurt(name: str, link: LinkKind, tmp_path: Path) -> None:
    async def flown() -> tuple[str, ...]:
        with setting_of(CASES[name], link, Clock(SPEED), tmp_path, LOW_M) as setting:
            async with room(setting, tmp_path, 1) as here:
                return (await CASES[name].fly(here, np.random.default_rng(3))).reasons

    assert asyncio.run(flown()) == ()


async def relayed(faults: Sequence[Fault], count: int) -> list[int]:
    """Which of so many datagrams reach the drone, in order; the last is a farewell that is not lost."""
    ground, theirs = (LinkConfig(ground_port_base=free_port(), drone_port_base=free_port()) for _ in range(2))
    loop = asyncio.get_running_loop()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as drone,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        relay(ground, theirs, (0,), 7, REAL_TIME) as between,
    ):
        drone.setblocking(False)
        drone.bind((ground.host, theirs.drone_port_base))
        got: list[int] = []
        between.meet(faults, ())
        for number in range(count + 1):
            if number == count:
                between.meet([Fault(family=Family.DELAY, severity=0.3)], ())
            sender.sendto(number.to_bytes(2, "big"), (ground.host, ground.drone_port_base))
            await asyncio.sleep(0)
        while count not in got:
            got.append(int.from_bytes(await loop.sock_recv(drone, 16), "big"))
    return got[:-1]


def test_the_relay_passes_all_on_in_order_where_nothing_is_wrong() -> None:
    assert asyncio.run(relayed((), 50)) == list(range(50))


def test_the_relay_loses_repeats_and_reorders_by_its_seed() -> None:
    got = asyncio.run(relayed(POOR_LINK, 100))
    assert 70 < len(set(got)) < 90
    assert len(set(got)) < len(got) < 100
    assert got != sorted(got)
    again = asyncio.run(relayed([Fault(family=Family.DROP, severity=0.2)], 100))
    assert set(asyncio.run(relayed([Fault(family=Family.DROP, severity=0.2)], 100))) == set(again)
