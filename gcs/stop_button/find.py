"""`gcs buttons`: prints what is pressed on any input device, as the lab file wants it."""

import json
import os
import select
from pathlib import Path

from gcs.stop_button.events import Buttons

FOLDER = Path("/dev/input")


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
                codes = buttons.read(os.read(device, 1536))
            except OSError:  # unplugged
                del devices[device]
                continue
            for code in codes:
                line = f'stop_button = {{ device = "{name}", button = {code} }}'
                _print(as_json, {"device": name, "button": code}, line)


def _print(as_json: bool, record: dict[str, object], text: str) -> None:
    """One line, for scripts or for people."""
    print(json.dumps(record) if as_json else text, flush=True)
