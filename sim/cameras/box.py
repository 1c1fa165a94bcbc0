"""A camera system in a box: a room of moving bodies, served in a vendor's own protocol, until told to end."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, replace

from formation.messages import RawFrame
from sim.cameras.room import Room
from sim.cameras.servers.server import Server
from wire.clock import Clock

AWAY_S = 1.0
"""How long a server that is restarted is gone."""


@dataclass(frozen=True, slots=True)
class Manner:
    """What the box does now and then, each so many seconds; None: never.

    restart_s: the server ends and is back a second later. rename_s: the last body gets another name, or its own again.
    """

    restart_s: float | None = None
    rename_s: float | None = None


async def serve(
    room: Room, make: Callable[[], Server], manner: Manner, say: Callable[[str], None], clock: Clock
) -> None:
    """Serve the room for ever; OSError where an address is taken."""
    server = make()
    await server.start()
    start_ns = clock.monotonic_ns()
    restarts = 0
    try:
        while True:
            await asyncio.sleep(0.0)  # also where the time has passed: clients are to be let in
            await clock.sleep_until_ns(room.next_ns)
            now_ns = clock.monotonic_ns()
            past_s = (now_ns - start_ns) * 1e-9
            if manner.restart_s is not None and past_s >= (restarts + 1) * manner.restart_s:
                restarts += 1
                say("the server goes")
                await server.close()
                await clock.sleep_until_ns(now_ns + round(AWAY_S * 1e9))
                room.frames(clock.monotonic_ns())  # what nobody served is gone
                server = make()
                await server.start()
                say("the server is back")
            for frame in room.frames(clock.monotonic_ns()):
                server.publish(_renamed(frame, past_s, manner))
    finally:
        await server.close()


def _renamed(frame: RawFrame, past_s: float, manner: Manner) -> RawFrame:
    if manner.rename_s is None or int(past_s / manner.rename_s) % 2 == 0:
        return frame
    return replace(frame, bodies=(*frame.bodies[:-1], f"{frame.bodies[-1]}-renamed"))
