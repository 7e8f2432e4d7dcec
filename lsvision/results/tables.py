"""Rows of cells as lines of text."""

from collections.abc import Sequence

Cells = Sequence[Sequence[str]]
"""Rows of a table, each a sequence of cells."""


def format_text_table(rows: Cells, left: int = 0) -> list[str]:
    r"""Return rows of cells as lines, the columns aligned and two spaces between them.

    The first `left` columns are aligned to the left, the others to the right.

    Examples
    --------
    >>> print("\n".join(format_text_table([("", "radius mm"), ("1", "19.0")])))
       radius mm
    1       19.0
    >>> format_text_table([("name", "mm"), ("a", "1.5")], left=1)
    ['name   mm', 'a     1.5']
    """
    # Not by rich: it cuts or wraps cells to the width of the terminal (80 characters in a pipe),
    # and takes brackets in file names for markup.
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        "  ".join(
            cell.ljust(width) if column < left else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    )
    return [line.rstrip() for line in lines]
