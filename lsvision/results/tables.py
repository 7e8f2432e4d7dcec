"""Rows of cells as text and as HTML; the first row is the header."""

import html
from collections.abc import Sequence

Cells = Sequence[Sequence[str]]


def text_table(rows: Cells) -> list[str]:
    r"""Return the lines of a table, every column aligned to the right.

    Examples
    --------
    >>> print("\n".join(text_table([("", "radius mm"), ("1", "19.0")])))
       radius mm
    1       19.0
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def html_table(rows: Cells) -> str:
    """Return a table as notebooks show it.

    Examples
    --------
    >>> html_table([("x mm",), ("1 < 2",)])
    '<table><thead><tr><th>x mm</th></tr></thead><tbody><tr><td>1 &lt; 2</td></tr></tbody></table>'
    """
    header, *body = rows
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in header)
    lines = ("".join(f"<td>{html.escape(cell)}</td>" for cell in row) for row in body)
    lines_html = "".join(f"<tr>{line}</tr>" for line in lines)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{lines_html}</tbody></table>"


def html_lines(lines: Sequence[str]) -> str:
    """Return lines of text as a paragraph; nothing for none."""
    return f"<p>{'<br/>'.join(map(html.escape, lines))}</p>" if lines else ""
