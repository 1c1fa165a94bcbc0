"""Writes what the manual says of the code into its pages: `make reference`.

It is part of the pages, so that they can be read on a code host too; `tests/docs/test_reference.py` holds them fresh.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

from tools.reference.drawing import frame_path
from tools.reference.pieces import filled
from tools.reference.texts import ROOT

MANUAL = ROOT / "docs" / "manual"


def reference() -> Iterator[tuple[Path, str]]:
    """Every file that has something generated, and its text as it should be."""
    sys.path.insert(0, str(ROOT / "examples" / "own_package"))
    yield MANUAL / "_static" / "frame-path.svg", frame_path()
    for page in sorted(MANUAL.rglob("*.md")):
        text = page.read_text(encoding="utf-8")
        if "<!-- generated: " in text:
            yield page, filled(text)


def main() -> None:
    """Write the files that are not fresh."""
    for file, text in reference():
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")
            print(f"written: {file.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
