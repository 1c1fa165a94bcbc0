"""Every reason is given as many values as its text names."""

import ast
import string
from pathlib import Path

from formation.reasons import Reason

ROOT = Path(__file__).parents[2]


def test_every_reason_is_given_the_values_that_its_text_names() -> None:
    given: dict[str, set[int]] = {}
    for path in (file for package in ("formation", "gcs") for file in (ROOT / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            match node:
                case ast.Call(ast.Attribute(ast.Attribute(ast.Name("Reason"), name), "of"), args):
                    given.setdefault(name, set()).add(len(args))
    assert given == {reason.name: {_values(reason.template)} for reason in Reason}


def _values(template: str) -> int:
    """How many values a text names, one of them twice where it is numbered so."""
    fields = [field for _, field, _, _ in string.Formatter().parse(template) if field is not None]
    return len({field or k for k, field in enumerate(fields)})


def test_reasons_of_the_same_text_are_told_apart() -> None:
    assert Reason.LOG.of("the disk is full").text == "the log: the disk is full"
    assert Reason.NO_SHAPE is not Reason.NO_TRANSITION
    assert len({reason.code for reason in Reason}) == len(Reason)
