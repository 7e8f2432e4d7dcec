"""Rows of cells as lines of text."""

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
