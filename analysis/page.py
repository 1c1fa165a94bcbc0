"""Pieces of an HTML page: escaping, figures, tables, one self-contained document. Knows no flight."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from analysis.plots.style import WIDTH_IN, Drawing, Missing, described, svg

_CSS = Path(__file__).with_name("page.css")
_BEFORE_UNIT = re.compile(r"(?<=\d) (?=(?:mm|ms|m/s|m|s|rad/s|Hz)\b|%)")


@dataclass(frozen=True, slots=True)
class Section:
    """One section: an anchor, a heading, what to look for, and its finished HTML parts."""

    anchor: str
    title: str
    lead: str
    parts: tuple[str, ...]

    def html(self) -> str:
        """The section's markup."""
        lead = f'<p class="lead">{text(self.lead)}</p>' if self.lead else ""
        return f'<section id="{self.anchor}"><h2>{escape(self.title)}</h2>{lead}{"".join(self.parts)}</section>'


def text(words: str) -> str:
    """Plain text, escaped; a number keeps its unit on the same line."""
    return _BEFORE_UNIT.sub("\u00a0", escape(words))


def picture(drawing: Drawing, title: str) -> str:
    """The drawing embedded as SVG at its own scale, with what it shows in words, or what is missing for it."""
    if isinstance(drawing, Missing):
        return f'<p class="missing">Not shown: {text(drawing.reason)}.</p>'
    share = 100.0 * drawing.get_figwidth() / WIDTH_IN
    image = _spoken(svg(drawing), f"{title}: {described(drawing)}")
    return f'<figure tabindex="0" style="max-width:{share:.1f}%">{image}</figure>'


def _spoken(image: str, words: str) -> str:
    """The SVG with its alternative text."""
    return image.replace("<svg", f'<svg role="img" aria-label="{escape(words, quote=True)}"', 1)


def table(head: Sequence[str], rows: Iterable[str]) -> str:
    """A table of finished rows; head cells starting with `#` are set right, over numbers."""
    cells = "".join(
        f'<th class="number">{escape(name[1:])}</th>' if name.startswith("#") else f"<th>{escape(name)}</th>"
        for name in head
    )
    return f'<div class="scroll"><table><thead><tr>{cells}</tr></thead><tbody>{"".join(rows)}</tbody></table></div>'


def row(*cells: str, alarming: bool = False) -> str:
    """A table row of finished cells."""
    kind = ' class="alarming"' if alarming else ""
    return f"<tr{kind}>{''.join(cells)}</tr>"


def cell(words: str, kind: str = "") -> str:
    """A table cell of plain text; kind is a class of the style sheet."""
    named = f' class="{kind}"' if kind else ""
    return f"<td{named}>{text(words)}</td>"


def swatch(words: str, colour: str) -> str:
    """A table cell that begins with a drone's colour."""
    return f'<td><i style="background:{colour}"></i>{escape(words)}</td>'


def tile(value: str, unit: str, label: str) -> str:
    """A number set large."""
    return f'<div class="tile"><b>{escape(value)} <small>{escape(unit)}</small></b><span>{text(label)}</span></div>'


def document(title: str, body: str) -> str:
    """The whole page, nothing fetched from anywhere."""
    css = _CSS.read_text(encoding="utf-8")
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{escape(title)}</title>'
        f"<style>{css}</style></head>\n<body><main>{body}</main></body></html>\n"
    )
