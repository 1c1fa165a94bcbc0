"""One flight each of what `real_faults.py` flies in numbers (the ground's kill: tests/end_to_end)."""

import asyncio
from pathlib import Path

import numpy as np
import pytest

from tools.figures.real_cases import CASES
from tools.figures.real_faults import SPEED, setting_of
from tools.figures.real_flight import LinkKind, room
from wire.clock import Clock

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
