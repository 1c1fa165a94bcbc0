"""Words from outside, made harmless to print: no control character, escape sequence, line break or turned direction."""

_CONTROLS = {c: " " if chr(c).isspace() else None for c in range(0xA0) if not chr(c).isprintable()}


def plain(text: str, longest: int) -> str:
    """`text` without what a terminal or a page would act on, at most `longest` characters; white space reads as blanks.

    Only what Unicode calls printable is left: that ends ESC and C1 sequences, bidirectional overrides and zero widths.
    """
    text = text[: 4 * longest]
    if not text.isprintable():
        text = text.translate(_CONTROLS)
        if not text.isprintable():
            text = "".join(c if c.isprintable() else " " if c.isspace() else "" for c in text)
    return text if len(text) <= longest else text[: longest - 1] + "…"
