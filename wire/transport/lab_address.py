"""Where on the bus a lab's ground is asked: its name, endpoints and keys, and nothing else of its file.

A file that is wrong elsewhere keeps nobody from stopping the swarm; `gcs run` is who judges it whole.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from formation.requests import ENDPOINT, LAB
from wire.errors import ConfigError
from wire.files import read_toml
from wire.security.bus_access import BusAccess, own_access
from wire.security.private_keys import keys_folder

HERE = Path("lab.toml")


@dataclass(frozen=True, slots=True)
class LabAddress:
    """The lab's name, the endpoints to connect to (where the ground itself is the hub, its own), and the keys."""

    lab: str = LAB
    endpoints: tuple[str, ...] = (ENDPOINT,)
    keys: Path | None = None
    """Folder of the keys; None without [security]."""

    def access(self, identity: str = "", insecure: bool = False) -> BusAccess:
        """How a person's command is on the bus; identity: as whom, see `own_access`. ConfigError."""
        return BusAccess(insecure=insecure) if self.keys is None else own_access(self.keys, identity)


def address_in(path: Path) -> LabAddress:
    """The address in a lab file; ConfigError where it cannot be read there."""
    values = read_toml(path)
    lab, link = values.get("name", LAB), values.get("link", {})
    if not isinstance(lab, str):
        raise ConfigError([f"{path}: name: is not text (it is {lab!r})"])
    if not isinstance(link, dict):
        raise ConfigError([f"{path}: link: is not a table"])
    listen = _endpoints(path, link, "zenoh_listen", ())
    connect = _endpoints(path, link, "zenoh_connect", () if listen else (ENDPOINT,))
    return LabAddress(lab, connect or listen, _keys(path, values.get("security")))


def address_near(path: Path | None) -> LabAddress:
    """The address in a lab file; without one that in `lab.toml` here, or the usual. ConfigError."""
    if path is not None:
        return address_in(path)
    try:
        return address_in(HERE)
    except ConfigError:  # none, or not one that can be read
        return LabAddress()


def _keys(path: Path, security: object) -> Path | None:
    if security is None:
        return None
    keys = security.get("keys", "keys") if isinstance(security, dict) else None
    if not isinstance(keys, str):
        raise ConfigError([f"{path}: security.keys: is not the name of a folder (it is {keys!r})"])
    return keys_folder(keys, path)


def _endpoints(path: Path, link: dict[str, Any], key: str, usual: tuple[str, ...]) -> tuple[str, ...]:
    value = link.get(key, usual)
    if not isinstance(value, list | tuple) or not all(isinstance(item, str) for item in value):
        raise ConfigError([f"{path}: link.{key}: is not a list of endpoints (it is {value!r})"])
    return tuple(value)
