"""A real MAVSDK client for the tests: its plugins, and bounded waits on its subscriptions."""

import contextlib
import queue
import time
from collections.abc import Callable, Iterator
from typing import Any

from mavsdk import ComponentType, Configuration, Mavsdk, System
from mavsdk.plugins.action.action import Action
from mavsdk.plugins.info.info import Info
from mavsdk.plugins.mavlink_direct.mavlink_direct import MavlinkDirect
from mavsdk.plugins.mocap.mocap import Mocap
from mavsdk.plugins.offboard.offboard import Offboard
from mavsdk.plugins.param.param import Param
from mavsdk.plugins.telemetry.telemetry import Telemetry

from tests.conformance.agent import START_S, Agent

WAIT_S = 30.0


class Client:
    """MAVSDK's plugins for one drone."""

    def __init__(self, system: System) -> None:
        self.action = Action(system)
        self.direct = MavlinkDirect(system)
        self.info = Info(system)
        self.mocap = Mocap(system)
        self.offboard = Offboard(system)
        self.param = Param(system)
        self.telemetry = Telemetry(system)

    def first(self, name: str, wanted: Callable[[Any], bool] = lambda value: True, wait_s: float = WAIT_S) -> Any:
        """The first telemetry `name` from now on that is `wanted`; fails after `wait_s` with the last one."""
        with self.stream(name) as values:
            end = time.monotonic() + wait_s
            last = None
            while (left_s := end - time.monotonic()) > 0.0:
                try:
                    last = values.get(timeout=left_s)
                except queue.Empty:
                    break
                if wanted(last):
                    return last
        raise AssertionError(f"no {name} as wanted in {wait_s} s; the last was {last}")

    @contextlib.contextmanager
    def stream(self, name: str) -> Iterator["queue.Queue[Any]"]:
        """Everything telemetry says under `name` while the block lasts."""
        values: queue.Queue[Any] = queue.Queue()
        handle = getattr(self.telemetry, f"subscribe_{name}")(lambda value, _: values.put(value))
        try:
            yield values
        finally:
            getattr(self.telemetry, f"unsubscribe_{name}")(handle)

    def be_ready(self) -> None:
        self.first("health", lambda health: health.is_armable and health.is_local_position_ok)


def wait_for_text(texts: "queue.Queue[Any]", part: str, wait_s: float = WAIT_S) -> None:
    """Wait until a status text holds `part`, whatever else the drone says before; fails after `wait_s`."""
    end, seen = time.monotonic() + wait_s, list[str]()
    while not seen or part not in seen[-1]:
        try:
            seen.append(texts.get(timeout=max(0.0, end - time.monotonic())).text)
        except queue.Empty:
            raise AssertionError(f"no {part!r} in {wait_s} s, only {seen}") from None


@contextlib.contextmanager
def client(agent: Agent) -> Iterator[Client]:
    """MAVSDK connected to the agent."""
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    try:
        mavsdk.add_any_connection(agent.mavsdk_url)
        system = mavsdk.first_autopilot(START_S)
        assert system is not None, "MAVSDK found no autopilot"
        yield Client(system)
    finally:
        mavsdk.destroy()
