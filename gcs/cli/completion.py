"""What the Tab key offers after `gcs shape` and `gcs trajectory`: names of the lab file, and those always there."""

import typer

from formation.requests import CONFIGURED
from wire.process.program import keys_of, lab_near, starting


def shapes(context: typer.Context, incomplete: str) -> list[str]:
    """The named patterns, and the shapes of the lab file."""
    from formation.guidance.patterns import PATTERNS  # loads arrays, which no command waits for

    lab = lab_near(context.params.get("lab"))
    return starting(dict.fromkeys((CONFIGURED, *PATTERNS, *keys_of(lab, "formation", "shapes"))), incomplete)


def trajectories(context: typer.Context, incomplete: str) -> list[str]:
    """The leader's trajectories in the lab file."""
    lab = lab_near(context.params.get("lab"))
    return starting((CONFIGURED, *keys_of(lab, "leader", "trajectories")), incomplete)
