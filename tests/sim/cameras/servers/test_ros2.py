"""Our source of ROS 2 poses and a graph in a box, over real sockets: each kind of topic; a router that comes again."""

import asyncio
from collections.abc import Callable
from contextlib import suppress

import numpy as np
import pytest

from formation.config import LabConfig
from formation.messages import RawFrame
from mocap.sources.registry import open_source
from sim.cameras.systems import server_for
from tests.free_ports import free_port
from tests.mocap.sources.recorded_feed import Kept
from wire.clock import REAL_TIME, Clock

NAMES = ("leader", "left")
POS_M = np.array([[1.0, 2.0, 0.5], [-1.0, 0.25, 1.5]])
HALF = 0.5**0.5
Q = np.array([[1.0, 0.0, 0.0, 0.0], [HALF, 0.0, 0.0, HALF]])
AGE_NS = 5_000_000


def lab(port: int, **ros2: str) -> LabConfig:
    return LabConfig.model_validate(
        {
            "mocap": {"source": "ros2", "ros2": {"port": port, **ros2}},
            "leader": {"body": "leader"},
            "followers": [{"body": "left", "sysid": 2, "offset_m": (0.0, 1.0, 0.0)}],
        }
    )


class Graph(Kept):
    """A server, and our source of it."""

    def __init__(self, config: LabConfig, clock: Clock = REAL_TIME) -> None:
        super().__init__(config.mocap, clock)
        self.server = server_for(config.mocap, NAMES, clock)
        self.source = open_source(config, None, self.feed())
        self._number = 0

    async def publish_until(self, is_done: Callable[[], bool]) -> None:
        async with asyncio.timeout(60.0):
            while not is_done():
                self._number += 1
                exposed_ns = self.clock.monotonic_ns() - AGE_NS
                noise = 1e-5 * np.sin(self._number)  # a pose that repeats to the last bit is that of a lost body
                self.server.publish(RawFrame(self._number, exposed_ns, NAMES, POS_M + noise, Q, np.array([True, True])))
                await asyncio.sleep(0.01)

    def said(self, words: str) -> int:
        """How many events had these words."""
        return sum(words in text for text in self.texts())

    def whole(self) -> list[RawFrame]:
        return [frame for frame in self.frames if frame.bodies and set(frame.bodies) == set(NAMES) and frame.seen.all()]


async def flown(graph: Graph, restarts: int) -> None:
    running = asyncio.create_task(graph.source.run())
    for times in range(1, 2 + restarts):
        await graph.server.start()
        before = len(graph.whole())
        await graph.publish_until(
            lambda before=before, times=times: len(graph.whole()) >= before + 20 and graph.said("connected to") == times
        )
        assert graph.source.status().connected
        await graph.server.close()
        async with asyncio.timeout(30.0):
            while graph.source.status().connected or graph.said("start rmw_zenohd") < times:
                await asyncio.sleep(0.05)
    running.cancel()
    with suppress(asyncio.CancelledError):
        await running


@pytest.mark.parametrize("ros2", [{}, {"topic": "/poses"}, {"domain": 9}], ids=["a topic each", "an array", "domain 9"])
def test_poses_arrive_as_they_were_published(ros2) -> None:
    graph = Graph(lab(free_port(), **ros2))
    asyncio.run(flown(graph, restarts=0))
    for frame in graph.whole():
        rows = [frame.bodies.index(name) for name in NAMES]
        np.testing.assert_allclose(frame.pos_mocap_m[rows], POS_M, atol=2e-5)
        np.testing.assert_allclose(frame.q_mocap_from_marker[rows], Q, atol=1e-12)
    assert all("later than the rest" in text for text in graph.refused())  # of a machine under load
    assert graph.said("the server names") == 1


def test_a_slowed_clock_is_that_of_the_capture_times() -> None:
    slow = Clock(0.25)
    graph = Graph(lab(free_port()), slow)
    begun_ns = slow.monotonic_ns()
    asyncio.run(flown(graph, restarts=0))
    captures_ns = [frame.t_capture_ns for frame in graph.whole()]
    assert begun_ns < min(captures_ns)
    assert max(captures_ns) < slow.monotonic_ns()
    assert captures_ns == sorted(captures_ns)


def test_a_router_that_goes_and_comes_again_is_found_again() -> None:
    graph = Graph(lab(free_port()))
    asyncio.run(flown(graph, restarts=1))
    seqs = [frame.seq for frame in graph.frames]
    assert seqs == sorted(set(seqs))
    assert graph.said("connected to") == 2
