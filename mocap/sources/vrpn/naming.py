"""Which of the lab's bodies a sender and its sensor are: a tracker each in VRPN, a sensor each at Chingmu."""

from collections.abc import Callable, Collection
from itertools import count
from typing import Protocol

from formation.mocap_config import ChingmuConfig
from wire.text import plain

NAMES_MAX = 8
LONGEST_NAME = 64


class Naming(Protocol):
    """One kind of server's."""

    def body(self, sender: str, sensor: int) -> str | None:
        """The body whose poses these are; None where they are no body's."""

    def lack(self, senders: Collection[str], bodies: Collection[str]) -> str:
        """Which of the lab's bodies are missing, in words, given who sends, and whose poses came; "" if none."""


class Trackers:
    """A tracker a body, by its name; further sensors of one tracker are `NAME:SENSOR`."""

    def __init__(self, lab: tuple[str, ...], name: Callable[[str], str]) -> None:
        self._lab = lab
        self._name = name

    def body(self, sender: str, sensor: int) -> str | None:
        """By `[mocap.names]`, else as the server says."""
        return self._name(sender if sensor == 0 else f"{sender}:{sensor}")

    def lack(self, senders: Collection[str], bodies: Collection[str]) -> str:
        """A body that is hidden is there all the same, since its tracker has a name."""
        there = {self._name(sender) for sender in senders}.union(bodies)
        missing = [body for body in self._lab if body not in there]
        if missing:
            return f"the server has no tracker {_list(missing)}; it has {_list(senders)}"
        others = [body for body in bodies if self._is_other_sensor(body, bodies)]
        return f"poses come of {_list(others)}, not of sensor 0: say in [mocap.names] whose they are" if others else ""

    def _is_other_sensor(self, body: str, bodies: Collection[str]) -> bool:
        tracker, numbered, _ = body.rpartition(":")
        return bool(numbered) and tracker in self._lab and tracker not in bodies


class Sensors:
    """One device, whose sensors are bodies: by `names`, the lab's others in their order on the next free numbers."""

    def __init__(self, config: ChingmuConfig, lab: tuple[str, ...], names: dict[str, str]) -> None:
        self._device = config.device
        free = (str(n) for n in count(config.first_sensor) if str(n) not in names)
        unnamed = (body for body in lab if body not in names.values())
        self._bodies = names | dict(zip(free, unnamed, strict=False))
        self._lab = lab

    def body(self, sender: str, sensor: int) -> str | None:
        """Another sensor of the device is a body by its number; what else the server sends is none."""
        return self._bodies.get(str(sensor), str(sensor)) if sender == self._device else None

    def lack(self, senders: Collection[str], bodies: Collection[str]) -> str:
        """A sensor shows itself by its poses only."""
        if self._device not in senders:
            return f"the server has no device {plain(self._device, LONGEST_NAME)}; it has {_list(senders)}"
        numbers = {body: number for number, body in self._bodies.items()}
        missing = [f"{numbers[body]} ({body})" for body in self._lab if body not in bodies]
        there = [number for number, body in self._bodies.items() if body in bodies]
        return f"no poses of sensor {_list(missing)}; those of {_list(there)} come" if missing else ""


def _list(names: Collection[str]) -> str:
    shown = [plain(name, LONGEST_NAME) for name in list(names)[:NAMES_MAX]]
    more = len(names) - len(shown)
    return (", ".join(shown) or "none") + (f" and {more} more" if more else "")
