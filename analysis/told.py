"""JSON in a log's metadata: somebody wrote it, so it may be anything."""

import json

DEPTH_MOST = 16
"""Of tables within tables; ours have three."""


def read_json(text: str) -> object:
    """What the text says; ValueError for what is no JSON, or is nested deeper than DEPTH_MOST."""
    try:
        found: object = json.loads(text)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
    level = [found]
    for _ in range(DEPTH_MOST):
        tables = [inner for inner in level if isinstance(inner, dict | list)]
        level = [item for inner in tables for item in (inner.values() if isinstance(inner, dict) else inner)]
    if any(isinstance(inner, dict | list) for inner in level):
        raise ValueError("nested too deeply")
    return found
