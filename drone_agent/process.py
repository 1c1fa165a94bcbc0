"""Code that the processes of simulated drone and bridge share: timer, the ground's link, keys, what is awaited."""

import asyncio
from collections.abc import Callable

from drone_agent.guard.config import GuardConfig
from formation.exposure import drone_identity
from wire.clock import REAL_TIME, Clock
from wire.errors import ConfigError
from wire.process.daemon import Precondition, bus_at
from wire.rejections import RejectionLog
from wire.security.bus_access import BusAccess, ExposedError
from wire.security.private_keys import mavlink_key_file
from wire.security.protection import Protection, protection_of
from wire.transport.link import Deliver, Link
from wire.transport.udp_bus import open_udp_drone
from wire.transport.zenoh_bus import ZenohBus


class DeadlineTimer:
    """Calls `turn` at a deadline; a new deadline takes the old one's place."""

    def __init__(self, turn: Callable[[], None], clock: Clock = REAL_TIME) -> None:
        self._turn = turn
        self._clock = clock
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None

    def at(self, deadline_ns: int) -> None:
        """Fire then, or at once where that is past."""
        self.stop()
        self._timer = self._loop.call_later(self._clock.seconds_until(deadline_ns), self._turn)

    def stop(self) -> None:
        """Cancel the timer."""
        if self._timer is not None:
            self._timer.cancel()


def drone_protection(config: GuardConfig) -> Protection:
    """The protection of this drone's links. ConfigError for keys that are missing or open to others."""
    if config.keys is None:
        return Protection(BusAccess(insecure=config.insecure))
    identity = drone_identity(config.sysid)
    found = protection_of(config.keys, identity)
    if found.channel(config.sysid) is None:
        key = config.keys / identity / mavlink_key_file(config.sysid)
        raise ConfigError([f"{key}: no signing key: `gcs keys rotate {identity}`, then pack and install it"])
    return found


async def open_ground_link(
    config: GuardConfig, bus: ZenohBus | None, deliver: Deliver, rejections: RejectionLog, protection: Protection
) -> Link:
    """By the bus where the configuration says so, else by UDP; OSError names the host and the port."""
    if config.link.kind == "zenoh" and bus is not None:
        return bus.drone_link(config.sysid, deliver)
    try:
        return await open_udp_drone(config.link, config.sysid, deliver, rejections, protection)
    except ExposedError:
        raise
    except OSError as error:
        port = config.link.drone_port_base + config.sysid
        raise OSError(f"link to {config.link.host}, own port {port}: {error.strerror or error}") from error


def awaited_bus(config: GuardConfig, bus: ZenohBus) -> Precondition:
    """The lab's ground, mocap or router."""
    remedy = "nobody is there: start the ground (`gcs run lab.toml`), or say where it is by the key link.zenoh_connect"
    return bus_at(config.link.zenoh_connect, lambda: bus.is_joined, remedy)


def awaited_pose(config: GuardConfig, has_pose: Callable[[], bool]) -> Precondition:
    """Frames in which the mocap sees this drone's body."""
    remedy = (
        f"no frame of lab {config.lab!r} shows it: --lab and --body are names of the lab file, and "
        "`gcs mocap lab.toml` shows what the cameras see"
    )
    return Precondition(f"the mocap's pose of {config.body_name!r}", has_pose, remedy)
