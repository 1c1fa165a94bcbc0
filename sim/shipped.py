"""The scenarios that come with the simulator."""

import tomllib
from importlib import resources
from pathlib import Path


def shipped() -> dict[str, Path]:
    """The scenarios that come with the simulator, by name."""
    folder = Path(str(resources.files("sim"))) / "scenarios"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def about(path: Path) -> str:
    """The `about` of a scenario's file."""
    text: str = tomllib.loads(path.read_text(encoding="utf-8")).get("about", "")
    return text
