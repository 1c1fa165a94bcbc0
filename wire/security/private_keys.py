"""Folders of keys: their owner's alone, or not used. No key, nor any part of one, is in an error.

keys/            0700   made by `gcs keys new`, beside the lab file; a drone's own folder by `gcs keys install`
  operations.log        what was done to the keys: date, who, what
  authority.pem         the authority's private key: on the computer where keys are made, and nowhere else
  ca.pem                its certificate
  loopback              where the hub of this computer listens for it alone
  NAME/          0700   one identity
    ca.pem, certificate.pem, private.pem, name           on the bus: the name is the certificate's
    mavlink-SYSID.key   64 hexadecimal digits: MAVLink signing of that drone; the ground has every drone's
    autopilot.key       likewise, between a bridge and its autopilot
    autopilot-installed.key   likewise, what the autopilot has been given and has proved to have
    access.json         who may do what on the bus, as every process enforces it
    stop.key            64 hexadecimal digits: of an operator, for a stop by one datagram; the ground has stop-NAME.key
    tokens              of the page: SHA-256 of each operator's token
    stamp, stamp-DIGEST newest stamp of signed packets, see StampFile; a drone's begins anew with its key
"""

import os
import stat
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path
from re import fullmatch
from typing import Any

from wire.errors import ConfigError
from wire.files import private, read_text
from wire.text import parse_object

AUTHORITY, CERTIFICATE, PRIVATE, NAME = "ca.pem", "certificate.pem", "private.pem", "name"
ACCESS, AUTOPILOT, STAMP = "access.json", "autopilot.key", "stamp"
INSTALLED = "autopilot-installed.key"
REVOKED_NAMES = "revoked-names"
HUB, TOKENS, STOP_KEY = "loopback", "tokens", "stop.key"
OPERATIONS = "operations.log"
KEY_BYTES = 32
"""Length of a MAVLink signing key."""


def keys_folder(keys: str, lab_file: Path) -> Path:
    """The folder that a lab file names: a relative path counts from the file."""
    return lab_file.parent / keys


def demand_private(path: Path) -> None:
    """ConfigError for a file or folder that is missing, another user's, or open to others."""
    try:
        found = path.stat()
    except OSError as error:
        raise ConfigError(
            [f"{path}: {error.strerror}: make keys with `gcs keys new`, or `gcs keys install`"]
        ) from error
    if found.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        wanted = "700" if stat.S_ISDIR(found.st_mode) else "600"
        raise ConfigError([f"{path}: open to others (mode {found.st_mode & 0o777:o}): chmod {wanted} {path}"])
    if found.st_uid not in (0, os.getuid()):
        raise ConfigError([f"{path}: belongs to another user"])


def demand_private_tree(folder: Path) -> None:
    """The same of a folder and everything in it."""
    demand_private(folder)
    for path in sorted(folder.rglob("*")):
        demand_private(path)


def write_private(path: Path, data: bytes) -> None:
    """Write a file, its owner's alone, whole or not at all. OSError."""
    new = path.with_name(f".{path.name}.new")
    with open(new, "wb", opener=private) as file:
        file.write(data)
        os.fchmod(file.fileno(), 0o600)
    new.replace(path)


def read_mavlink_key(path: Path) -> bytes:
    """The key in a file of 64 hexadecimal digits; ConfigError without any of them."""
    try:
        key = bytes.fromhex(read_text(path).strip())
    except OSError as error:
        raise ConfigError([f"{path}: {error.strerror}"]) from error
    except ValueError:
        key = b""
    if len(key) != KEY_BYTES:
        raise ConfigError([f"{path}: not a key of {2 * KEY_BYTES} hexadecimal digits"])
    return key


def read_name(path: Path) -> str:
    """The certificate's name, as its file beside it says. ConfigError."""
    try:
        name = read_text(path).strip()
    except (OSError, ValueError) as error:
        raise ConfigError([f"{path}: no name of a certificate: {error}"]) from error
    if not fullmatch(r"[A-Za-z0-9_.-]+\.[0-9]+", name):
        raise ConfigError([f"{path}: no name of a certificate"])
    return name


def mavlink_key_file(sysid: int) -> str:
    """The file of a drone's key."""
    return f"mavlink-{sysid}.key"


def drone_stamp_file(keys: Mapping[int, bytes]) -> str:
    """A drone's file of stamps: one for each key, so that what a stolen key has done to it ends with the key."""
    return f"{STAMP}-{sha256(b''.join(keys[sysid] for sysid in sorted(keys))).hexdigest()[:16]}"


def stop_key_file(name: str) -> str:
    """The ground's file of the stop key of a certificate's name."""
    return f"stop-{name}.key"


def read_mavlink_keys(folder: Path) -> Mapping[int, bytes]:
    """An identity's keys of MAVLink signing, by system id. ConfigError."""
    return {int(path.stem.removeprefix("mavlink-")): read_mavlink_key(path) for path in folder.glob("mavlink-*.key")}


def read_access(folder: Path) -> dict[str, Any]:
    """The access rules of an identity's folder. ConfigError."""
    path = folder / ACCESS
    try:
        return parse_object(read_text(path))
    except (OSError, ValueError) as error:
        raise ConfigError([f"{path}: no access rules: {error}"]) from error


def read_revoked(folder: Path) -> frozenset[str]:
    """The names of revoked certificates in a folder; none where nothing is revoked. ConfigError."""
    try:
        return frozenset(read_text(folder / REVOKED_NAMES).split())
    except FileNotFoundError:
        return frozenset()
    except (OSError, ValueError) as error:
        raise ConfigError([f"{folder / REVOKED_NAMES}: no names of certificates: {error}"]) from error


def note_operation(keys: Path, line: str) -> None:
    """Append what was done to the keys to their folder's record. OSError."""
    with open(keys / OPERATIONS, "a", encoding="utf-8", opener=private) as file:
        file.write(f"{line}\n")


def read_operations(keys: Path) -> str:
    """The newest lines of the folder's record; empty where there is none."""
    try:
        lines = read_text(keys / OPERATIONS).splitlines()
    except (OSError, ValueError):
        return ""
    return "\n".join(lines[-100:])


class StampFile:
    """Keeps the newest stamp across restarts, a margin ahead of what was used: packets up to it are never accepted.

    `store` is called at least once in MARGIN_S; a process that restarts sooner than that waits for its clock.
    """

    PERIOD_S, MARGIN_S = 0.5, 2.0
    _MARGIN = round(MARGIN_S * 1e5)

    def __init__(self, path: Path) -> None:
        self._path = path
        self._stored = self.read()

    def read(self) -> int:
        """The stored stamp; 0 where there is none. ConfigError for a file that is none."""
        try:
            return int(read_text(self._path))
        except FileNotFoundError:
            return 0
        except (OSError, ValueError) as error:
            raise ConfigError([f"{self._path}: no stamp of signed packets: delete it and rotate the keys"]) from error

    def store(self, newest: int) -> None:
        """Store a stamp with its margin; an older one than is stored changes nothing. OSError."""
        if newest + self._MARGIN // 2 > self._stored:
            self._stored = max(newest + self._MARGIN, self.read())
            write_private(self._path, str(self._stored).encode())
