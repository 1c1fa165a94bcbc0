"""Calls of our own Python functions: what a lockstep flight and a tick of the ground cost, whatever the load."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Self

from formation import topics
from formation.config import LabConfig
from gcs.core import GcsCore
from gcs.recording import INPUT_TOPICS
from sim.scenario import Scenario
from sim.world import T0_NS, World
from wire.logs.mcap_read import Entry

OURS = tuple(
    f"{Path(__file__).parents[1] / name}/"
    for name in ("formation", "wire", "mocap", "gcs", "drone_agent", "sim", "bench")
)
"""The folders of our packages."""
_COUNTING = frozenset({"__exit__", "_feed"})


@dataclass(frozen=True, slots=True)
class TickCalls:
    """Means over some ticks: calls of `GcsCore.tick`, and of `GcsCore.receive` between two of them."""

    tick: float
    receive: float


def tick_calls(lab: LabConfig, entries: Sequence[Entry], count: int) -> TickCalls:
    """Of the ground's last `count` ticks, in a replay of a lockstep flight."""
    ticks = [k for k, entry in enumerate(entries) if entry.topic is topics.TICK]
    begin = ticks[-count - 1] + 1
    core = GcsCore(lab, T0_NS)
    _feed(core, entries[:begin])
    received, ticked = Calls(), Calls()
    for entry in entries[begin : ticks[-1] + 1]:
        with ticked if entry.topic is topics.TICK else received:
            _feed(core, (entry,))
    return TickCalls(ticked.count / count, received.count / count)


def _feed(core: GcsCore, entries: Sequence[Entry]) -> None:
    for entry in entries:
        if entry.topic in INPUT_TOPICS:
            core.receive(entry.message, entry.t_ns)
        elif entry.topic is topics.TICK:
            core.tick(entry.message.now_ns)


def python_calls(scenario: Scenario) -> int:
    """Calls of Python functions of our own in the last second of the scenario's longest flight, in lockstep."""
    world = World(scenario, scenario.seed, lambda _topic, _message, _t_ns: None)
    end_ns = T0_NS + round(scenario.longest_s * 1e9)
    while world.now_ns < end_ns - 1_000_000_000:
        world.step()
    with Calls() as calls:
        while world.now_ns < end_ns:
            world.step()
    return calls.count


class Calls:
    """Counts the calls of Python functions of our own while it is entered."""

    def __init__(self) -> None:
        self.count = 0

    def __enter__(self) -> Self:
        sys.setprofile(self._note)
        return self

    def __exit__(self, *_: object) -> None:
        sys.setprofile(None)

    def _note(self, frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        self.count += event == "call" and code.co_filename.startswith(OURS) and code.co_name not in _COUNTING
