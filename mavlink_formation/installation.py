"""How this was installed, so that a hint names the command that adds to it."""

import json
import os
from importlib.metadata import PackageNotFoundError, distribution

_NAME = "mavlink-formation"


def install_command(extra: str) -> str:
    """The pip command that adds an optional part: in its clone, from where it was installed from, or from the index."""
    folder = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    if os.path.exists(os.path.join(folder, "pyproject.toml")):
        return f"pip install -e '.[{extra}]' in {folder}"
    try:
        origin = json.loads(distribution(_NAME).read_text("direct_url.json") or "{}")  # PEP 610
    except PackageNotFoundError:
        origin = {}
    url = origin.get("url", "")
    if "vcs_info" in origin:
        url = f"{origin['vcs_info']['vcs']}+{url}@{origin['vcs_info']['commit_id']}"
    return f"pip install '{_NAME}[{extra}]{f' @ {url}' if url else ''}'"
