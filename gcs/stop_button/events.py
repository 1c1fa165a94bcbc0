"""What Linux input devices say: the kernel's structs, `input_event` of /dev/input/event* and `js_event` of js*. Pure.

linux/input.h: two longs of time, type, code, value; linux/joystick.h: time, value, type, number.
"""

import struct
from pathlib import PurePath

INPUT_EVENT = struct.Struct("llHHi")
JS_EVENT = struct.Struct("IhBB")
EV_KEY, PRESSED = 1, 1
JS_EVENT_BUTTON = 1  # JS_EVENT_INIT, 0x80, marks what was so when the device was opened


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
            _, value, kind, code = fields
            return code if kind == JS_EVENT_BUTTON and value == PRESSED else None
        _, _, kind, code, value = fields
        return code if kind == EV_KEY and value == PRESSED else None


def _is_joystick(device: str) -> bool:
    """By its name: js0, or by-id's ...-joystick, beside which stands ...-event-joystick, of the other kind."""
    name = PurePath(device).name
    return name.startswith("js") or (name.endswith("-joystick") and not name.endswith("-event-joystick"))
