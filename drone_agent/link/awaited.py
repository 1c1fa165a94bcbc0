"""What a drone's process waits for, agent and bridge alike, and what to do where it does not come."""

from collections.abc import Callable

from drone_agent.config import AgentConfig
from wire.process.awaited import Awaited, bus_at
from wire.transport.zenoh_bus import ZenohBus


def awaited_bus(config: AgentConfig, bus: ZenohBus) -> Awaited:
    """The lab's ground, mocap or router."""
    remedy = (
        "nobody is there: start the ground (`gcs run lab.toml`), or say where it is with --zenoh-connect tcp/HOST:7447"
    )
    return bus_at(config.link.zenoh_connect, lambda: bus.is_joined, remedy)


def awaited_pose(config: AgentConfig, has_pose: Callable[[], bool]) -> Awaited:
    """Frames in which the mocap sees this drone's body."""
    remedy = (
        f"no frame of lab {config.lab!r} shows it: --lab and --body are names of the lab file, and "
        "`gcs mocap lab.toml` shows what the cameras see"
    )
    return Awaited(f"the mocap's pose of {config.body_name!r}", has_pose, remedy)
