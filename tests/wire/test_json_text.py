"""JSON from outside is bounded: no text of any kind ends who reads it."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wire.text import DEEPEST, MOST_CHARACTERS, JsonError, parse_json, parse_object


@pytest.mark.parametrize(
    "text",
    [
        "[" * 5000,
        "[" * 5000 + "]" * 5000,
        '{"a":' * 200_000,
        "[" * (DEEPEST + 1) + "]" * (DEEPEST + 1),
        "NaN", "-Infinity", "1e999", "1E+400", "-1.5e0400", "9" * 250 + "e99", "9" * 5000, "1" * 20, "-" + "1" * 20,
        "", "nothing", b"\xff\xfe", '"' + "a" * MOST_CHARACTERS + '"',
    ],
    ids=lambda text: repr(text[:12]),
)  # fmt: skip
def test_what_is_none_of_ours_is_refused_in_words(text):
    with pytest.raises(JsonError):
        parse_json(text)


def test_brackets_in_texts_nest_nothing():
    assert parse_json(json.dumps(["[" * 5000, '\\"[']))[0] == "[" * 5000


def test_an_object_is_asked_for_and_nothing_else_taken():
    assert parse_object(b'{"phase": "GROUND"}') == {"phase": "GROUND"}
    with pytest.raises(JsonError, match="no JSON object"):
        parse_object("[1]")


@given(st.recursive(st.none() | st.booleans() | st.integers(-(2**62), 2**62) | st.floats(allow_nan=False,
    allow_infinity=False) | st.text(), lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner), max_leaves=20)
)  # fmt: skip
def test_our_own_json_reads_as_python_reads_it(value):
    text = json.dumps(value)
    assert parse_json(text) == json.loads(text)
