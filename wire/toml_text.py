"""A TOML file as it stands: what every reader of one does first, and waits for no model."""

import tomllib
from pathlib import Path
from typing import Any

from wire.errors import ConfigError


def read_toml(path: Path) -> dict[str, Any]:
    """The values in the file; ConfigError for one that is missing, not UTF-8, or no TOML."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError([f"{path}: {error.strerror}"]) from error
    except UnicodeDecodeError as error:
        raise ConfigError([f"{path}: not UTF-8 text"]) from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigError([f"{path}: {error}"]) from error
