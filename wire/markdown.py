"""A Markdown table as data: what is printed for people, for scripts."""


def rows(table: str) -> list[dict[str, str]]:
    """Each row of the table by the names of its columns, code marks left out."""
    lines = [[cell.strip().replace("`", "") for cell in line.strip()[1:-1].split("|")] for line in table.splitlines()]
    names, _, *cells = lines
    return [dict(zip(names, row, strict=True)) for row in cells]
