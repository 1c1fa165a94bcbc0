"""One file that carries an identity's keys to another computer, and the folder it becomes there."""

import json
import re
from pathlib import Path

from gcs.security.certificates import fault_of
from wire.errors import ConfigError
from wire.files import demand_absent, make_folder, read_text
from wire.security.private_keys import (
    ACCESS,
    AUTHORITY,
    AUTOPILOT,
    CERTIFICATE,
    KEY_BYTES,
    NAME,
    PRIVATE,
    REVOKED_NAMES,
    STOP_KEY,
    demand_private,
    mavlink_key_file,
    write_private,
)
from wire.text import parse_object

_FILES = {AUTHORITY, CERTIFICATE, PRIVATE, NAME, ACCESS, AUTOPILOT, REVOKED_NAMES, STOP_KEY}
_NEEDED = _FILES - {AUTOPILOT, REVOKED_NAMES, STOP_KEY}
_SIGNING = re.compile(r"mavlink-\d{1,3}\.key")
_KEY = rf"[0-9a-fA-F]{{{2 * KEY_BYTES}}}"
_IDENTITY = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,63}")


def write_bundle(path: Path, identity: str, files: dict[str, str]) -> None:
    """Write the file, its owner's alone. OSError."""
    write_private(path, json.dumps({"identity": identity, "files": files}).encode())


def install_bundle(path: Path, keys: Path, overwrite: bool = False) -> str:
    """Make the folder of the identity that the file carries; return the identity. ConfigError, OSError.

    A file open to others is refused: who could read it has the keys. So are, unless overwrite, other keys of the
    identity that are there; its rules are replaced.
    """
    identity, files = _parse(path)
    make_folder(keys)
    demand_private(keys)
    own = keys / identity
    make_folder(own)
    demand_private(own)
    for name, text in files.items():
        path = own / name
        if name not in (ACCESS, REVOKED_NAMES) and not (path.is_file() and read_text(path) == text):
            demand_absent(path, overwrite)
    for name, text in files.items():
        write_private(own / name, text.encode())
    return identity


def bundle_identity(path: Path) -> str:
    """Whose keys the file carries. ConfigError."""
    return _parse(path)[0]


def _parse(path: Path) -> tuple[str, dict[str, str]]:
    """Whole and right, or ConfigError: what is not would take the place of keys that are."""
    demand_private(path)
    try:
        values = parse_object(read_text(path))
        identity, files = values["identity"], values["files"]
        names = set(files)
        right = (
            _IDENTITY.fullmatch(identity) is not None
            and names >= _NEEDED
            and all(name in _FILES or _SIGNING.fullmatch(name) for name in names)
            and all(isinstance(text, str) and text.isascii() for text in files.values())
        )
    except (OSError, ValueError, KeyError, TypeError):
        right = False
    if not right:
        raise ConfigError([f"{path}: not a file of `gcs keys pack`"])
    fault = _fault(identity, files)
    if fault:
        raise ConfigError([f"{path}: nothing is installed: {fault}: run `gcs keys pack {identity}` again"])
    return identity, files


def _fault(identity: str, files: dict[str, str]) -> str:
    for name, text in files.items():
        if name.endswith(".key") and re.fullmatch(_KEY, text.strip()) is None:
            return f"{name} is not a key of {2 * KEY_BYTES} hexadecimal digits"
    try:
        parse_object(files[ACCESS])
    except ValueError as error:
        return f"{ACCESS}: {error}"
    if files[NAME].strip().rpartition(".")[0] != identity:
        return f"{NAME} is not one of {identity}"
    drones = [key for key in files if _SIGNING.fullmatch(key)]
    if identity.startswith("drone-") and drones != [mavlink_key_file(int(identity.removeprefix("drone-")))]:
        return f"no signing key of {identity} alone: `gcs keys rotate {identity}` makes one"
    return fault_of(files[AUTHORITY], files[CERTIFICATE], files[PRIVATE], files[NAME].strip())
