"""Parameters kept between runs: one `NAME VALUE` a line, as MAVProxy and QGroundControl write theirs."""

import os
from collections.abc import Mapping
from pathlib import Path

from wire.config_file import ConfigError
from wire.files import private, read_text


def read(path: Path) -> dict[str, float]:
    """The values in the file, none if it is not there yet; ConfigError names the line that is wrong.

    A folder that is not there is an error now, not when the first value is to be kept.
    """
    if not path.parent.is_dir():
        raise ConfigError([f"{path}: no such folder"])
    try:
        lines = read_text(path).splitlines()
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise ConfigError([f"{path}: {error}"]) from error
    values: dict[str, float] = {}
    for number, line in enumerate(lines, start=1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            name, value = words
            values[name] = float(value)
        except ValueError as error:
            raise ConfigError([f"{path}:{number}: not a `NAME VALUE` line: {line!r}"]) from error
    return values


def write(path: Path, values: Mapping[str, float]) -> None:
    """Replace the file at once, so that a kill leaves the old or the new one whole. OSError."""
    draft = path.with_name(f"{path.name}.new")
    with open(draft, "w", encoding="utf-8", opener=private) as file:
        file.writelines(f"{name} {value:.9g}\n" for name, value in sorted(values.items()))
        file.flush()
        os.fsync(file.fileno())
    draft.replace(path)
