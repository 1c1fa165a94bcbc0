"""A gamepad's events as the velocity that it asks of one drone; and the loop that asks for it. Linux's evdev.

`Gamepad` is pure. It asks only while its dead man's button is held. Where the button is let go of, where events were
lost, or where a stick that is off its middle sends nothing for SILENT_NS, it asks for rest, and the button is to be
pressed anew: a radio that is out of range leaves the kernel with the last thing it said.
"""

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Mapping
from enum import IntEnum
from math import cos, sin
from typing import NamedTuple, Protocol

from formation.guidance.plan import STILL, Velocity
from formation.requests import OperatorReply, Verb
from wire.clock import Clock

SILENT_NS = 300_000_000
PERIOD_NS = 50_000_000
"""Between two requests: six in the time for which the ground flies a velocity."""
MIDDLE, FULL = 0.1, 0.8
"""Of a stick's way: rest, and full speed. At its stop it may send nothing, and nobody's hand is still short of it."""
EV_SYN, EV_KEY, EV_ABS = 0, 1, 3
SYN_DROPPED = 3
DEAD_MAN = (0x136, 0x137)  # BTN_TL, BTN_TR: the buttons over the triggers


class Axis(IntEnum):
    """The kernel's codes (linux/input-event-codes.h)."""

    X = 0
    Y = 1
    Z = 2
    RX = 3
    RY = 4
    RZ = 5


class Sticks(NamedTuple):
    """Which axis asks for what, as on a remote control of mode 2; each counts up to the right and downwards."""

    turn: Axis = Axis.X
    height: Axis = Axis.Y
    aside: Axis = Axis.RX
    ahead: Axis = Axis.RY


def sticks_of(axes: Iterable[int]) -> Sticks | None:
    """The two sticks of a device that has these axes; None where it has no two."""
    found = frozenset(axes)
    return next((s for s in (Sticks(), Sticks(aside=Axis.Z, ahead=Axis.RZ)) if found.issuperset(s)), None)


class Gamepad:
    """Events in, velocity out."""

    def __init__(
        self, ranges: Mapping[int, tuple[int, int]], sticks: Sticks, speed_m_s: float, turn_rad_s: float,
        facing_rad: float = 0.0,
    ) -> None:  # fmt: skip
        """ranges: lowest and highest value of each axis. facing_rad: where ahead is, as a heading in `lab`."""
        self._ranges, self._sticks = ranges, sticks
        self._speed_m_s, self._turn_rad_s, self._facing_rad = speed_m_s, turn_rad_s, facing_rad
        self._deflections = dict.fromkeys(sticks, 0.0)
        self._held = frozenset[int]()
        self._event_ns = 0

    def receive(self, kind: int, code: int, value: int, now_ns: int) -> None:
        """One event of the device, as it was read."""
        self._event_ns = now_ns
        if kind == EV_SYN and code == SYN_DROPPED:
            self.let_go()
        elif kind == EV_KEY and code in DEAD_MAN:
            self._held = {1: self._held | {code}, 0: self._held - {code}}.get(value, self._held)  # 2: it repeats
        elif kind == EV_ABS and code in self._deflections:
            low, high = self._ranges[code]
            self._deflections[Axis(code)] = _deflection(2.0 * (value - low) / max(high - low, 1) - 1.0)

    def let_go(self) -> None:
        """As if the button was let go of: it is to be pressed anew."""
        self._held = frozenset()

    def velocity(self, now_ns: int) -> Velocity | None:
        """What is asked for now; None where the button is not held."""
        if now_ns - self._event_ns > SILENT_NS and any(self._deflections.values()):
            self.let_go()
        if not self._held:
            return None
        turn, height, aside, ahead = (0.0 - self._deflections[axis] for axis in self._sticks)
        c, s = self._speed_m_s * cos(self._facing_rad), self._speed_m_s * sin(self._facing_rad)
        return ahead * c - aside * s, ahead * s + aside * c, height * self._speed_m_s, turn * self._turn_rad_s


def _deflection(share: float) -> float:
    """From -1 to 1, as a share of its way from its middle."""
    size = min(max(abs(share) - MIDDLE, 0.0) / (FULL - MIDDLE), 1.0)
    return size if share > 0.0 else -size


class InputEvent(Protocol):
    """Of evdev."""

    type: int
    code: int
    value: int


class Device(Protocol):
    """Of evdev: an open device that is read without waiting."""

    fd: int

    def read(self) -> Iterable[InputEvent]:
        """The events that wait; OSError where it is unplugged."""


Ask = Callable[[Verb, str], Awaitable[OperatorReply]]


async def fly(device: Device, pad: Gamepad, body: str, ask: Ask, report: Callable[[str], None], clock: Clock) -> None:
    """Ask for the gamepad's velocities until cancelled; where the device is lost, hold and raise its OSError.

    TimeoutError where no ground answers, which then holds by itself.
    """
    loop = asyncio.get_running_loop()
    lost: asyncio.Future[OSError] = loop.create_future()

    def read() -> None:
        try:
            for event in device.read():
                pad.receive(event.type, event.code, event.value, clock.monotonic_ns())
        except BlockingIOError:
            return
        except OSError as error:
            loop.remove_reader(device.fd)
            lost.set_result(error)

    loop.add_reader(device.fd, read)
    asked = STILL
    try:
        while not lost.done():
            now_ns = clock.monotonic_ns()
            wanted = pad.velocity(now_ns)
            if wanted is not None or asked != STILL:
                asked = wanted or STILL
                reply = await ask(Verb.MOVE, f"{body} {' '.join(f'{number:.3f}' for number in asked)}")
                if not reply.accepted:
                    report(f"refused: {reply.text}")
                    pad.let_go()
                    asked = STILL
            await clock.sleep_until_ns(now_ns + PERIOD_NS)
        await ask(Verb.HOLD, "")
        raise lost.result()
    finally:
        loop.remove_reader(device.fd)
