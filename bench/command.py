"""What the command lines of these programs share."""

from math import isfinite
from typing import Annotated

import typer

FAILED = 1
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else there.")]
Seeds = Annotated[int, typer.Option(min=1, help="How many seeds, from 1.")]
Only = Annotated[list[str] | None, typer.Option(help="Fly this controller; can be given again.")]
Vehicle = Annotated[str, typer.Option(help="What is flown: a shipped vehicle's name, or a profile's TOML file.")]


def without_nan(value: object) -> object:
    """The same with None for NaN and infinity, which JSON does not have."""
    if isinstance(value, dict):
        return {key: without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [without_nan(item) for item in value]
    return None if isinstance(value, float) and not isfinite(value) else value
