"""What the Tab key offers for an argument, where `--install-completion` was called. Loads little until asked."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from wire.errors import ConfigError
from wire.toml_text import read_toml

LAB = Path("lab.toml")


def starting(names: Iterable[str], incomplete: str) -> list[str]:
    """Those that begin with what is there already."""
    return [name for name in names if name.startswith(incomplete)]


def lab_near(argument: object) -> dict[str, Any]:
    """The values in the lab file of the argument, or else in `lab.toml` here; empty where it cannot be read."""
    try:
        return read_toml(LAB if argument is None else Path(str(argument)))
    except ConfigError:
        return {}


def bodies_of(lab: dict[str, Any]) -> list[str]:
    """The names of its vehicles, leader first."""
    followers = lab.get("followers", [])
    entries = [lab.get("leader"), *(followers if isinstance(followers, list) else ())]
    return [str(entry["body"]) for entry in entries if isinstance(entry, dict) and "body" in entry]


def keys_of(lab: dict[str, Any], table: str, key: str) -> list[str]:
    """The names in a table of a table."""
    entries = lab.get(table, {})
    named = entries.get(key, {}) if isinstance(entries, dict) else {}
    return list(named) if isinstance(named, dict) else []
