"""The manual is easy to read: short pages, each with its purpose first, in the vocabulary of the field."""

import re
from pathlib import Path

import pytest

from tests.docs.manual_pages import MANUAL, name_of, pages

LONGEST_PAGE_WORDS = 1200
LONGEST_SENTENCE_WORDS = 25
LONGEST_README_LINES = 180
OPENINGS = ("After this", "Here you", "On this page", "With this manual")
PRIVATE = (
    "deaf", "slides", "sliding pose", "worn by", "weigh", "jolt", "heave", "hurried", "quietened", "astray", "reckon",
    "led on", "let go of", "sink blind", "insist", "trickle", "likeness", "taken for", "told to", "felt",
)  # fmt: skip
"""Words of the project's past that the field does not use."""
README = next(page for page in pages() if page.parent != MANUAL / "tutorials" and page.name.startswith("README"))
MANUAL_PAGES = [page for page in pages() if page != README]


def prose(page: Path) -> str:
    """What a person reads: no code, no quoted texts, no marks."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    return re.sub(r"`[^`]*`|<!--.*?-->|\]\([^)]*\)", " ", text)


@pytest.mark.parametrize("page", MANUAL_PAGES, ids=name_of)
def test_page_is_short(page: Path) -> None:
    assert len(re.findall(r"[\w'-]+", prose(page))) <= LONGEST_PAGE_WORDS


@pytest.mark.parametrize("page", MANUAL_PAGES, ids=name_of)
def test_page_opens_with_what_the_reader_can_do(page: Path) -> None:
    title, _, rest = page.read_text(encoding="utf-8").partition("\n")
    assert title.startswith("# ")
    assert rest.lstrip().startswith(OPENINGS)


@pytest.mark.parametrize("page", pages(), ids=name_of)
def test_page_keeps_to_the_vocabulary(page: Path) -> None:
    # What older texts say is named once, in the glossary, so that a reader of an old log finds it.
    text = re.sub(r"\(\*[^)]*\)", "", prose(page)).lower()
    assert [word for word in PRIVATE if re.search(rf"\b{word}\b", text)] == []


@pytest.mark.parametrize("page", pages(), ids=name_of)
def test_sentences_are_short(page: Path) -> None:
    text = re.sub(r"^([|!#>-]|\d\.).*$", "", prose(page), flags=re.MULTILINE)
    sentences = re.split(r"(?<=[.:;?!])\s|\n\s*\n|^\*\s", text, flags=re.MULTILINE)
    assert [s for s in sentences if len(re.findall(r"[\w'-]+", s)) > LONGEST_SENTENCE_WORDS] == []


def test_readme_is_short() -> None:
    assert len(README.read_text(encoding="utf-8").splitlines()) <= LONGEST_README_LINES
