"""The stop button: any key or button of a Linux input device, read by the ground itself, and found by `gcs buttons`.

The kernel's structs: linux/input.h `input_event` of /dev/input/event*: two longs of time, type, code, value;
linux/joystick.h `js_event` of js*: time, value, type, number.
"""

import asyncio
import json
import os
import select
import struct
from pathlib import Path, PurePath
from typing import Protocol

from formation.config import StopButton
from wire.transport.link import PAUSE_S

INPUT_EVENT = struct.Struct("llHHi")
JS_EVENT = struct.Struct("IhBB")
READ_BYTES = 1536
"""A turn reads 64 events of a keyboard and then rests: a joystick whose stick trembles costs the control nothing."""
FOLDER = Path("/dev/input")


class Buttons:
    """The presses in a device's bytes; a key that is held down repeats without being pressed again."""

    def __init__(self, device: str) -> None:
        self._joystick = _is_joystick(device)
        self._rest = b""

    def read(self, data: bytes) -> list[int]:
        """The codes of the buttons that these bytes say were pressed, in order; half an event waits for its rest."""
        record = JS_EVENT if self._joystick else INPUT_EVENT
        data = self._rest + data
        whole = len(data) - len(data) % record.size
        self._rest = data[whole:]
        return [code for code in map(self._pressed, record.iter_unpack(data[:whole])) if code is not None]

    def _pressed(self, fields: tuple[int, ...]) -> int | None:
        if self._joystick:
            _, value, kind, code = fields  # 1 is JS_EVENT_BUTTON; JS_EVENT_INIT, 0x80, marks what was so at first
        else:
            _, _, kind, code, value = fields  # 1 is EV_KEY
        return code if kind == value == 1 else None


def _is_joystick(device: str) -> bool:
    """By its name: js0, or by-id's ...-joystick, beside which stands ...-event-joystick, of the other kind."""
    name = PurePath(device).name
    return name.startswith("js") or (name.endswith("-joystick") and not name.endswith("-event-joystick"))


class StopReceiver(Protocol):
    """The ground, which receives the presses."""

    button_trouble: str

    def press(self) -> None:
        """The button was pressed."""


async def watch_button(button: StopButton | None, ground: StopReceiver) -> None:
    """Report every press and each device error, until cancelled; returns at once without a button."""
    if button is None:
        return
    while True:
        try:
            await _until_gone(button, ground)
        except OSError as error:
            ground.button_trouble = f"the stop button does not work: {button.device}: {error.strerror or error}"
        await asyncio.sleep(0.5)  # then it is tried again


async def _until_gone(button: StopButton, ground: StopReceiver) -> None:
    """Read the device; OSError when it cannot be opened, or is unplugged."""
    device = os.open(button.device, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        buttons = Buttons(button.device)
        ground.button_trouble = ""
        while True:
            await _readable(device)
            data = os.read(device, READ_BYTES)
            if not data:
                raise OSError(None, "unplugged")
            if any(button.button in (None, code) for code in buttons.read(data)):
                ground.press()
            if len(data) == READ_BYTES:
                await asyncio.sleep(PAUSE_S)
    finally:
        os.close(device)


async def _readable(device: int) -> None:
    loop = asyncio.get_running_loop()
    ready = loop.create_future()
    loop.add_reader(device, lambda: None if ready.done() else ready.set_result(None))
    try:
        await ready
    finally:
        loop.remove_reader(device)


def print_presses(as_json: bool = False) -> None:
    """Print each press until Ctrl-C; ends at once where there is no input device that may be read."""
    named = {path.resolve(): path for path in sorted(FOLDER.glob("by-id/*"))}
    devices: dict[int, tuple[str, Buttons]] = {}
    for path in sorted((*FOLDER.glob("event*"), *FOLDER.glob("js*"))):
        try:
            device = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        except OSError as error:
            _print(as_json, {"device": str(path), "error": error.strerror}, f"{path}: {error.strerror}")
            continue
        name = str(named.get(path.resolve(), path))
        devices[device] = (name, Buttons(str(path)))
    text = f"{len(devices)} devices: press the button" if devices else f"no input device under {FOLDER} can be read"
    _print(as_json, {"devices": [name for name, _ in devices.values()]}, text)
    while devices:
        ready, _, _ = select.select(list(devices), [], [])
        for device in ready:
            name, buttons = devices[device]
            try:
                codes = buttons.read(os.read(device, READ_BYTES))
            except OSError:  # unplugged
                del devices[device]
                continue
            for code in codes:
                line = f'stop_button = {{ device = "{name}", button = {code} }}'
                _print(as_json, {"device": name, "button": code}, line)


def _print(as_json: bool, record: dict[str, object], text: str) -> None:
    """One line, for scripts or for people."""
    print(json.dumps(record) if as_json else text, flush=True)
