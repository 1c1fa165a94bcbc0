"""A gamepad: what its events ask for, and that nothing but a hand on it moves a drone."""

import asyncio
import errno
import os
from pathlib import Path
from types import SimpleNamespace

import pytest

from formation.requests import OperatorReply, Verb
from gcs.gamepad import EV_ABS, EV_KEY, EV_SYN, SILENT_NS, SYN_DROPPED, Axis, Gamepad, Sticks, fly, sticks_of
from wire.clock import Clock

BTN_TL, BTN_TR = 0x136, 0x137
MS = 1_000_000
RANGES = dict.fromkeys((Axis.X, Axis.Y, Axis.RX, Axis.RY), (-32768, 32767))
# As Linux's xpad reports them: a button over the triggers pressed, the right stick pushed ahead and let go of.
RECORDED = [
    (EV_KEY, BTN_TR, 1, 0),
    (EV_ABS, Axis.RY, -9000, 40),
    (EV_ABS, Axis.RY, -26214, 80),
    (EV_ABS, Axis.RY, -20, 300),
]


def pad(facing_rad: float = 0.0) -> Gamepad:
    return Gamepad(RANGES, Sticks(), 0.5, 1.0, facing_rad)


def pressed(**axes: float) -> Gamepad:
    """Its button held, and these axes so far from their middle, all at once."""
    made = pad()
    made.receive(EV_KEY, BTN_TL, 1, 0)
    for name, way in axes.items():
        made.receive(EV_ABS, Axis[name], round(32767 * way), 0)
    return made


@pytest.mark.parametrize(
    ("axes", "velocity"),
    [
        ({}, (0.0, 0.0, 0.0, 0.0)),
        ({"RY": -1.0}, (0.5, 0.0, 0.0, 0.0)),
        ({"RY": -0.8}, (0.5, 0.0, 0.0, 0.0)),
        ({"RY": -0.45}, (0.25, 0.0, 0.0, 0.0)),
        ({"RX": 1.0}, (0.0, -0.5, 0.0, 0.0)),
        ({"Y": -1.0}, (0.0, 0.0, 0.5, 0.0)),
        ({"X": -1.0}, (0.0, 0.0, 0.0, 1.0)),
        ({"X": 0.09, "RX": -0.09}, (0.0, 0.0, 0.0, 0.0)),
    ],
)
def test_sticks_are_those_of_a_remote_control_of_mode_2(axes: dict[str, float], velocity: tuple[float, ...]) -> None:
    assert pressed(**axes).velocity(0) == pytest.approx(velocity, abs=1e-4)


def test_ahead_is_where_the_operator_looks() -> None:
    faced = pad(facing_rad=1.5707963)
    faced.receive(EV_KEY, BTN_TL, 1, 0)
    faced.receive(EV_ABS, Axis.RY, -32768, 0)
    assert faced.velocity(0) == pytest.approx((0.0, 0.5, 0.0, 0.0), abs=1e-6)


def test_recorded_events() -> None:
    recorded, asked = pad(), list[float | None]()
    for kind, code, value, t_ms in RECORDED:
        before = recorded.velocity(t_ms * MS)
        asked.append(None if before is None else round(before[0], 2))
        recorded.receive(kind, code, value, t_ms * MS)
    assert asked == [None, 0.0, 0.12, 0.5]
    assert recorded.velocity(10**12) == (0.0, 0.0, 0.0, 0.0)  # at rest it needs to say nothing


@pytest.mark.parametrize(
    "fault",
    [
        lambda p: p.receive(EV_KEY, BTN_TL, 0, 0),
        lambda p: p.receive(EV_SYN, SYN_DROPPED, 0, 0),
        lambda p: p.velocity(SILENT_NS + 1),
        lambda p: p.let_go(),
    ],
    ids=["let go of", "an event lost", "silent with its stick aside", "refused"],
)
def test_after_a_fault_it_asks_for_nothing_until_the_button_is_pressed_anew(fault) -> None:
    held = pressed(RY=-1.0)
    assert held.velocity(SILENT_NS) is not None
    fault(held)
    held.receive(EV_ABS, Axis.RY, -32000, SILENT_NS)
    held.receive(EV_KEY, BTN_TL, 2, SILENT_NS)  # the kernel's own repetition
    assert held.velocity(SILENT_NS) is None
    held.receive(EV_KEY, BTN_TL, 1, SILENT_NS)
    assert held.velocity(SILENT_NS) is not None


def test_both_layouts_of_the_right_stick_and_none() -> None:
    assert sticks_of((0, 1, 2, 3, 4, 5)) == Sticks()
    assert sticks_of((0, 1, 2, 5)) == Sticks(aside=Axis.Z, ahead=Axis.RZ)
    assert sticks_of((0, 1)) is None


class _Device:
    """Whatever is put into it is read at once; pulled out it fails as the kernel's does."""

    def __init__(self) -> None:
        self.fd, self._end = os.pipe()
        self._events: list[SimpleNamespace] = []
        self._pulled = False

    def put(self, *events: tuple[int, int, int]) -> None:
        self._events += [SimpleNamespace(type=kind, code=code, value=value) for kind, code, value in events]
        os.write(self._end, b"x")

    def pull(self) -> None:
        self._pulled = True
        os.write(self._end, b"x")

    def read(self):
        os.read(self.fd, 1)
        if self._pulled:
            raise OSError(errno.ENODEV, "No such device")
        events, self._events = self._events, []
        return events


def test_a_pulled_gamepad_holds_and_a_refusal_asks_for_the_button_anew() -> None:
    asked: list[tuple[Verb, str]] = []
    errors: list[str] = []

    async def flown() -> None:
        device, answers = _Device(), iter([True, True, True, False])

        async def ask(verb: Verb, argument: str) -> OperatorReply:
            asked.append((verb, argument))
            accepted = next(answers, True)
            if len(asked) == 2:
                device.put((EV_KEY, BTN_TL, 0))
            elif len(asked) == 3:
                device.put((EV_KEY, BTN_TL, 1))
            elif len(asked) == 4:
                asyncio.get_running_loop().call_later(0.2, device.pull)
            return OperatorReply(0, accepted, "no pose")

        device.put((EV_ABS, Axis.RY, -32768), (EV_KEY, BTN_TL, 1))
        await fly(device, pad(), "lead", ask, errors.append, Clock())

    with pytest.raises(OSError, match="No such device"):
        asyncio.run(flown())
    moves = [argument for verb, argument in asked if verb is Verb.MOVE]
    assert moves[0] == moves[1] == "lead 0.500 0.000 0.000 0.000"
    assert moves[2] == "lead 0.000 0.000 0.000 0.000"
    assert len(moves) == 4  # the refused one was the last
    assert asked[-1] == (Verb.HOLD, "")
    assert errors == ["refused: no pose"]


@pytest.mark.skipif(not Path("/dev/uinput").exists(), reason="this machine has no /dev/uinput")
def test_a_virtual_device_of_the_kernel() -> None:
    evdev = pytest.importorskip("evdev")
    sticks = [(axis, evdev.AbsInfo(0, -32768, 32767, 0, 0, 0)) for axis in Sticks()]
    with evdev.UInput({EV_KEY: [evdev.ecodes.BTN_GAMEPAD, BTN_TL], EV_ABS: sticks}, name="virtual pad") as virtual:
        device = evdev.InputDevice(virtual.device.path)
        made = pad()
        virtual.write(EV_KEY, BTN_TL, 1)
        virtual.write(EV_ABS, Axis.RY, -32768)
        virtual.syn()
        for event in device.read():
            made.receive(event.type, event.code, event.value, 0)
    assert made.velocity(0) == pytest.approx((0.5, 0.0, 0.0, 0.0))
