"""Layout of a table in a text: separator, first row of numbers, footer."""

import csv
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

from lsvision.errors import UnreadableFile
from lsvision.io.profiles.lost_points import AllPointsLost
from lsvision.io.profiles.number_table import (
    COMMA_NUMBER,
    COMMENT_MARKS,
    POINT_NUMBER,
    THOUSANDS,
    is_missing,
)
from lsvision.io.profiles.unit_statements import find_lost_values

MAX_PREAMBLE_LINES = 200
"""Number of lines, not counting rows of lost points, in which the first line of numbers is
searched."""
MAX_NUMBERED_COLUMNS = 4
"""Largest number of columns of points above which a row 0, 1, ... numbers the columns: a longer one
may be the x of heights below it."""
SAMPLE_LINES = 60
"""Number of lines of cells that decide whether the table begins with the line above them."""
MIN_TEXT_TABLE_FRACTION = 0.5
"""Smallest fraction of lines with the same number of cells in a text table with words."""

_ANY_NUMBER = re.compile(f"{POINT_NUMBER.pattern}|{COMMA_NUMBER.pattern}|{THOUSANDS.pattern}")
"""Number with any decimal mark and with or without thousands separators."""
_RULE = re.compile(r"[-=_*~]{3,}")
"""Line of dashes below a table or its header."""
# A comma without a blank beside it: "0, -150" are two cells, "0,5 -150" two numbers.
_DECIMAL_COMMA = re.compile(r"(?:^|[0-9]),[0-9]")
_QUOTED = re.compile(r'"[^"]*"')
"""Part of a line in quotes."""
# A quoted part, or a word between blanks.
_WORDS = re.compile(r'"[^"]*"|[^\s"]+')
# First cell of a row that begins like a comment: #N/A of a spreadsheet, or a field too narrow.
_LOST_FIRST_CELL = re.compile(r"#n/a(?=[\s,;|]|$)|#{3,}[,;\t|]", re.IGNORECASE)
_NO_NUMBERS = "expected x and height in mm, one point per line, got no line of numbers"
"""Message for a text without numbers."""


@dataclass(frozen=True)
class Layout:
    """Position of the numbers in a text.

    The separator of the cells is None for blanks; numbers are in the lines from `first` to before
    `stop`, then comes a footer; `width` is the number of cells in each line, `numeric` the columns
    that hold numbers, not text.
    """

    separator: str | None
    first: int
    stop: int
    width: int
    numeric: tuple[int, ...]


def may_state_size(line: str, separator: str | None) -> bool:
    """Return whether a line may be the numbers of rows and columns that follow, like ``2 60``."""
    counts = [_parse_count(cell) for cell in split_cells(line.strip(), separator)]
    return len(counts) == 2 and None not in counts and 2 in counts


def _parse_count(cell: str) -> int | None:
    """Return the whole number in a cell; None for other cells, and for more than 9 digits."""
    word = cell.strip()
    return int(word) if word.isdecimal() and len(word) <= 9 else None


def _states_size(lines: Sequence[str], first: int, stop: int, separator: str | None) -> bool:
    """Return whether the first line of numbers is a count of rows and columns, like ``2 60``."""
    if not may_state_size(lines[first], separator):
        return False
    counts = map(_parse_count, split_cells(lines[first].strip(), separator))
    below = [line for line in lines[first + 1 : stop] if line.strip() and not is_comment(line)]
    return len(below) > 1 and set(counts) == {2, len(below)}


def split_cells(line: str, separator: str | None) -> list[str]:
    """Return the cells of a line; a quoted part is one cell, without the quotes.

    Examples
    --------
    >>> split_cells('"1,5","-2"', ","), split_cells("1.5  -2", None)
    (['1,5', '-2'], ['1.5', '-2'])
    """
    if '"' not in line:
        return line.split(separator)
    if separator is None:
        return [word.strip('"') for word in _WORDS.findall(line)]
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:
        return line.replace('"', "").split(separator)


def drop_blank_cells(cells: list[str], width: int) -> None:
    """Remove blank cells from the end of a row that is longer than the table is wide."""
    while len(cells) > width and not cells[-1].strip():
        cells.pop()


def is_comment(line: str) -> bool:
    """Return whether a line is a comment, by its first characters.

    Examples
    --------
    >>> is_comment("# 1,2"), is_comment("#N/A,2")
    (True, False)
    """
    text = line.lstrip()
    return text.startswith(COMMENT_MARKS) and _LOST_FIRST_CELL.match(text) is None


def find_layout(lines: Sequence[str]) -> Layout:
    """Return the layout of the table of numbers in the lines of a text.

    Raises
    ------
    UnreadableFile
        If there is no table of numbers.
    """
    start = _find_first_number_row(lines)
    if start is not None and not _begins_above(lines, *start):
        index, separator = start
        width = len(split_cells(lines[index], separator))
        numeric = tuple(range(width))
    else:
        index, separator, width, numeric = _find_first_text_row(lines)
    stop = _find_table_end(lines, index, separator, numeric, width)
    if _states_size(lines, index, stop, separator):
        index += 1
    return Layout(separator, index, stop, width, numeric)


def find_separator(line: str) -> str | None:
    """Return the separator of a line of numbers; None for blanks.

    A comma separates cells unless blanks separate numbers with decimal commas.
    """
    bare = _QUOTED.sub("0", line) if '"' in line else line
    for mark in (";", "\t", "|"):
        if mark in bare:
            return mark
    words = bare.split()
    has_decimals = _DECIMAL_COMMA.search(bare) and len(words) > 1
    if has_decimals and all(is_missing(w) or COMMA_NUMBER.fullmatch(w) for w in words):
        return None
    return "," if "," in bare else None


def _find_row_separator(lines: Sequence[str], index: int) -> str | None:
    """Return the separator of a row; a tab if it is one cell beside one, and a row below two."""
    line = lines[index]
    separator = find_separator(line.strip())
    if separator is None and len(line.split()) == 1 and "\t" in line.strip(" \r\n"):
        below = lines[index + 1 : index + 1 + SAMPLE_LINES]
        return "\t" if any("\t" in row.strip() for row in below) else None
    return separator


def is_number_or_lost(cell: str) -> bool:
    """Return whether a cell is a number, empty, or a word for lost points."""
    word = cell.strip()
    return bool(_ANY_NUMBER.fullmatch(word)) or is_missing(word)


def _find_first_number_row(lines: Sequence[str]) -> tuple[int, str | None] | None:
    """Return index and separator of the first row of numbers or of lost points before them.

    None if the first lines hold no row of numbers.
    """
    preamble = 0
    for index, line in enumerate(lines):
        text = line.strip()
        # "missing, -9999" states a marker: its cells could also be a lost point.
        if not text or is_comment(line) or find_lost_values([line]):
            preamble += 1
        else:
            separator = _find_row_separator(lines, index)
            cells = split_cells(line if separator else text, separator)
            if not all(map(is_number_or_lost, cells)):
                preamble += 1
            elif any(_ANY_NUMBER.fullmatch(cell.strip()) for cell in cells):
                if not _is_above_table(lines, index, cells):
                    return _include_lost_rows(lines, index, separator), separator
                preamble += 1
        if preamble >= MAX_PREAMBLE_LINES:  # rows of lost points do not count
            return None
    return None


def _begins_above(lines: Sequence[str], index: int, separator: str | None) -> bool:
    """Return whether the row above a row of numbers is one of the table, with text in a cell.

    It is an id, such as "0A1" above "007", or that of the row of numbers is a word for lost points,
    such as "invalid" below "valid".
    """
    if index == 0:
        return False
    row, above = (split_cells(lines[k].strip(" \r\n"), separator) for k in (index, index - 1))
    pairs = list(zip(row, above, strict=False))
    if len(row) != len(above):
        return False
    if any(is_missing(cell) and not is_number_or_lost(text) for cell, text in pairs):
        beside_numbers = [text.strip() for cell, text in pairs if not is_missing(cell)]
    else:
        beside_numbers = [text.strip() for text in above if is_number_or_lost(text)]
        if len(beside_numbers) != len(above) - 1:
            return False
    return len(beside_numbers) > 1 and all(map(_ANY_NUMBER.fullmatch, beside_numbers))


def _is_above_table(lines: Sequence[str], index: int, row: Sequence[str]) -> bool:
    """Return whether a line of numbers is above the table, such as a count of points or columns.

    It is if a header follows it, most of the lines below have more cells, or its cells are the
    numbers of few columns, 0, 1, ..., and those below it have decimals. The first cell may be
    empty: it is then above numbers of the rows.
    """
    next_lines = lines[index + 1 : index + 1 + 2 * SAMPLE_LINES]
    below = islice(_iterate_cells(next_lines), SAMPLE_LINES)
    nearest = list(islice(below, 3))
    are_numbers = [all(map(is_number_or_lost, cells)) for cells in nearest]
    if are_numbers == [False, True, True]:
        return True
    width = len(row)
    if not nearest or width == len(nearest[0]):
        start = 0 if row[0].strip() else 1
        return (
            width <= MAX_NUMBERED_COLUMNS
            and are_column_numbers(row[start:])
            and _have_decimals([cells[start:] for cells in nearest])
        )
    widths = [len(cells) for cells in (*nearest, *below)]
    common, count = Counter(widths).most_common(1)[0]
    return common > width and 2 * count > len(widths)


def are_column_numbers(cells: Sequence[str]) -> bool:
    """Return whether cells are the numbers of columns, 0, 1, ..., as pandas writes them."""
    return list(cells) == [str(number) for number in range(len(cells))]


def _have_decimals(rows: Sequence[Sequence[str]]) -> bool:
    """Return whether there are three rows, and all of their cells have decimals."""
    return len(rows) == 3 and all("." in cell or "," in cell for row in rows for cell in row)


def _iterate_cells(lines: Sequence[str]) -> Iterator[list[str]]:
    """Yield the cells of each line that is neither empty nor a comment.

    Beside a row separated by tabs, one cell and a tab are two cells.
    """
    has_tabs = any("\t" in line.strip() for line in lines)
    for line in lines:
        if line.strip() and not is_comment(line):
            separator = find_separator(line.strip())
            if separator is None and has_tabs and "\t" in line.strip(" \r\n"):
                separator = "\t"
            yield split_cells(line.strip() if separator is None else line, separator)


def _include_lost_rows(lines: Sequence[str], index: int, separator: str | None) -> int:
    """Return the index of the first row of lost points directly above a row, or that of the row."""
    width = len(split_cells(lines[index], separator))
    while index > 0:
        cells = split_cells(lines[index - 1], separator)
        if len(cells) != width or not all(map(is_missing, cells)):
            break
        dashes = [cell.strip() for cell in cells if cell.strip()]
        if dashes and all(map(_RULE.fullmatch, dashes)) and index > 1:
            names = split_cells(lines[index - 2], separator)
            if len(names) == width and not all(map(is_number_or_lost, names)):
                break  # a rule below the names, as in Markdown
        index -= 1
    return index


def _find_first_text_row(lines: Sequence[str]) -> tuple[int, str | None, int, tuple[int, ...]]:
    """Return first line, separator, width and columns of numbers of a table with words and numbers.

    They are those of most of 4 `SAMPLE_LINES` lines behind the first quarter of the text, which may
    be a preamble.
    """
    rows = [i for i, line in enumerate(lines) if line.strip() and not is_comment(line)]
    sample = rows[len(rows) // 4 :][: 4 * SAMPLE_LINES]
    best: tuple[str | None, int, tuple[int, ...]] | None = None
    marks = [mark for mark in (";", "\t", "|") if all(mark in lines[i] for i in sample)]
    # Beside one of these marks, a comma is a decimal mark.
    for separator in marks[:1] or (",", None):
        cells = [split_cells(lines[i].strip(" \r\n"), separator) for i in sample]
        if not cells:
            break
        width, count = Counter(map(len, cells)).most_common(1)[0]
        table = [row for row in cells if len(row) == width]
        numeric = tuple(c for c in range(width) if _is_numeric(row[c] for row in table))
        is_frequent = count >= max(2, MIN_TEXT_TABLE_FRACTION * len(cells))
        if len(numeric) >= 2 and is_frequent and (best is None or len(numeric) > len(best[2])):
            best = separator, width, numeric
    if best is None:
        raise _build_no_table_error(lines, rows)
    separator, width, numeric = best
    for index in rows:
        row = split_cells(lines[index].strip(" \r\n"), separator)
        if len(row) == width and _may_be_first(row, numeric):
            return index, separator, width, numeric
    raise _build_no_table_error(lines, rows)


def _may_be_first(row: Sequence[str], numeric: tuple[int, ...]) -> bool:
    """Return whether a row has numbers in the columns of numbers, but for an id in one of three."""
    words = sum(not is_number_or_lost(row[c]) for c in numeric)
    return words == 0 or (words == 1 and len(numeric) > 2)


def _build_no_table_error(lines: Sequence[str], rows: Sequence[int]) -> UnreadableFile:
    """Return the error of a text whose points are all lost, or that has no table of numbers."""
    lost = 0
    for index in rows:
        cells = split_cells(lines[index], find_separator(lines[index].strip()))
        lost += len(cells) > 1 and all(map(is_missing, cells))
    if 2 * lost > len(rows):
        return AllPointsLost(f"all {lost} points are lost: check exposure and range, or --columns")
    with_digits = [lines[k].strip() for k in rows if re.search(r"[0-9]", lines[k])]
    typical = f" (as {with_digits[len(with_digits) // 2][:40]!r})" if with_digits else ""
    return UnreadableFile(_NO_NUMBERS + typical)


def _is_numeric(cells: Iterable[str]) -> bool:
    """Return whether at least 90 % of the cells that are not lost are numbers."""
    valid = [cell.strip() for cell in cells if not is_missing(cell)]
    numbers = sum(bool(_ANY_NUMBER.fullmatch(cell)) for cell in valid)
    return bool(valid) and 10 * numbers >= 9 * len(valid)


def _find_table_end(
    lines: Sequence[str], first: int, separator: str | None, numeric: tuple[int, ...], width: int
) -> int:
    """Return the index behind the last line of the table; what follows is a footer."""
    stop = len(lines)
    blanks = " \r\n" if separator == "\t" else None  # a line of tabs is a lost point
    while stop > first + 1:
        line = lines[stop - 1]
        if line.strip(blanks) and not is_comment(line):
            cells = split_cells(line.strip() if separator is None else line, separator)
            above = lines[stop - 2].strip() if separator is None else lines[stop - 2]
            is_id = cells[:1] == split_cells(above, separator)[:1] and len(cells) == width
            if is_id or not _is_footer(cells, numeric, width, stop - 1 - first):
                break
        stop -= 1
    return stop


def _is_footer(cells: Sequence[str], numeric: tuple[int, ...], width: int, rows: int) -> bool:
    """Return whether a row is below the table: words, a rule, or the number of its rows."""
    if len(cells) in (width, width + 1):  # one more after a separator at the end of the line
        return not is_number_or_lost(cells[numeric[0]])
    if not all(map(is_number_or_lost, cells)):
        return True
    if len(cells) != 1:
        return False
    count = _parse_count(cells[0])
    is_row_count = count is not None and abs(count - rows) <= 1  # it may include the header
    return is_row_count or _RULE.fullmatch(cells[0].strip()) is not None
