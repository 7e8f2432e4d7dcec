"""A table of numbers in a text file: encoding, layout, header, statements and numbers."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray
from lsvision.io.profiles.number_table import (
    MIN_GROUPED_CELLS,
    POINT_NUMBER,
    InvalidCell,
    NumberTable,
    parse_column,
    uses_decimal_comma,
)
from lsvision.io.profiles.regular_rows import fill_empty_cells, find_regular_rows
from lsvision.io.profiles.spelled_cells import find_spellings
from lsvision.io.profiles.text_header import Header, read_header
from lsvision.io.profiles.text_layout import (
    Layout,
    drop_blank_cells,
    find_layout,
    is_comment,
    split_cells,
)
from lsvision.io.profiles.unit_statements import (
    MAX_MENTION_LINES,
    find_lost_values,
    find_unit_statements,
)

_COMMENT_STARTS = "#%/! \t"  # first characters of comments: a quick test before `is_comment`
# Cells of digits of which the second begins with 0, such as 12,034: it was one number.
_SPLIT_COMMA = re.compile(r"(?:^|,)[-+]?[0-9]{1,3},0[0-9]+(?=[,.\r\n]|$)", re.MULTILINE)
# A number with a point before three digits, such as 1.234, and a whole one without a separator.
_THOUSANDS_POINT = re.compile(r"[-+]?[1-9][0-9]{0,2}\.[0-9]{3}")
_WHOLE = re.compile(r"[-+]?[0-9]{1,3}")
_WHOLE_NUMBER = re.compile(r" ?[-+]?[0-9]+")
"""Whole number, also after a blank."""
MIN_DECIMALS = 3
"""Smallest number of different decimals of the heights in a table split at decimal commas."""
_SPLIT_NUMBERS = (
    "numbers seem to be split at their commas ({cells!r}): export with semicolons between cells "
    "and without thousands separators"
)
"""Message for numbers with decimal commas in a table separated by commas."""
_HEAD_LENGTH = 4000
"""Characters in which the factor is searched that MATLAB displays above numbers, 1.0e+03 *."""
_MATLAB_FACTOR = re.compile(r"^[ \t]*(1\.0e[-+][0-9]+)[ \t]*\*[ \t]*\r?$", re.MULTILINE)
"""Line of such a factor."""
_DASH = re.compile(r"(?<![^\s,;|\"])\u2013(?=[0-9.])")  # of a negative number
# A comment behind the numbers of a line.
_BEHIND_NUMBERS = re.compile(r"^([-+0-9.,;|eE \t]*[0-9])[ \t]+#.*$", re.MULTILINE)
_SAMPLE_ROWS = 5000
"""Number of rows that are searched for numbers split at their commas."""
_MIN_TEXT_FRACTION = 0.5
"""Fraction of the filled cells that are not numbers, above which a column is text."""


def parse_table(text: str, lost_words: frozenset[str] = frozenset()) -> NumberTable:
    r"""Return the table of numbers in a text; `lost_words`, in lower case, mark lost points.

    Raises
    ------
    UnreadableFile
        If there is no table of numbers, its lines differ in layout, its numbers seem to be split at
        their commas, or MATLAB displayed them over a factor.

    Examples
    --------
    >>> parse_table("x [mm];z [mm]\n1,5;-2\n2,0;").values.tolist()
    [[1.5, -2.0], [2.0, nan]]
    """
    text = text.replace("\u2212", "-")  # typographic minus sign
    text = _DASH.sub("-", text) if "\u2013" in text else text
    factor = _MATLAB_FACTOR.search(text[:_HEAD_LENGTH])
    if factor:
        raise UnreadableFile(
            f"its numbers are displayed by MATLAB over a factor of {factor[1]}: write them with "
            "writematrix"
        )
    body = _read_regular_body(text)
    if body is None:
        text = _BEHIND_NUMBERS.sub(r"\1", text) if "#" in text else text
        body = _read_irregular_body(text.splitlines(), lost_words)
    table, layout = body.table, body.layout
    width = table.values.shape[1]
    while width > 2 and _is_empty(table, width - 1):
        width -= 1
    values = table.values[:, :width]
    header = read_header(body.above, layout.separator, width)
    _check_split_numbers(header, values, body.sample, layout)
    _check_thousands_points(body.sample, layout)
    other_lines = [*body.above, *body.below, *body.comments]
    return NumberTable(
        values=values,
        names=header.names,
        units=header.units,
        statements=find_unit_statements(other_lines),
        texts=table.texts,
        invalid_cells=table.invalid_cells,
        spellings=find_spellings(table, header.names, body.read_column),
        lost=find_lost_values(other_lines),
        notes=_describe_footer(body.below),
        mentions=tuple(other_lines[:MAX_MENTION_LINES]),
    )


@dataclass(frozen=True, eq=False)
class _Body:
    """Numbers of a text, and its lines above, below and (`comments`) among them.

    `sample` is the text of the first rows, which is searched for thousands separators;
    `read_column` returns the cells of a column as they stand in it.
    """

    table: NumberTable
    layout: Layout
    above: Sequence[str]
    sample: str
    read_column: Callable[[int], list[str]]
    below: Sequence[str] = ()
    comments: Sequence[str] = ()


def _read_regular_body(text: str) -> _Body | None:
    """Return the body of a text that ends with regular rows of numbers; else None."""
    regular = find_regular_rows(text)
    if regular is None:
        return None
    sample = "\n".join(regular.rows.split("\n", _SAMPLE_ROWS)[:_SAMPLE_ROWS])
    return _Body(
        NumberTable(regular.values), regular.layout, regular.above, sample, regular.read_column
    )


def _read_irregular_body(lines: Sequence[str], lost_words: frozenset[str]) -> _Body:
    """Return the table of a text with blank lines, comments, words or a footer."""
    layout = find_layout(lines)
    table = _parse_numeric_table(lines, layout)
    if table is None:
        table = _parse_mixed_table(lines, layout, lost_words)
    rows = lines[layout.first : layout.stop]  # there may be 10^6 of them
    return _Body(
        table,
        layout,
        above=lines[: layout.first],
        sample="\n".join(rows[:_SAMPLE_ROWS]),
        read_column=partial(_read_column, lines, layout),
        below=lines[layout.stop :],
        comments=[line for line in rows if line[:1] in _COMMENT_STARTS and is_comment(line)],
    )


def _select_number_lines(lines: Sequence[str], layout: Layout) -> list[tuple[int, str]]:
    """Return number and text of each line of numbers; empty lines and comments are left out."""
    # a tab at the end of a line precedes an empty cell: strip blanks only
    strip = " \r\n" if layout.separator == "\t" else None
    rows = (
        (number, line.strip(strip))
        for number, line in enumerate(lines[layout.first : layout.stop], layout.first + 1)
    )
    return [(number, row) for number, row in rows if row and not is_comment(row)]


def _parse_numeric_table(lines: Sequence[str], layout: Layout) -> NumberTable | None:
    """Return the table if numpy can read all its cells as numbers; else None.

    Infinity becomes NaN, as in `parse_column`.
    """
    if layout.separator == "|" or len(layout.numeric) < layout.width:
        return None
    rows = [row for _, row in _select_number_lines(lines, layout)]
    if layout.separator is not None:
        rows = fill_empty_cells("\n".join(rows), layout.separator).split("\n")
    try:
        values = np.loadtxt(rows, delimiter=layout.separator, comments=None, ndmin=2)
    except ValueError:  # lost words, decimal commas, quotes, or a broken line
        return None
    values[np.isinf(values)] = np.nan
    return NumberTable(values)


def _parse_mixed_table(
    lines: Sequence[str], layout: Layout, lost_words: frozenset[str]
) -> NumberTable:
    """Return a table in which some cells are not numbers: words, marks of lost points, times.

    A column of which most cells are text is in `texts`, unless its first one is a number with
    thousands separators.
    """
    rows = _select_number_lines(lines, layout)
    cells = _split_rows(rows, layout)
    columns = [[row[c] for row in cells] for c in range(layout.width)]
    decimal_comma = uses_decimal_comma([columns[c] for c in layout.numeric])
    values = np.full((len(cells), layout.width), np.nan)
    texts: dict[int, Sequence[str]] = {}
    invalid_cells: dict[int, InvalidCell] = {}
    for c, column in enumerate(columns):
        parsed = parse_column(column, decimal_comma=decimal_comma, lost_words=lost_words)
        values[:, c] = parsed.values
        if parsed.first_invalid is not None:
            invalid = parsed.first_invalid
            filled = sum(bool(cell.strip()) for cell in column)
            if parsed.invalid_count > _MIN_TEXT_FRACTION * filled and not invalid.grouped:
                texts[c] = [cell.strip() for cell in column]
            line_number, _ = rows[invalid.row]
            invalid_cells[c] = replace(invalid, row=line_number)
    return NumberTable(values, texts=texts, invalid_cells=invalid_cells)


def _split_rows(rows: Sequence[tuple[int, str]], layout: Layout) -> list[list[str]]:
    """Return the cells of each row, without a comment behind them.

    A missing last cell is added as empty if the first row ends with a separator.

    Raises
    ------
    UnreadableFile
        If a row has another number of cells than the table has columns.
    """
    separator, width = layout.separator, layout.width
    cells = []
    for number, row in rows:
        row_cells = split_cells(row, separator)
        if len(row_cells) > width and "#" in row:
            row_cells = split_cells(re.sub(r"\s+#.*$", "", row), separator)
        drop_blank_cells(row_cells, width)
        if len(row_cells) == width - 1 and _ends_with_separator(rows, separator):
            row_cells.append("")
        if len(row_cells) != width:
            raise UnreadableFile(
                f"line {number} has {len(row_cells)} cells, expected {width} "
                f"({row[:40]!r}): write the same columns in each line, no decimal commas or "
                "thousands separators among commas"
            )
        cells.append(row_cells)
    return cells


def _read_column(lines: Sequence[str], layout: Layout, column: int) -> list[str]:
    """Return the cells of a column as they stand in the text, without blanks around them."""
    rows = _split_rows(_select_number_lines(lines, layout), layout)
    return [cells[column].strip() for cells in rows]


def _ends_with_separator(rows: Sequence[tuple[int, str]], separator: str | None) -> bool:
    """Return whether the first line ends with a separator: its last column may be empty."""
    return separator is not None and rows[0][1].endswith(separator)


def _is_empty(table: NumberTable, column: int) -> bool:
    """Return whether a column has neither numbers nor text."""
    return (
        column not in table.texts
        and column not in table.invalid_cells
        and bool(np.isnan(table.values[:, column]).all())
    )


def _check_split_numbers(header: Header, values: FloatArray, sample: str, layout: Layout) -> None:
    """Raise an error if numbers were split at decimal commas or thousands separators."""
    if layout.separator != "," or header.names:
        return
    width = values.shape[1]
    split_in_two = header.name_count and width == 2 * header.name_count
    if split_in_two and np.all(np.isnan(values) | (values == np.round(values))):
        raise UnreadableFile(_SPLIT_NUMBERS.format(cells=sample.splitlines()[0][:40]))
    if width > 2:
        match = None if '"' in sample else _SPLIT_COMMA.search(sample)
        if match:
            raise UnreadableFile(_SPLIT_NUMBERS.format(cells=match[0].strip(",")))
        if _are_whole_and_decimals(sample):
            row = sample.splitlines()[0][:40]
            raise UnreadableFile(
                _SPLIT_NUMBERS.format(cells=row) + ", or name the columns in a header"
            )


def _are_whole_and_decimals(sample: str) -> bool:
    """Return whether every second cell may be the decimals of the one before it.

    All of these have the same number of digits, and the last ones differ, unlike a flag.
    """
    rows = [row.split(",") for row in sample.splitlines()]
    decimals = [cell for row in rows for cell in row[1::2]]
    return (
        len({len(cell) for cell in decimals}) == 1
        and all(map(str.isdecimal, decimals))
        and all(map(_WHOLE_NUMBER.fullmatch, (cell for row in rows for cell in row[::2])))
        and all(len(row) % 2 == 0 for row in rows)
        and len({row[-1] for row in rows}) >= MIN_DECIMALS
    )


def _check_thousands_points(sample: str, layout: Layout) -> None:
    """Raise an error if points seem to separate thousands, as in 1.234 beside 987.

    Several whole numbers in a column tell this from a marker of lost points beside 3 decimals.
    """
    all_pointed = sample.count(".") == layout.width * len(sample.splitlines())
    if layout.separator == "," or all_pointed:
        return
    pointed: dict[int, set[str]] = {}
    whole: dict[int, set[str]] = {}
    for row in sample.splitlines():
        for column, cell in enumerate(map(str.strip, split_cells(row, layout.separator))):
            if _WHOLE.fullmatch(cell):
                whole.setdefault(column, set()).add(cell)
            elif _THOUSANDS_POINT.fullmatch(cell):
                pointed.setdefault(column, set()).add(cell)
            elif "." in cell and POINT_NUMBER.fullmatch(cell):
                return  # a decimal point
    for column, cells in pointed.items():
        if min(len(cells), len(whole.get(column, ()))) >= MIN_GROUPED_CELLS:
            cell = min(cells)
            raise UnreadableFile(
                f"{cell!r} may be {cell.replace('.', ',')} or {cell.replace('.', '')}: export "
                "numbers without thousands separators"
            )


def _describe_footer(footer: Sequence[str]) -> tuple[str, ...]:
    """Return a note on the lines below the numbers that are not comments."""
    footer_text = [line.strip() for line in footer if line.strip() and not is_comment(line)]
    if not footer_text:
        return ()
    count = f"{len(footer_text)} line{'s' if len(footer_text) > 1 else ''}"
    return (f"{count} after the numbers left out: {footer_text[0][:60]!r}",)
