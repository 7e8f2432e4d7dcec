"""File names and messages without control characters and spreadsheet formulas."""

import os
import re
import unicodedata

# Unicode categories of characters that are not printable.
_HIDDEN = frozenset(["Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"])
# First characters of a spreadsheet's formula.
_FORMULA_MARKS = ("=", "+", "-", "@")
# A number, or a sign alone as the mark of an empty cell; -E5 is the formula of a cell.
_NUMBER = re.compile(r"[-+]?(?:[0-9]+[.,]?[0-9]*|[.,][0-9]+)(?:[eE][-+]?[0-9]+)?|[-+]")


def escape_text(text: str) -> str:
    r"""Return a text with non-printable characters as escape sequences.

    A file name or a cell of a file may contain line ends, ESC, marks that change the direction of
    writing, and surrogates for bytes that are not UTF-8.

    Examples
    --------
    >>> print(escape_text("a\nb\x1b[31m \udcff \u202e"))
    a\nb\x1b[31m \xff \u202e
    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(
        _escape(letter) if unicodedata.category(letter) in _HIDDEN else letter for letter in text
    )


def escape_name(path: str | os.PathLike[str]) -> str:
    r"""Return a path for results: printable, and not a formula of a spreadsheet.

    A relative path that begins with ``=``, ``+``, ``-`` or ``@`` gets ``./`` before it: the same
    file. Standard input stays ``-``.

    Examples
    --------
    >>> print(escape_name("=1+1.csv"), escape_name("-"), escape_name("a\tb.csv"))
    ./=1+1.csv - a\tb.csv
    """
    name = escape_text(os.fspath(path))
    return f"./{name}" if name.startswith(_FORMULA_MARKS) and name != "-" else name


def escape_cell(text: str) -> str:
    r"""Return a text for a table: printable, and not a formula of a spreadsheet.

    A text that begins with ``=``, ``+``, ``-`` or ``@`` gets ``'`` before it, as spreadsheets do,
    unless it is a number.

    Examples
    --------
    >>> print(escape_cell("=1+1"), escape_cell("-1.5"), escape_cell("part\t7"))
    '=1+1 -1.5 part\t7
    """
    cell = escape_text(text)
    return f"'{cell}" if cell.startswith(_FORMULA_MARKS) and not _NUMBER.fullmatch(cell) else cell


def _escape(letter: str) -> str:
    code = ord(letter)
    if 0xDC80 <= code <= 0xDCFF:  # a byte that is not UTF-8
        return f"\\x{code - 0xDC00:02x}"
    return letter.encode("unicode_escape").decode("ascii")
