"""Kill -9 of the ground in flight: the agents are the last line, and the log is there."""

import asyncio
import os
import signal
from collections.abc import Callable, Coroutine
from pathlib import Path

import numpy as np
import pytest

from formation import topics
from formation.maths import frames
from formation.maths.arrays import Float
from formation.messages import Truth
from sim.fly import Files, operate, running
from sim.ports import private_link
from sim.processes import ProcessGroup
from sim.scenario import Scenario, load
from sim.script import Operator
from tests.end_to_end.flights import CIRCLE, SPEED, write_scenario
from tests.wire.flight import check_log
from wire.clock import Clock
from wire.files import recorded
from wire.logs.mcap_read import read_log

pytestmark = [pytest.mark.processes, pytest.mark.flights, pytest.mark.timeout(900)]

SYSIDS = (1, 2, 3)
FAST_M_S, LEANING_RAD = 0.5, np.radians(4.0)
"""The circle asks for 0.63 m/s and 4.6 degrees."""


class Watched:
    """The true states of all drones as they come, and a way to wait for something among them."""

    def __init__(self) -> None:
        self.truths: dict[int, list[Truth]] = {sysid: [] for sysid in SYSIDS}
        self._airborne_ns = dict.fromkeys(SYSIDS, 0)
        self._wanted: Callable[[], bool] = lambda: False
        self._happened = asyncio.Event()

    def take(self, truth: Truth) -> None:
        self.truths[truth.sysid].append(truth)
        if not truth.on_ground:
            self._airborne_ns[truth.sysid] = truth.t_ns
        if self._wanted():
            self._happened.set()

    async def wait_for(self, wanted: Callable[[], bool]) -> None:
        self._wanted = wanted
        self._happened.clear()
        await self._happened.wait()

    def all_fast_and_leaning(self) -> bool:
        return all(
            seen and np.linalg.norm(seen[-1].vel_lab_m_s) > FAST_M_S and tilt_rad(seen[-1]) > LEANING_RAD
            for seen in self.truths.values()
        )

    def all_landed_since(self, t_ns: int) -> bool:
        """Every drone has been on the floor for the last second, and after t_ns."""
        return all(
            self.truths[sysid][-1].t_ns > max(airborne_ns, t_ns) + 1_000_000_000
            for sysid, airborne_ns in self._airborne_ns.items()
        )


async def fly_and_kill(scenario: Scenario, files: Files) -> tuple[Watched, int]:
    """Fly the circle, kill the ground in full flight, wait until all are down; when it was killed."""
    watched, clock = Watched(), Clock(SPEED)
    operator = Operator(scenario.script[:3])
    async with running(scenario, 1, files, clock=clock, hosts=1) as flight:
        flight.bus.on_truth(watched.take)
        script = asyncio.create_task(operate(flight.bus, operator, 120.0, lambda _t_s, _phase: None, clock))
        await in_flight(watched.wait_for(watched.all_fast_and_leaning), flight.group)
        killed_ns = clock.monotonic_ns()
        os.kill(flight.ground.process.pid, signal.SIGKILL)
        script.cancel()
        await watched.wait_for(lambda: watched.all_landed_since(killed_ns))
    return watched, killed_ns


async def in_flight(event: Coroutine[None, None, None], group: ProcessGroup) -> None:
    """Wait for the event; ProcessDied where a process ends first."""
    waiting, watching = asyncio.create_task(event), asyncio.create_task(group.watch())
    try:
        await asyncio.wait((waiting, watching), return_when=asyncio.FIRST_COMPLETED)
        if watching.done():
            watching.result()
    finally:
        waiting.cancel()
        watching.cancel()


def tilt_rad(truth: Truth) -> float:
    up: Float = frames.rotate(truth.q_lab_from_flu, np.array([0.0, 0.0, 1.0]))
    return float(np.arccos(min(up[2], 1.0)))


def test_every_drone_stops_and_lands_by_itself_and_the_log_is_whole_to_the_last_moment(tmp_path: Path) -> None:
    scenario = load(str(write_scenario(tmp_path, CIRCLE)))
    files = Files(tmp_path)
    with private_link("zenoh", SYSIDS) as own_link:
        lab = scenario.lab.model_copy(update={"link": own_link})
        watched, killed_ns = asyncio.run(fly_and_kill(scenario.model_copy(update={"lab": lab}), files))

    entries = list(read_log(recorded(files.mcap)).entries)
    assert not check_log(recorded(files.mcap)).complete
    # 50 ms on a machine with a core to spare; the bound leaves room for a busy one.
    assert 0 <= killed_ns - entries[-1].t_ns < 1_000_000_000
    for sysid in SYSIDS:
        last_ns = max(e.t_ns for e in entries if e.topic is topics.LINK_DOWN and e.message.sysid == sysid)
        seen = watched.truths[sysid]
        at_kill = min(seen, key=lambda truth: abs(truth.t_ns - last_ns))
        # 1 s is what the guard keeps by its own time (tests/drone_agent/test_refusals.py).
        after = [truth for truth in seen if 0 <= truth.t_ns - last_ns < 2_000_000_000]
        assert tilt_rad(at_kill) > np.radians(3.0)
        assert min(np.linalg.norm(truth.vel_lab_m_s[:2]) for truth in after) < 0.15
        moved_m = np.linalg.norm(seen[-1].pos_lab_m[:2] - at_kill.pos_lab_m[:2])
        assert moved_m < 0.6
        assert seen[-1].t_ns - last_ns < 30_000_000_000
