"""Rows of text cells to numbers: quickly where all is well, with the line named where not."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray

COMMENT_MARKS = ("#", "%", "//")
"""What a line begins with that holds no data."""

MISSING_VALUES = frozenset(
    [
        *("", "-", "--", "---", "na", "n/a", "#n/a", "null", "none", "invalid"),
        *("nan", "-nan", "+nan", ".nan", "nan(ind)", "-nan(ind)", "1.#qnan", "-1.#ind"),
        *("inf", "-inf", "+inf", ".inf", "-.inf", "+.inf"),
    ]
)
"""What a cell says, in lower case, that holds no number."""


def parse_rows(lines: Sequence[str], first: int, separator: str | None) -> FloatArray:
    r"""Numbers of the lines from `first` on; empty lines and comments are left out.

    Parameters
    ----------
    lines : sequence of str
        The whole text.
    first : int
        Index of the first line of numbers.
    separator : str or None
        What stands between cells; None for blanks.

    Returns
    -------
    (n, k) ndarray
        NaN where a cell is empty or a lost word. A column that is empty throughout, as a
        separator at the end of each line makes it, is left out.

    Raises
    ------
    UnreadableFile
        Naming the line that has another number of cells, or a word in one.

    Examples
    --------
    >>> parse_rows(["x;z", "1,5;2", "# comment", "2,5;"], 1, ";").tolist()
    [[1.5, 2.0], [2.5, nan]]
    """
    # a tab at the end of a line stands before an empty cell: only blanks may go there
    rows = [line.strip(" \r\n" if separator == "\t" else None) for line in lines[first:]]
    body = [row for row in rows if row and not row.startswith(COMMENT_MARKS)]
    try:
        values = np.loadtxt(_filled(body, separator), delimiter=separator, comments=None, ndmin=2)
    except ValueError:  # lost words, decimal commas, or a broken line
        values = _parse_carefully(rows, first, separator)
    while values.shape[1] > 2 and np.isnan(values[:, -1]).all():
        values = values[:, :-1]
    return values


def numbers_from_cells(cells: Sequence[str]) -> FloatArray:
    """Numbers in text cells; NaN where a cell is empty or a lost word.

    Raises
    ------
    UnreadableFile
        At a cell that is another word.
    """
    try:
        return np.array(cells, dtype=np.float64)
    except ValueError:  # numpy is quick where all cells are numbers, and only there
        return np.array([_number(cell) for cell in cells])


def floats_from(array: npt.NDArray[np.generic]) -> FloatArray:
    """The array in double precision, without a warning at what double precision does not hold."""
    with np.errstate(invalid="ignore", over="ignore"):  # a signalling nan is lost all the same
        return array.astype(np.float64)


def _filled(rows: Sequence[str], separator: str | None) -> Sequence[str]:
    """The rows with nan in their empty cells, all at once: a file may have 10^6 of them."""
    if separator is None:
        return rows
    text = "\n" + "\n".join(rows) + "\n"
    for _ in range(2):  # the second of two empty cells is seen in the second pass
        text = text.replace(separator * 2, f"{separator}nan{separator}")
    text = text.replace(f"{separator}\n", f"{separator}nan\n")
    return text.replace(f"\n{separator}", f"\nnan{separator}").strip("\n").split("\n")


def _parse_carefully(rows: Sequence[str], first: int, separator: str | None) -> FloatArray:
    body = [
        (number, row.split(separator))
        for number, row in enumerate(rows, start=first + 1)
        if row and not row.startswith(COMMENT_MARKS)
    ]
    width = len(body[0][1])
    for number, cells in body:
        if len(cells) != width:
            raise UnreadableFile(
                f"line {number} has {len(cells)} cells where {width} are wanted: "
                "want the same columns in each line"
            )
    flat = [cell for _, cells in body for cell in cells]
    if separator != "," and not any("." in cell for cell in flat if cell.lower() != ".nan"):
        flat = [cell.replace(",", ".") for cell in flat]
    try:
        return numbers_from_cells(flat).reshape(-1, width)
    except UnreadableFile as error:
        number = body[_first_word(flat) // width][0]
        raise UnreadableFile(f"line {number}: {error}") from None


def _number(cell: str) -> float:
    word = cell.strip()
    if word.lower() in MISSING_VALUES:
        return float("nan")
    try:
        return float(word)
    except ValueError:
        raise UnreadableFile(
            f"{word[:40]!r} is no number: take such lines out, or mark them as comments with #"
        ) from None


def _first_word(cells: Sequence[str]) -> int:
    for index, cell in enumerate(cells):
        try:
            _number(cell)
        except UnreadableFile:
            return index
    return 0
