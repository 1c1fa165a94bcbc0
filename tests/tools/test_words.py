"""No name and no sentence of the project holds a word for which its dictionary has the field's."""

from pathlib import Path

from tools.words import Dictionary, in_module, places

TOML = Path(__file__).parents[2] / "tools" / "words.toml"


def test_no_place_holds_a_word_that_the_dictionary_replaces():
    assert [f"{place.file}:{place.line}: {place.found} -> {place.field}" for place in places()] == []


def test_finds_a_word_in_a_name_a_sentence_and_a_comment(tmp_path: Path, monkeypatch):
    module = tmp_path / "astray.py"
    module.write_text(
        'def take(gate: int) -> str:\n    # what was felt\n    return "The drone hangs where it was told."\n'
    )
    monkeypatch.setattr("tools.words.ROOT", tmp_path)
    found = [place.found for place in in_module(module, Dictionary(TOML))]
    assert [name for name in found if "..." not in name] == ["module astray", "take", "gate", "# what was felt"]
    assert sum("told" in text for text in found) == 1


def test_allows_the_names_that_the_field_has():
    words = Dictionary(TOML)
    assert words.of_name("take_off_height_m") == words.of_name("KEEP_OUT") == words.of_name("_objects") == ""
    assert words.of_name("take_frame") != ""
