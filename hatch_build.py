"""Writes the commit into the wheel, where no git can be asked any more."""

import sys
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CommitHook(BuildHookInterface[Any]):
    """Adds wire/commit.txt; an editable install asks git itself."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Called by hatchling before it builds."""
        sys.path.insert(0, self.root)
        from wire.version import commit

        sys.path.pop(0)
        if version != "editable":
            file = Path(mkdtemp()) / "commit.txt"
            file.write_text(commit() + "\n", encoding="utf-8")
            build_data["force_include"][str(file)] = "wire/commit.txt"
