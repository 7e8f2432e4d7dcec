"""Text cells as numbers, and tables of numbers in a file: points, or a matrix of heights."""

import re
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np
import numpy.typing as npt

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray
from lsvision.io.profiles.unit_statements import UnitStatement
from lsvision.io.profiles.units import StatedUnit, split_label

COMMENT_MARKS = ("#", "%", "//", "!")
"""First characters of a line without data."""

MISSING_VALUES = frozenset(
    [
        *("", "-", "--", "---", "----", "-----", "na", "n/a", "#n/a", "n.a.", "null", "none"),
        *("nan", "-nan", "+nan", ".nan", "nan(ind)", "-nan(ind)", "1.#qnan", "-1.#ind"),
        *("inf", "-inf", "+inf", ".inf", "-.inf", "+.inf", "infinity", "-infinity", "+infinity"),
        *("1.#inf", "-1.#inf", "1.#ind", "-1.#qnan", "nil", "missing", "invalid", "lost", "∞"),
        *("no data", "nodata", "out of range", "oor", "overflow", "underflow", "*", "***", "?"),
    ]
)
"""Content, in lower case, of a cell without a number."""

_MISSING_PATTERN = re.compile(
    r"[-+]?1\.#(?:ind|qnan|snan|inf)0*|[-+]?[sq]?nan(?:\(\w*\))?|<na>|\\n"
    r"|[*]+|[#]+|-+(?:\.-+)?|0x(?:f+|80+|7f+)|(?:over|under|out.?of.?)range"
)
"""Further contents of a cell without a number: fields too narrow, limits of integer types in
hexadecimal."""

# Numbers with a decimal point, with a decimal comma, and with thousands separators; 1d3 and 1D3 are
# double precision in Fortran.
POINT_NUMBER = re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eEdD][-+]?[0-9]+)?")
COMMA_NUMBER = re.compile(r"[-+]?(?:[0-9]+(?:,[0-9]*)?|,[0-9]+)(?:[eEdD][-+]?[0-9]+)?")
THOUSANDS = re.compile(
    r"[-+]?[0-9]{1,3}(?:"
    r"(?:,[0-9]{3})+\.[0-9]*|(?:\.[0-9]{3})+,[0-9]*"  # 1,234.5 and 1.234,5
    r"|(?:,[0-9]{3}){2,}|(?:\.[0-9]{3}){2,}"  # 1,234,567
    r"|(?:['’ \u00a0\u2009\u202f_][0-9]{3})+(?:[.,][0-9]*)?)"  # 1'234.5
)
_GROUPED = re.compile(r"[-+]?[1-9][0-9]{0,2},[0-9]{3}")
"""Ambiguous cell such as 1,234: the comma is the decimal mark or a thousands separator."""
# A number with decimals, or behind = or in brackets; a time or a date.
_NUMBER_IN_TEXT = re.compile(
    r"(?<![0-9.])[0-9]+[.,][0-9]+(?![0-9.])|[=\[({]\s*[-+]?[0-9]|[0-9]\s*[\])}]"
)
_TIME = re.compile(r"[0-9]:[0-9]|[0-9]{4}[-/][0-9]{2}|[0-9]{2}[./][0-9]{2}[./][0-9]")
MAX_CONSTANT_TEXTS = 3
"""Largest number of different texts in a column that may state the unit of others."""
MIN_GROUPED_CELLS = 3
"""Smallest number of cells like 1,234 that, beside whole numbers, may have thousands separators."""
# Typographic dashes as minus signs, and typographic blanks as those in `MISSING_VALUES`.
_PLAIN_CHARACTERS = str.maketrans({"−": "-", "–": "-", "\u00a0": " ", "\u202f": " ", "\u2009": " "})


@dataclass(frozen=True)
class InvalidCell:
    """A cell that contains text instead of a number, and why it is not one, with what to do.

    `row` is its index in the table; in a `NumberTable`, the number of its line in the file. A
    `grouped` one is a number with thousands separators.
    """

    row: int
    text: str
    reason: str
    grouped: bool = False


@dataclass(frozen=True, eq=False)
class NumberColumn:
    """A column of text cells as numbers, NaN where a cell holds none.

    Invalid cells hold neither a number nor a word for a lost point; the first is kept.
    """

    values: FloatArray
    invalid_count: int = 0
    first_invalid: InvalidCell | None = None


def is_missing(cell: str) -> bool:
    """Return whether a cell is marked as without a number.

    Examples
    --------
    >>> is_missing("NaN"), is_missing("****"), is_missing("0xFFFFFFFF"), is_missing("six")
    (True, True, True, False)
    """
    word = cell.strip().lower()
    return word in MISSING_VALUES or bool(_MISSING_PATTERN.fullmatch(word))


def holds_number(cell: str) -> bool:
    """Return whether a text holds a number beside other characters, and no time or name.

    Examples
    --------
    >>> [holds_number(cell) for cell in ("x=-60", "[12", "12.5mm", "10:30:00.25", "p12")]
    [True, True, True, False, False]
    """
    return bool(_NUMBER_IN_TEXT.search(cell)) and not _TIME.search(cell)


def numbers_from_cells(cells: Sequence[str]) -> FloatArray:
    """Return the numbers in text cells; NaN for an empty cell or a word for lost points.

    Raises
    ------
    UnreadableFile
        If a cell contains other text.
    """
    column = parse_column(cells, decimal_comma=False)
    if column.first_invalid is not None:
        raise UnreadableFile(
            f"{column.first_invalid.text[:40]!r} is not a number: export it again, with empty "
            "cells or nan for lost points"
        )
    return column.values


def parse_column(
    cells: Sequence[str], *, decimal_comma: bool, lost_words: frozenset[str] = frozenset()
) -> NumberColumn:
    """Return the numbers of one column of cells.

    `lost_words`, in lower case, mark lost points beside `MISSING_VALUES`.

    Examples
    --------
    >>> parse_column(["1.5", "", "six"], decimal_comma=False).first_invalid.text
    'six'
    """
    if not decimal_comma and not any("_" in cell for cell in cells):  # numpy reads 1_000 as 1000
        try:  # fast if all cells are numbers
            return NumberColumn(_without_infinities(np.array(cells, dtype=np.float64)))
        except ValueError:
            pass
    pattern = COMMA_NUMBER if decimal_comma else POINT_NUMBER
    values, first_invalid, invalid_count = np.full(len(cells), np.nan), None, 0
    for row, raw in enumerate(cells):
        cell = raw.strip()
        if pattern.fullmatch(cell) is None:
            cell = cell.translate(_PLAIN_CHARACTERS).strip()
        if pattern.fullmatch(cell):
            values[row] = float(cell.replace(",", ".").replace("d", "e").replace("D", "e"))
        elif cell.lower() not in lost_words and not is_missing(cell):
            invalid_count += 1
            first_invalid = first_invalid or _describe_invalid_cell(row, cell)
    return NumberColumn(_without_infinities(values), invalid_count, first_invalid)


def uses_decimal_comma(columns: Sequence[Sequence[str]]) -> bool:
    """Return whether commas are the decimal marks of columns whose cells are split already.

    Raises
    ------
    UnreadableFile
        If the commas may also be thousands separators.
    """
    has_commas = has_decimal_comma = False
    ambiguous_cell = None
    for cells in columns:
        with_comma = [cell.strip() for cell in cells if "," in cell]
        numbers = [cell for cell in with_comma if COMMA_NUMBER.fullmatch(cell)]
        if not numbers:
            continue
        has_commas = True
        grouped = [cell for cell in numbers if _GROUPED.fullmatch(cell)]
        has_decimal_comma |= len(grouped) < len(numbers)
        has_whole_numbers = any(re.fullmatch(r"[-+]?[0-9]{1,3}", cell.strip()) for cell in cells)
        if len(grouped) >= MIN_GROUPED_CELLS and has_whole_numbers:
            ambiguous_cell = grouped[0]
    if not has_commas or any(_has_decimal_point(cells) for cells in columns):
        return False
    if ambiguous_cell is not None and not has_decimal_comma:
        raise UnreadableFile(
            f"{ambiguous_cell!r} may be {ambiguous_cell.replace(',', '.')} or "
            f"{ambiguous_cell.replace(',', '')}: export numbers without thousands separators"
        )
    return True


def floats_from(array: npt.NDArray[np.generic]) -> FloatArray:
    """Return the array in double precision, without a warning for what it cannot represent."""
    with np.errstate(invalid="ignore", over="ignore"):  # a signalling NaN, a larger long double
        return array.astype(np.float64)


def _without_infinities(values: FloatArray) -> FloatArray:
    """Return the same array, changed in place: NaN instead of infinity."""
    values[np.isinf(values)] = np.nan
    return values


def _has_decimal_point(cells: Sequence[str]) -> bool:
    return any("." in cell and POINT_NUMBER.fullmatch(cell.strip()) for cell in cells)


def _describe_invalid_cell(row: int, cell: str) -> InvalidCell:
    if THOUSANDS.fullmatch(cell):
        reason = "has a thousands separator: export numbers without them"
        return InvalidCell(row, cell, reason, grouped=True)
    reason = "is not a number: remove such lines, mark them as comments with #, or use --lost"
    shown = " ".join(cell.split())[:20]
    return InvalidCell(row, cell, f"{reason} {shown} if it marks lost points")


@dataclass(frozen=True, eq=False)
class NumberTable:
    """Table of numbers in a file of any format, with what the file states on them.

    Parameters
    ----------
    values : (n, k) ndarray
        NaN where a cell is empty or holds a word for a lost point.
    names : tuple of str
        Lower-case name of each column without its unit; empty where the file has no header.
    units : tuple of (StatedUnit or None)
        Unit that the header states for each column, or None; empty stands for no unit.
    statements : tuple of UnitStatement
        Units that the file states elsewhere.
    texts : mapping of int to sequence of str
        Cells of the columns that hold text.
    invalid_cells : mapping of int to InvalidCell
        First cell that is not a number in each column that has one; `InvalidCell.row` is the
        number of its line in the file.
    spellings : mapping of int to sequence of str
        Cells of columns of numbers that are written in another way, such as 007 or 1e5.
    lost : tuple of float
        Markers of lost points that the file states.
    notes : tuple of str
        Omissions, as text for users.
    limits : tuple of float
        Limits of the data type in which the numbers were stored.
    mentions : tuple of str
        Lines of text beside the numbers, which may mention a unit in other words.
    """

    values: FloatArray
    names: tuple[str, ...] = ()
    units: tuple[StatedUnit | None, ...] = ()
    statements: tuple[UnitStatement, ...] = ()
    texts: Mapping[int, Sequence[str]] = field(default_factory=dict)
    invalid_cells: Mapping[int, InvalidCell] = field(default_factory=dict)
    spellings: Mapping[int, Sequence[str]] = field(default_factory=dict)
    lost: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()
    limits: tuple[float, ...] = ()
    mentions: tuple[str, ...] = ()

    @classmethod
    def of_points(cls, rows: FloatArray, statements: tuple[UnitStatement, ...] = ()) -> Self:
        """Return the table of points x, z or x, y, z; rows of another length have no names."""
        count = rows.shape[1]
        names = {2: ("x", "z"), 3: ("x", "y", "z")}.get(count, ())
        return cls(rows, names, (None,) * count, statements)

    @classmethod
    def of_heights(
        cls, rows: FloatArray, label: str, statements: tuple[UnitStatement, ...] = ()
    ) -> Self:
        """Return the table of rows of heights; the label, with its unit, is that of all columns."""
        name, unit = split_label(label)
        count = rows.shape[1]
        return cls(rows, (name,) * count if name else (), (unit,) * count, statements)

    def label(self, column: int) -> str:
        """Return the name of a column, or its number if it has none."""
        return (self.names[column] if self.names else "") or str(column)

    def iterate_lines_of_constants(self, coordinates: Container[int]) -> Iterator[str]:
        """Yield a line ``name: value`` for each value of the columns with one, or few texts.

        They may state a unit, such as that in a column ``unit``. The columns `coordinates` are left
        out.
        """
        for column, name in enumerate(self.names):
            if column in coordinates or not name or not len(self.values):
                continue
            texts = list(dict.fromkeys(self.texts.get(column, ())))
            value = self.values[0, column]
            if column in self.texts and len(texts) <= MAX_CONSTANT_TEXTS:
                yield from (f"{name}: {text}" for text in texts if text)
            elif column not in self.texts and bool(np.all(self.values[:, column] == value)):
                unit = self.units[column] if self.units else None
                yield f"{name}{f' {unit.text}' if unit else ''}: {value:.12g}"
