"""The stop button: the kernel's event structs, through a pipe that stands for /dev/input, and its unplugging."""

import asyncio
import os
import struct
from pathlib import Path

from formation.config import StopButton
from gcs.stop_button import Buttons, watch_button

KEY_SPACE, KEY_ENTER, EV_SYN, EV_KEY, EV_ABS = 57, 28, 0, 1, 3


def input_event(kind: int, code: int, value: int) -> bytes:
    """linux/input.h on a 64-bit machine: struct timeval (two 8-byte longs), __u16 type, __u16 code, __s32 value."""
    return struct.pack("<qqHHi", 1_700_000_000, 123_456, kind, code, value)


def js_event(kind: int, number: int, value: int) -> bytes:
    """linux/joystick.h: __u32 time, __s16 value, __u8 type, __u8 number."""
    return struct.pack("<IhBB", 12_345, value, kind, number)


def test_a_press_is_a_press_and_neither_a_release_nor_a_repeat_and_half_an_event_waits():
    buttons = Buttons("/dev/input/event3")
    events = [(EV_KEY, KEY_SPACE, 1), (EV_SYN, 0, 0), *((EV_KEY, KEY_SPACE, v) for v in (2, 2, 0)), (EV_ABS, 1, 1)]
    assert buttons.read(b"".join(input_event(*event) for event in events)) == [KEY_SPACE]
    event = input_event(EV_KEY, KEY_ENTER, 1)
    assert buttons.read(event[:10]) == []
    assert buttons.read(event[10:] + event[:3]) == [KEY_ENTER]


def test_a_joystick_tells_its_buttons_and_not_its_sticks_nor_how_it_was_opened():
    for device in ("/dev/input/js0", "/dev/input/by-id/usb-Maker_Stick-joystick"):
        buttons = Buttons(device)
        assert buttons.read(js_event(0x81, 0, 1) + js_event(2, 0, 1) + js_event(1, 5, 1) + js_event(1, 5, 0)) == [5]
    assert Buttons("/dev/input/by-id/usb-Maker_Stick-event-joystick").read(input_event(EV_KEY, 0x120, 1)) == [0x120]


class Ground:
    def __init__(self) -> None:
        self.button_trouble, self.presses = "", 0

    def press(self) -> None:
        self.presses += 1


async def until(condition) -> None:
    async with asyncio.timeout(20.0):
        while not condition():
            await asyncio.sleep(0.005)


def test_presses_unplugging_and_plugging_in_again(tmp_path: Path):
    device = tmp_path / "event7"

    async def use() -> None:
        ground = Ground()
        await watch_button(None, ground)  # without one nothing is waited for
        watching = asyncio.create_task(watch_button(StopButton(device=str(device), button=KEY_SPACE), ground))
        await until(lambda: "No such file" in ground.button_trouble)
        os.mkfifo(device)
        plug = os.open(device, os.O_RDWR)
        await until(lambda: ground.button_trouble == "")
        os.write(plug, input_event(EV_KEY, KEY_ENTER, 1) + input_event(EV_KEY, KEY_SPACE, 1))
        await until(lambda: ground.presses == 1)
        device.unlink()
        os.close(plug)
        await until(lambda: "unplugged" in ground.button_trouble or "No such file" in ground.button_trouble)
        watching.cancel()
        await asyncio.gather(watching, return_exceptions=True)
        assert ground.presses == 1

    asyncio.run(use())
