"""A TOML file as it stands: what every reader of one does first, and waits for no model."""

import tomllib
from pathlib import Path
from typing import Any

from wire.errors import ConfigError
from wire.small_files import read_text


def read_toml(path: Path) -> dict[str, Any]:
    """The values in the file; ConfigError for one that is missing, not UTF-8, or no TOML."""
    try:
        return tomllib.loads(read_text(path))
    except OSError as error:
        raise ConfigError([f"{path}: {error.strerror}"]) from error
    except RecursionError as error:
        raise ConfigError([f"{path}: nested too deeply"]) from error
    except ValueError as error:  # no file that can be read, or no TOML
        raise ConfigError([f"{path}: {error}"]) from error
