"""Pages as data: sections of pictures, tables and folded parts; the templates beside this file make HTML of them.

A page is one self-contained document. Knows no flight.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from analysis.plots.style import WIDTH_IN, Drawing, Missing, described, svg

_FOLDER = Path(__file__).parent
_BEFORE_UNIT = re.compile(r"(?<=\d) (?=(?:mm|ms|m/s|m|s|rad/s|Hz)\b|%)")
_KINDS = {"#": "number", "@": "time", "~": "level", "`": "code"}
"""Of a table's columns, by the mark that their names begin with."""


@dataclass(frozen=True, slots=True)
class Row:
    """A table's row; colour: a drone's, before its first cell."""

    cells: Sequence[str]
    colour: str = ""
    alarming: bool = False


@dataclass(frozen=True, slots=True)
class Table:
    """A table of plain texts; head: the columns' names, behind a mark of _KINDS where they are no words."""

    head: Sequence[str]
    rows: Sequence[Row]

    @property
    def columns(self) -> list[tuple[str, str]]:
        """Kind and name of each column."""
        return [(_KINDS.get(name[:1], ""), name.lstrip("".join(_KINDS))) for name in self.head]


@dataclass(frozen=True, slots=True)
class Folded:
    """What is shown when its summary is clicked: a table, or a text as it is."""

    summary: str
    table: Table | None = None
    text: str = ""


Part = Table | Folded | Missing | None


@dataclass(frozen=True, slots=True)
class Section:
    """One section: an anchor, a heading, what to look for, its pictures, and what stands below them."""

    anchor: str
    title: str
    lead: str = ""
    drawings: Sequence[Drawing] = ()
    parts: Sequence[Part] = ()


def table(head: Sequence[str], rows: Iterable[Row | Sequence[str]]) -> Table | None:
    """The table of rows, or of their cells; None without any."""
    every = [row if isinstance(row, Row) else Row(row) for row in rows]
    return Table(head, every) if every else None


def mm(metres: float | None) -> str:
    """Millimetres in three digits; a dash where unknown."""
    return "–" if metres is None else f"{1e3 * metres:.3g}"


def units(words: str) -> Markup:
    """Plain text, escaped; a number keeps its unit on the same line."""
    return Markup(_BEFORE_UNIT.sub("\u00a0", str(escape(words))))


def figure(drawing: Drawing, title: str) -> Markup | None:
    """The drawing as SVG at its own scale, with what it shows in words; None where something is missing for it."""
    if isinstance(drawing, Missing):
        return None
    share = 100.0 * drawing.get_figwidth() / WIDTH_IN
    words = escape(f"{title}: {described(drawing)}")
    image = svg(drawing).replace("<svg", f'<svg role="img" aria-label="{words}"', 1)
    return Markup(f'<figure tabindex="0" style="max-width:{share:.1f}%">{image}</figure>')


def render(template: str = "page.html", **content: Any) -> str:
    """The page of a template; `page.html`: kind, title, heading, facts and sections."""
    pages = Environment(loader=FileSystemLoader(_FOLDER), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
                        lstrip_blocks=True)  # fmt: skip
    pages.filters |= {"units": units, "mm": mm}
    pages.globals |= {"figure": figure, "css": Markup((_FOLDER / "page.css").read_text(encoding="utf-8"))}
    return pages.get_template(template).render(content)
