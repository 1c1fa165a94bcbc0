"""A Crazyflie's log of its SD card deck: a header of events and their variables, then events. Bitcraze's
`tools/usdlog/cfusdlog.py` and `src/deck/drivers/src/usddeck.c`."""

import struct
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from analysis.imports.recording import BadFileError, Recording, Table, table

KIND = "Crazyflie"
MAGIC = b"\xbc"
FIXED = "fixedFrequency"
"""The event whose variables are named without it."""
STAMPS = {1: ("<u4", 1e-3), 2: ("<u8", 1e-6)}
"""By the file's version: how an event's stamp is written, and in which part of a second."""
NUMBERS = "bBhHiIqQfde"
"""Formats of a variable, as `struct` and NumPy have them."""
VARIABLES_MOST = 1000
CRC = 4


@dataclass(slots=True)
class _Event:
    name: str
    layout: "np.dtype[np.void]"
    starts: list[int] = field(default_factory=list)


def read(path: Path) -> Recording:
    """The file: a table an event, on the vehicle's clock. BadFileError.

    A file that ends inside an event, as one that was not closed does, gives what is before it; `damage` says so, or
    that its checksum is wrong.
    """
    data = path.read_bytes()
    version, events, at = _header(path, data)
    second = STAMPS[version][1]
    damage, end = "", len(data) - CRC
    while at < end:
        event = events.get(struct.unpack_from("<H", data, at)[0]) if at + 2 <= end else None
        if event is None or at + 2 + event.layout.itemsize > end:
            what = "ends inside an event" if event is not None or at + 2 > end else "no event of its header"
            damage = f"{path}: {what} at byte {at} of {len(data)}; what is before that is imported"
            break
        event.starts.append(at + 2)
        at += 2 + event.layout.itemsize
    if not damage and zlib.crc32(data[:-CRC]) != struct.unpack("<I", data[-CRC:])[0]:
        damage = f"{path}: its checksum is wrong; what can be read of it is imported"
    tables = {}
    for event in events.values():
        if (rows := _table(path, event, data, second)) is not None:
            tables["" if event.name == FIXED else event.name] = rows
    return Recording(path, KIND, tables, damage=damage)


def _header(path: Path, data: bytes) -> tuple[int, dict[int, _Event], int]:
    """Version, events by number, and where the first begins."""
    try:
        version, count = struct.unpack_from("<HH", data, 1)
        if version not in STAMPS:
            raise BadFileError(
                f"{path}: version {version} of a Crazyflie's log; {' and '.join(map(str, STAMPS))} are read"
            )
        at, events = 5, dict[int, _Event]()
        for _ in range(count):
            (number,) = struct.unpack_from("<H", data, at)
            name, at = _text(data, at + 2)
            (variables,) = struct.unpack_from("<H", data, at)
            at += 2
            fields = [("timestamp", STAMPS[version][0])]
            for _ in range(variables if variables <= VARIABLES_MOST else 0):
                text, at = _text(data, at)  # `stateEstimate.x(f)`
                fields.append((text[:-3], f"<{NUMBERS[NUMBERS.index(text[-2:-1] or '-')]}"))
            if variables > VARIABLES_MOST or number in events or any(event.name == name for event in events.values()):
                raise ValueError
            events[number] = _Event(name, np.dtype(fields))
    except (struct.error, ValueError, KeyError, UnicodeDecodeError) as error:
        raise error if isinstance(error, BadFileError) else BadFileError(f"{path}: its header is damaged") from error
    return version, events, at


def _text(data: bytes, at: int) -> tuple[str, int]:
    """The text that ends in a zero byte, and where the next begins."""
    end = data.index(b"\0", at)
    return data[at:end].decode(), end + 1


def _table(path: Path, event: _Event, data: bytes, second: float) -> Table | None:
    size = event.layout.itemsize
    at = np.array(event.starts, np.int64)
    rows = np.frombuffer(data, np.uint8)[at[:, None] + np.arange(size)].view(event.layout)[:, 0]
    names = [name for name in event.layout.names or () if name != "timestamp"]
    return table(path, event.name, rows["timestamp"].astype(np.float64) * second, {name: rows[name] for name in names})
