"""A table of numbers in a text file: separator, decimal comma, comments and header sniffed."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray
from lsvision.io.profiles.number_rows import COMMENT_MARKS, MISSING_VALUES, parse_rows

_HEADER_LINES = 200  # the longest preamble looked through for the first line of numbers
_NUMBER = re.compile(r"[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?")
_DECIMAL_COMMA = re.compile(r"[-+]?\d+(?:,\d+)?(?:[eE][-+]?\d+)?")
_UNIT_WORDS = {
    **dict.fromkeys(["mm", "millimeter", "millimetre"], "mm"),
    **dict.fromkeys(["um", "µm", "μm", "micron", "microns", "micrometer", "micrometre"], "um"),
    **dict.fromkeys(["m", "meter", "metre", "meters", "metres"], "m"),
    **dict.fromkeys(["in", "inch", "inches"], "in"),
    **{word: word for word in ("nm", "cm", "mil")},
}
_UNIT = re.compile(r"^(.*?)[\s_]*[\[(/_\s]\s*([^\W\d_]+)\s*[\])]?$")


@dataclass(frozen=True, eq=False)
class TextTable:
    """Numbers of a text file with what its header says of them.

    Parameters
    ----------
    values : (n, k) ndarray
        NaN where a cell is empty or says that it holds nothing.
    names : tuple of str
        Lower-case name of each column without its unit; empty where the file has no header.
    units : tuple of (str or None)
        Unit of each column where its header states one.
    """

    values: FloatArray
    names: tuple[str, ...] = ()
    units: tuple[str | None, ...] = ()


def decode_text(content: bytes) -> str:
    """Text of a file in UTF-8, UTF-16 or Latin-1.

    Raises
    ------
    UnreadableFile
        If the bytes are no text.
    """
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        encodings = ["utf-16"]
    else:
        encodings = ["utf-8-sig", "latin-1"]
    for encoding in encodings:
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        if not re.search(r"[\x00-\x08\x0e-\x1b\x7f]", text):
            return text
    raise UnreadableFile("binary data of no known format: export the profile as text (x,z in mm)")


def parse_table(text: str) -> TextTable:
    r"""Table of numbers in a text.

    Raises
    ------
    UnreadableFile
        If there is no line of numbers, or a later line does not fit the first.

    Examples
    --------
    >>> parse_table("x [mm];z [mm]\n1,5;-2\n2,0;").values.tolist()
    [[1.5, -2.0], [2.0, nan]]
    """
    lines = text.replace('"', "").splitlines()
    first, separator = _first_row(lines)
    values = parse_rows(lines, first, separator)
    names, units = _header(lines[:first], separator, values.shape[1])
    return TextTable(values, names, units)


def split_unit(label: str) -> tuple[str, str | None]:
    """Name and unit of a column's label; None for what is no unit of length.

    Examples
    --------
    >>> split_unit("Height [µm]"), split_unit("z_mm"), split_unit("x")
    (('height', 'um'), ('z', 'mm'), ('x', None))
    """
    word = label.strip().strip("\"'").strip().lower()
    match = _UNIT.match(word)
    if match and match[1] and match[2] in _UNIT_WORDS:
        return match[1].strip(), _UNIT_WORDS[match[2]]
    return re.sub(r"\s*[\[(][^\[(]*[\])]$", "", word), None


def _first_row(lines: Sequence[str]) -> tuple[int, str | None]:
    preamble = 0
    for index, line in enumerate(lines):
        separator = _separator(line.strip())
        cells = line.split(separator)
        words = line.strip() and not line.lstrip().startswith(COMMENT_MARKS)
        if not (words and _all_numbers_or_lost(cells)):
            preamble += 1  # rows of lost points are none of it, however many
            if preamble == _HEADER_LINES:
                break
        elif any(_NUMBER.fullmatch(cell.strip()) for cell in cells):
            if index == 0 and _counts_points(line, lines[1:2]):
                continue
            return _with_lost_rows(lines, index, separator), separator
    raise UnreadableFile("no line of numbers in it: want x and height in mm, one point a line")


def _counts_points(line: str, following: Sequence[str]) -> bool:
    """True where the first line of an XYZ file is the number of its points."""
    more = [part.split(_separator(part.strip())) for part in following]
    return line.strip().isdecimal() and any(len(m) > 1 and _all_numbers_or_lost(m) for m in more)


def _with_lost_rows(lines: Sequence[str], index: int, separator: str | None) -> int:
    """Index of the first of the lines above that hold as many cells, though all of them lost."""
    width = len(lines[index].split(separator))
    while index > 0:
        cells = lines[index - 1].split(separator)
        if len(cells) != width or not _all_numbers_or_lost(cells):
            break
        index -= 1
    return index


def _separator(line: str) -> str | None:
    for mark in (";", "\t"):
        if mark in line:
            return mark
    words = line.split()
    if len(words) > 1 and all(
        w.lower() in MISSING_VALUES or _DECIMAL_COMMA.fullmatch(w) for w in words
    ):
        return None
    return "," if "," in line else None


def _all_numbers_or_lost(cells: Sequence[str]) -> bool:
    words = [cell.strip() for cell in cells]
    return all(word.lower() in MISSING_VALUES or _NUMBER.fullmatch(word) for word in words)


def _header(
    preamble: Sequence[str], separator: str | None, width: int
) -> tuple[tuple[str, ...], tuple[str | None, ...]]:
    said = [line.strip().lstrip("#%/ \t") for line in preamble]
    label_line = next((line for line in reversed(said) if line), "")
    tight = re.sub(r"\s+(?=[\[(])", "", label_line)
    for labels in (tight.split(separator), re.split(r"[,;\s]+", tight)):
        parts = [split_unit(label) for label in labels if label.strip()]
        if len(parts) == width:
            return tuple(name for name, _ in parts), tuple(unit for _, unit in parts)
    return (), (None,) * width
