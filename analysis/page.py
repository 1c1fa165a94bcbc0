"""Pieces of an HTML page: escaping, figures, tables, one self-contained document. Knows no flight."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from analysis.plots.style import Drawing, Missing, svg

_CSS = Path(__file__).with_name("page.css")


@dataclass(frozen=True, slots=True)
class Section:
    """One section: an anchor, a heading, what to look for, and its finished HTML parts."""

    anchor: str
    title: str
    lead: str
    parts: tuple[str, ...]

    def html(self) -> str:
        """The section's markup."""
        lead = f'<p class="lead">{escape(self.lead)}</p>' if self.lead else ""
        return f'<section id="{self.anchor}"><h2>{escape(self.title)}</h2>{lead}{"".join(self.parts)}</section>'


def picture(drawing: Drawing, *, narrow: bool = False) -> str:
    """The drawing embedded as SVG, or what is missing for it."""
    if isinstance(drawing, Missing):
        return f'<p class="missing">Not shown: {escape(drawing.reason)}.</p>'
    return f"<figure{' class=narrow' if narrow else ''}>{svg(drawing)}</figure>"


def table(head: Sequence[str], rows: Iterable[str]) -> str:
    """A table of finished rows; head cells starting with `#` are set right, over numbers."""
    cells = "".join(
        f'<th class="number">{escape(h[1:])}</th>' if h.startswith("#") else f"<th>{escape(h)}</th>" for h in head
    )
    return f'<div class="scroll"><table><thead><tr>{cells}</tr></thead><tbody>{"".join(rows)}</tbody></table></div>'


def row(*cells: str, alarming: bool = False) -> str:
    """A table row of finished cells."""
    return f"<tr{' class=alarming' if alarming else ''}>{''.join(cells)}</tr>"


def cell(text: str, kind: str = "") -> str:
    """A table cell of plain text; kind is a class of the style sheet."""
    return f"<td{f' class={kind}' if kind else ''}>{escape(text)}</td>"


def swatch(text: str, colour: str) -> str:
    """A table cell that begins with a drone's colour."""
    return f'<td><i style="background:{colour}"></i>{escape(text)}</td>'


def tile(value: str, unit: str, label: str) -> str:
    """A number set large."""
    return f'<div class="tile"><b>{escape(value)} <small>{escape(unit)}</small></b><span>{escape(label)}</span></div>'


def document(title: str, body: str) -> str:
    """The whole page, nothing fetched from anywhere."""
    css = _CSS.read_text(encoding="utf-8")
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{escape(title)}</title>'
        f"<style>{css}</style></head>\n<body><main>{body}</main></body></html>\n"
    )
