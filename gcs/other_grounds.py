"""Which other grounds are alive on the lab's bus, by liveliness tokens."""

import os
from typing import Protocol

import zenoh

from wire.transport.zenoh_bus import ZenohBus


class Knows(Protocol):
    """A ground that is informed of other grounds."""

    other_grounds: tuple[str, ...]


def know_other_grounds(bus: ZenohBus, name: str, session: int, ground: Knows) -> None:
    """Be known on the lab's bus as a ground that is alive, and know of the others."""
    own = f"{name}/{session}-{os.getpid()}"
    alive: set[str] = set()

    def on_token(sample: zenoh.Sample) -> None:
        other = str(sample.key_expr).removeprefix(f"{bus.lab}/ground/")
        if sample.kind == zenoh.SampleKind.DELETE:
            alive.discard(other)
        elif other != own:
            alive.add(other)
        ground.other_grounds = tuple(sorted(alive))

    bus.declare_token(f"ground/{own}")
    bus.watch_tokens("ground/**", on_token)
