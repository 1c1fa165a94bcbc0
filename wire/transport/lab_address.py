"""Where on the bus a lab's ground is asked: its name and endpoints, and nothing else of its file.

A file that is wrong elsewhere keeps nobody from stopping the swarm; `gcs run` is who judges it whole.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from formation.requests import ENDPOINT, LAB
from wire.errors import ConfigError
from wire.toml_text import read_toml


@dataclass(frozen=True, slots=True)
class LabAddress:
    """The lab's name, and the endpoints to connect to: where the ground itself is the hub, its own."""

    lab: str = LAB
    endpoints: tuple[str, ...] = (ENDPOINT,)


def address_in(path: Path) -> LabAddress:
    """The address in a lab file; ConfigError where it cannot be read there."""
    values = read_toml(path)
    lab, link = values.get("name", LAB), values.get("link", {})
    if not isinstance(lab, str):
        raise ConfigError([f"{path}: name: is not text (it is {lab!r})"])
    if not isinstance(link, dict):
        raise ConfigError([f"{path}: link: is not a table"])
    connect = _endpoints(path, link, "zenoh_connect", (ENDPOINT,))
    return LabAddress(lab, connect or _endpoints(path, link, "zenoh_listen", ()))


def _endpoints(path: Path, link: dict[str, Any], key: str, usual: tuple[str, ...]) -> tuple[str, ...]:
    value = link.get(key, usual)
    if not isinstance(value, list | tuple) or not all(isinstance(item, str) for item in value):
        raise ConfigError([f"{path}: link.{key}: is not a list of endpoints (it is {value!r})"])
    return tuple(value)
