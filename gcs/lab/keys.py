"""Findings about a key of the lab file: the value as it is written there, and the grade."""

from collections.abc import Iterable
from enum import Enum
from typing import Any

from formation.config import LabConfig
from gcs.finding import Finding, Grade


class Keys:
    """The lab's keys, and what is to be said of them: `Finding.subject` is the key, `found` its value."""

    def __init__(self, config: LabConfig) -> None:
        self._config = config

    def reject(self, key: str, check: str, why: str, wanted: str = "") -> Finding:
        """An error: the lab cannot be flown with this value."""
        return Finding(key, check, Grade.FAIL, self.value(key), wanted, why)

    def warn(self, key: str, check: str, why: str, wanted: str = "") -> Finding:
        """A warning: the lab can be flown, but the value is unusual."""
        return Finding(key, check, Grade.WARN, self.value(key), wanted, why)

    def value(self, key: str) -> str:
        """The value at `followers[0].offset_m`, as TOML would have it; nothing for one that is a table."""
        found: Any = self._config
        rest = key
        while rest:
            name, found = _step(found, rest)
            rest = rest[len(name) :].lstrip(".")
        return written(found)


def _step(table: Any, key: str) -> tuple[str, Any]:
    """The first part of a key, and what is there; names of shapes may have dots of their own."""
    if key.startswith("["):
        index = key[: key.index("]") + 1]
        return index, table[int(index[1:-1])]
    if isinstance(table, dict):
        name = key.rpartition("[")[0] if "[" in key else key
        return name, table[name]
    name = key.partition(".")[0].partition("[")[0]
    return name, getattr(table, name)


def written(value: object) -> str:
    """A value as in a TOML file, numbers short; nothing for a table."""
    match value:
        case bool():
            return "true" if value else "false"
        case int() | float():
            return f"{value:.6g}"
        case Enum() | str():
            return f'"{value}"'
        case list() | tuple():
            return _list(value)
        case _:
            return ""


def _list(values: Iterable[object]) -> str:
    items = [written(item) for item in values]
    return f"[{', '.join(items)}]" if all(items) and len(items) <= 8 else ""
