"""A lab with keys in a folder, made once for a test session of real links."""

from datetime import UTC, datetime
from pathlib import Path

from formation.config import LabConfig
from gcs.security.key_folder import KeyFolder

OPERATORS = {"anna": "operator", "board": "viewer", "judge": "safety"}
LAB = {
    "name": "lab",
    "leader": {"body": "lead", "sysid": 1},
    "followers": [
        {"body": "left", "sysid": 2, "offset_m": [-0.5, 0.5, 0.0]},
        {"body": "right", "sysid": 3, "offset_m": [-0.5, -0.5, 0.0]},
    ],
    "security": {"operators": OPERATORS},
}
NOW = datetime(2026, 11, 25, 12, 0, tzinfo=UTC)


def keyed_lab(folder: Path, values: dict[str, object] = LAB) -> tuple[LabConfig, KeyFolder]:
    """The lab and its new keys, in `folder`/keys; dated now, since the links check it."""
    config = LabConfig.model_validate(values)
    keys = KeyFolder(config, folder / "lab.toml")
    keys.make(datetime.now(UTC))
    return config, keys
