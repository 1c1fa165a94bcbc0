"""A bag of ROS 2 (folder, MCAP or SQLite), by `rosbags`: every number of every message, by the topic's own stamps."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from analysis.imports.recording import BadFileError, Recording, Values, parsing, table
from mavlink_formation.installation import install_command
from wire.logs.mcap_scan import LogError

KIND = "rosbag2"
NUMBERS_MOST = 64
"""Numbers of a message that are columns; images and clouds have more, and are none."""


def read(path: Path) -> Recording:
    """The bag: a table a topic, columns as `pose.position.x`; stamped by the header where there is one, s since 1970.

    BadFileError.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise LogError(f"{path}: needs rosbags: {install_command('import')}") from error
    found: dict[str, tuple[list[float], list[tuple[str, ...]], list[list[float]]]] = {}
    with parsing(path), AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as bag:
        for connection, logged_ns, raw in bag.messages():
            message = bag.deserialize(raw, connection.msgtype)
            numbers = list(_numbers(message, ""))
            if 0 < len(numbers) <= NUMBERS_MOST:
                rows = found.setdefault(connection.topic, ([], [], []))
                rows[0].append(_stamp_ns(message) or logged_ns)
                rows[1].append(tuple(name for name, _ in numbers))
                rows[2].append([value for _, value in numbers])
    tables = {}
    for topic, (t_ns, names, values) in found.items():
        if any(each != names[0] for each in names):
            continue
        columns: dict[str, Values] = dict(zip(names[0], np.array(values, np.float64).T, strict=True))
        rows_read = table(path, topic, np.array(t_ns, np.float64) * 1e-9, columns)
        if rows_read is not None:
            tables[topic] = rows_read
    if not tables:
        raise BadFileError(f"{path}: no topic with numbers in it")
    return Recording(path, KIND, tables, unix_s=0.0)


def _stamp_ns(message: Any) -> int:
    """The header's stamp; 0 without one."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return 0 if stamp is None else int(stamp.sec) * 10**9 + int(stamp.nanosec)


def _numbers(value: Any, name: str) -> Iterator[tuple[str, float]]:
    """Every number of a message below that name, but its header's."""
    if isinstance(value, bool | int | float | np.number):
        yield name, float(value)
    elif isinstance(value, np.ndarray | list | tuple):
        if len(value) <= NUMBERS_MOST:
            for k, each in enumerate(value):
                yield from _numbers(each, f"{name}[{k}]")
    elif hasattr(value, "__dataclass_fields__"):
        for key in value.__dataclass_fields__:
            if key not in ("header", "__msgtype__"):
                yield from _numbers(getattr(value, key), f"{name}.{key}" if name else key)
