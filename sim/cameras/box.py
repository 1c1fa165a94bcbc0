"""An emulated camera system: serves a scene of moving bodies in a vendor's own protocol, until it is stopped."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, replace

from formation.messages import RawFrame
from sim.cameras.scene import Scene
from sim.cameras.servers.server import Server
from wire.clock import Clock

AWAY_S = 1.0
"""How long a restarted server is away, s."""


@dataclass(frozen=True, slots=True)
class Interruptions:
    """Interruptions of the emulated server, each with its period in s; None: never.

    restart_s: the server stops for a second. rename_s: the last body gets another name, or its own again.
    """

    restart_s: float | None = None
    rename_s: float | None = None


async def serve(
    scene: Scene, make: Callable[[], Server], interruptions: Interruptions, report: Callable[[str], None], clock: Clock
) -> None:
    """Serve the scene for ever; OSError where an address is taken."""
    server = make()
    await server.start()
    start_ns = clock.monotonic_ns()
    restarts = 0
    try:
        while True:
            await asyncio.sleep(0.0)  # also where the time has passed: clients are to be let in
            await clock.sleep_until_ns(scene.next_ns)
            now_ns = clock.monotonic_ns()
            past_s = (now_ns - start_ns) * 1e-9
            if interruptions.restart_s is not None and past_s >= (restarts + 1) * interruptions.restart_s:
                restarts += 1
                report("the server goes")
                await server.close()
                await clock.sleep_until_ns(now_ns + round(AWAY_S * 1e9))
                scene.frames(clock.monotonic_ns())  # the frames of that time are lost
                server = make()
                await server.start()
                report("the server is back")
            for frame in scene.frames(clock.monotonic_ns()):
                server.publish(_renamed(frame, past_s, interruptions))
    finally:
        await server.close()


def _renamed(frame: RawFrame, past_s: float, interruptions: Interruptions) -> RawFrame:
    if interruptions.rename_s is None or int(past_s / interruptions.rename_s) % 2 == 0:
        return frame
    return replace(frame, bodies=(*frame.bodies[:-1], f"{frame.bodies[-1]}-renamed"))
