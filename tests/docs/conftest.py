"""What makes the manual's reference is a module of its own, beside the manual."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "docs" / "manual" / "_ext"))
