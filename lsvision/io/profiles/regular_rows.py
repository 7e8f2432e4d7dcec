"""Regular rows of numbers in a text, parsed all at once: most files contain nothing else."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray
from lsvision.io.profiles.text_layout import (
    MAX_PREAMBLE_LINES,
    SAMPLE_LINES,
    Layout,
    find_layout,
    may_state_size,
)

_HEAD_LINES = MAX_PREAMBLE_LINES + 2 * SAMPLE_LINES + 2
"""Number of lines that decide on the layout of a text without a footer."""
_CELL_BYTES = b"0123456789.+-eEnaNA"
"""Characters of numbers and of nan."""
_BLOCK_LENGTH = 1 << 16
"""Text that is parsed at once, small enough for the cache. Units: characters."""


@dataclass(frozen=True, eq=False)
class _RegularRows:
    """A table that ends with its text and holds numbers only, and the lines above it.

    The layout's `stop` counts the lines at the beginning of the text only. Values, (n, k), are NaN
    where a cell is empty or nan.
    """

    above: list[str]
    rows: str
    layout: Layout
    values: FloatArray

    def read_column(self, column: int) -> list[str]:
        """Return the cells of a column as they stand in the text, without blanks around them."""
        separator, width = self.layout.separator, self.layout.width
        rows = self.rows.replace("\r\n", "\n").replace("\n", separator or "\n")
        cells = rows.split(separator)[column : width * len(self.values) : width]
        return [cell.strip() for cell in cells]


def find_regular_rows(text: str) -> _RegularRows | None:
    r"""Return the table of a text whose lines, from the first numbers on, have the same layout.

    None for every other text (other words, quotes, decimal commas, comments or empty lines among
    the numbers, blanks that align columns, a footer), which is then read line by line.

    Examples
    --------
    >>> find_regular_rows("x,z\n1.5,-2\n2,\n").values.tolist()
    [[1.5, -2.0], [2.0, nan]]
    >>> find_regular_rows("x;z\n1,5;-2\n2;0\n") is None
    True
    """
    head = _read_head(text)
    lines = head.splitlines()
    try:
        layout = find_layout(lines)
    except UnreadableFile:
        return None
    if layout.separator == "|" or not (head == text or _is_layout_of_all(layout, lines)):
        return None
    above = head.splitlines(keepends=True)[: layout.first]
    rows = text[sum(map(len, above)) :]
    values = _parse_regular_rows(rows, layout.separator or " ", layout.width)
    return None if values is None else _RegularRows(lines[: layout.first], rows, layout, values)


def _parse_regular_rows(rows: str, separator: str, width: int) -> FloatArray | None:
    """Return the numbers of lines, at least one, with `width` cells each; None if anything else.

    Empty lines at the end are left out.
    """
    if not rows.isascii():
        return None
    if "\r" in rows:
        rows = rows.replace("\r\n", "\n")
    block_values = []
    for block in _iterate_blocks(rows):
        values = _parse_block(block, separator, width)
        if values is None and separator != " ":  # two blanks separate cells like one
            values = _parse_block(fill_empty_cells(block, separator), separator, width)
        if values is None:
            return None
        block_values.append(values)
    table = np.concatenate(block_values)
    table[np.isinf(table)] = np.nan
    return table


def fill_empty_cells(rows: str, separator: str) -> str:
    r"""Return lines with nan in their empty cells.

    Examples
    --------
    >>> fill_empty_cells("1,,,\n,2,3,4", ",")
    '1,nan,nan,nan\nnan,2,3,4'
    """
    text = f"\n{rows}\n"
    for _ in range(2):  # the second of two empty cells is found in the second pass
        text = text.replace(separator * 2, f"{separator}nan{separator}")
    text = text.replace(f"{separator}\n", f"{separator}nan\n")
    return text.replace(f"\n{separator}", f"\nnan{separator}")[1:-1]


def _read_head(text: str) -> str:
    """Return the first lines of a text, as many as decide on its layout; a short one is whole."""
    if len(text) <= _BLOCK_LENGTH:
        return text
    end = 0
    for _ in range(_HEAD_LINES):
        end = text.find("\n", end) + 1
        if end == 0:
            return text
    return text[:end]


def _is_layout_of_all(layout: Layout, lines: list[str]) -> bool:
    """Return whether the lines behind the head cannot change the layout, if they are regular."""
    return (
        layout.first < MAX_PREAMBLE_LINES
        and layout.first + 2 * SAMPLE_LINES < len(lines)
        and not any(
            may_state_size(line, layout.separator)
            for line in lines[max(layout.first - 1, 0) : layout.first + 1]
        )
    )


def _iterate_blocks(rows: str) -> Iterator[str]:
    """Yield whole lines, some `_BLOCK_LENGTH` characters at a time, without empty ones at last."""
    start, end = 0, len(rows)
    while end > 0 and rows[end - 1] in " \r\n":
        end -= 1
    while start < end:
        stop = rows.find("\n", start + _BLOCK_LENGTH, end)
        stop = end if stop < 0 else stop
        yield rows[start:stop]
        start = stop + 1


def _parse_block(block: str, separator: str, width: int) -> FloatArray | None:
    """Return the numbers of some lines; None where they are not `width` numbers each.

    What remains of the lines without the characters of numbers must be the separators alone.
    """
    content, mark = block.encode(), separator.encode()
    marks = content.translate(None, _CELL_BYTES if separator in " \t" else _CELL_BYTES + b" ")
    if marks + b"\n" != (mark * (width - 1) + b"\n") * (marks.count(b"\n") + 1):
        return None
    # numpy needs more time for a line than for a cell
    joined = content.translate(bytes.maketrans(b"\n", mark)).decode()
    try:
        return np.loadtxt([joined], delimiter=separator, comments=None).reshape(-1, width)
    except ValueError:
        return None
