"""Texts from outside: words made harmless, JSON bounded."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from formation.messages import Severity
from wire.link_messages import GROUND, Address, NamedValue, StatusText
from wire.mavlink.codec import Codec
from wire.mavlink.framing import packed
from wire.mavlink.text import LONGEST_READ
from wire.text import DEEPEST, MOST_CHARACTERS, JsonError, parse_json, parse_object, plain

HARMFUL = {
    "\x1b[2Jgone": "[2Jgone",
    "a\x9b31mred": "a31mred",
    "one\ntwo\r\nthree\ttabs": "one two  three tabs",
    "right \u202eto left\u202c": "right to left",
    "iso\u2066lated\u2069 \u200bzero \ufeffwidth": "isolated zero width",
    "lines\u2028and\u2029more": "lines and more",
    "nul\0s and \x07bells": "nuls and bells",
}


@pytest.mark.parametrize(("said", "left"), HARMFUL.items())
def test_what_a_terminal_would_act_on_is_taken_out(said: str, left: str) -> None:
    assert plain(said, 100) == left


@pytest.mark.parametrize("said", ["Prearm: [/] not a tag", "Fühler 3 §!", "雷达", ""])
def test_words_stay_as_they_are(said: str) -> None:
    assert plain(said, 100) == said


def test_a_long_text_is_cut_and_says_so() -> None:
    assert plain("x" * 11, 10) == "x" * 9 + "…"
    assert len(plain("\x1b" * 10_000_000 + "x", 10)) == 0


def test_what_a_drone_says_reaches_nobody_unstripped() -> None:
    drone, codec = Codec(Address(7, 1)), Codec(GROUND)
    texts = [StatusText(Severity.INFO, said) for said in HARMFUL if "\0" not in said]
    read = [packet.message for text in texts for packet in codec.receive(drone.encode(text))]
    assert read == [StatusText(Severity.INFO, left) for said, left in HARMFUL.items() if "\0" not in said]
    (named,) = codec.receive(drone.encode(NamedValue(0, "age\x1bms\n", 1.0)))
    assert named.message == NamedValue(0, "agems ", 1.0)


def test_a_text_that_does_not_end_is_neither_kept_nor_shown_whole() -> None:
    drone, codec = Codec(Address(7, 1)), Codec(GROUND)
    data = drone.encode(StatusText(Severity.INFO, "x" * 12_000))
    packets = [packet for datagram in packed(data) for packet in codec.receive(datagram)]
    assert [len(packet.message.text) for packet in packets] == [LONGEST_READ]


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
