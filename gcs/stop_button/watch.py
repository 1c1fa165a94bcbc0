"""Waits on the stop button's device, in the ground's event loop; detects that it is gone, and reopens it."""

import asyncio
import os
from typing import Protocol

from formation.config import StopButton
from gcs.stop_button.events import Buttons

AGAIN_S = 0.5
READ_BYTES = 1536
PAUSE_S = 0.002
"""A turn reads 64 events of a keyboard and then rests: a joystick whose stick trembles costs the control nothing."""


class Pressed(Protocol):
    """The ground, which receives the presses."""

    button_trouble: str

    def press(self) -> None:
        """The button was pressed."""


async def watch_button(button: StopButton | None, ground: Pressed) -> None:
    """Report every press and each device error, until cancelled; returns at once without a button."""
    if button is None:
        return
    while True:
        try:
            await _until_gone(button, ground)
        except OSError as error:
            ground.button_trouble = f"the stop button does not work: {button.device}: {error.strerror or error}"
        await asyncio.sleep(AGAIN_S)


async def _until_gone(button: StopButton, ground: Pressed) -> None:
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
