"""How a lab was rehearsed last: a small file beside the lab file, written by `gcs rehearse`, shown by the page."""

import hashlib
from pathlib import Path

from formation.config import LabConfig
from formation.model import Model
from wire.config_file import dump, load
from wire.errors import ConfigError


class Rehearsal(Model):
    """One rehearsal. lab: which configuration was flown; date: local, ISO 8601; passed: it landed as it should."""

    lab: str
    date: str
    passed: bool
    folder: str


def record(lab_file: Path, config: LabConfig, date: str, passed: bool, folder: Path) -> None:
    """Write down a rehearsal in the place of the last one; OSError, ConfigError where another file has its name."""
    if _beside(lab_file).exists() and recorded(lab_file) is None:
        raise ConfigError([f"{_beside(lab_file)}: it is there already, and no record of a rehearsal"])
    rehearsal = Rehearsal(lab=lab_name(config), date=date, passed=passed, folder=str(folder))
    _beside(lab_file).write_text(dump(rehearsal), encoding="utf-8")


def recorded(lab_file: Path) -> Rehearsal | None:
    """The last rehearsal that was written down; None where there is none that can be read."""
    try:
        return load(_beside(lab_file), Rehearsal)
    except ConfigError:
        return None


def _beside(lab_file: Path) -> Path:
    return lab_file.with_name(f"{lab_file.stem}-rehearsal.toml")


def lab_name(config: LabConfig) -> str:
    """A short name for all that a lab's configuration says."""
    return hashlib.sha256(config.model_dump_json().encode()).hexdigest()[:16]
