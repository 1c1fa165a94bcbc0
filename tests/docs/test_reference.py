"""What the manual's pages say of the code is what the code says today, and stands in the pages themselves."""

from tests.docs.manual_pages import MANUAL, name_of
from tools.reference.__main__ import reference
from tools.reference.pieces import END, filled

EMPTY = "# Codes\n\n<!-- generated: exit-codes -->\n\nOurs.\n\n<!-- generated: extras -->\n\nOurs, too.\n"


def test_what_is_generated_is_fresh() -> None:
    stale = [name_of(file) for file, text in reference() if not file.exists() or file.read_text("utf-8") != text]
    assert stale == [], "write them by `make reference`"


def test_what_is_stale_is_replaced_and_what_a_person_wrote_stays() -> None:
    page = filled(EMPTY)
    assert [part.strip() for part in page.split(END)[1:]][1] == "Ours, too."
    assert page.split(END)[1].startswith("\n\nOurs.\n\n<!-- generated: extras -->\n\n|")
    assert filled(page.replace("| `gcs` |", "| `old` |").replace(f"\n{END}", f"more\n\n{END}")) == page


def test_no_page_is_made_while_the_manual_is_built() -> None:
    """A code host would show the order for it instead."""
    pages = (page for page in MANUAL.rglob("*.md") if "_build" not in page.parts)
    assert [name_of(page) for page in pages if "{eval-rst}" in page.read_text("utf-8")] == []
