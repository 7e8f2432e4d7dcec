"""Names and units of columns in the lines above the numbers of a text."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from lsvision.io.profiles.column_roles import find_role, has_known_role
from lsvision.io.profiles.number_table import COMMENT_MARKS
from lsvision.io.profiles.text_layout import (
    are_column_numbers,
    drop_blank_cells,
    is_number_or_lost,
    split_cells,
)
from lsvision.io.profiles.unit_statements import states_unit
from lsvision.io.profiles.units import (
    NOT_LENGTHS,
    StatedUnit,
    find_unit_in_text,
    parse_unit,
    split_label,
)

_TYPES = frozenset(
    "float double real int integer number numeric string text f4 f8 i4".split()  # noqa: SIM905
)
"""Words of a row of data types."""
# A line such as "date: 2026"; the text in brackets of a label; the marks of a comment.
_KEY_VALUE = re.compile(r"^[^:=]+[:=][^:=]*$")
_BRACKETS = re.compile(r"\[[^\]]{0,80}\]|\([^)]{0,80}\)")
_VALUE_WITH_UNIT = re.compile(r"\]\s*[:=,;\t]?\s*[-+]?[0-9.,]+(?:e[-+]?[0-9]+)?\s*$", re.IGNORECASE)
"""End of a line such as "stand-off [m]: 0.4"."""
_INNER_BLANK = "\x00"
"""Replaces a blank inside brackets while labels are split."""
_COMMENT = re.compile(r"^[\s#%/!]+")
# A line about one column, such as "column 1: x [mm]" or "2) z [um]".
_LISTED = re.compile(
    r"(?:col\w*|spalte|field|channel|kanal)?\W{0,2}([0-9]{1,3})\s*[:.)=-]\s*(\S.*)", re.IGNORECASE
)
# A line of dashes below the names, such as |:---|---:| of Markdown.
_RULE = re.compile(r"[-:=|+\s]+")


@dataclass(frozen=True)
class Header:
    """Names and units above the columns of a table.

    Names are in lower case and without the unit, empty where the file has none; `name_count` is the
    number of names in a line of coordinates' names that are not as many as the columns, else 0.
    """

    names: tuple[str, ...]
    units: tuple[StatedUnit | None, ...]
    name_count: int = 0


def read_header(preamble: Sequence[str], separator: str | None, width: int) -> Header:
    """Return the names and units of the columns above the numbers.

    The lines are read upwards from the numbers: the lowest row of units counts, and the lowest row
    with one word per column that names coordinates. A row of other words counts only directly
    above the numbers or the units, unless the row above it names coordinates: it may hold units.
    A unit in a row of units has priority over one in a label.
    """
    listed = _find_listed_labels(preamble, width)
    if listed is not None:
        return listed
    names: list[str] = []
    units: list[StatedUnit | None] = []
    label_units: list[StatedUnit | None] = []
    name_count = 0
    texts = [_COMMENT.sub("", line).strip(" \r\n") for line in preamble]
    lines = [
        (line, text)
        for line, text in zip(preamble, texts, strict=True)
        if text and _RULE.fullmatch(text) is None
    ]
    for position, (line, text) in enumerate(reversed(lines)):  # 0 is directly above the numbers
        labels = _split_labels(text, separator, width)
        unit_row = None if labels is None else _parse_unit_row(labels)
        if unit_row is not None and not units:
            units = unit_row
        elif labels is None and not states_unit(line):
            name_count = name_count or _count_names(text)
            bracketed = _parse_bracketed_units(text, width)
            if label_units and bracketed and not names and bracketed[0] != label_units[0]:
                label_units = [StatedUnit(text, None)] * width  # of which column is not known
            label_units = label_units or bracketed
        elif labels is not None and not names and not _is_not_header(line, text, labels, separator):
            parsed = [split_label(label) for label in labels]
            if _has_known_roles(parsed):
                names, label_units = [name for name, _ in parsed], [unit for _, unit in parsed]
            elif above := _names_above(preamble, line, separator, width):
                units = units or _units_from_unknown_words(labels)
                names, label_units = above
            elif position == 0 or (position == 1 and units):
                names, label_units = [name for name, _ in parsed], [unit for _, unit in parsed]
    pairs = zip(units or [None] * width, label_units or [None] * width, strict=True)
    return Header(
        tuple(names),
        tuple(unit or label_unit for unit, label_unit in pairs),
        0 if names else name_count,
    )


def _find_listed_labels(preamble: Sequence[str], width: int) -> Header | None:
    """Return the header of lines that number the columns, one each, and name coordinates."""
    matches = [_LISTED.fullmatch(_COMMENT.sub("", line).strip()) for line in preamble]
    lines = [match for match in matches if match is not None]
    numbers = [int(match[1]) for match in lines]
    if not numbers or numbers not in (list(range(width)), list(range(1, width + 1))):
        return None
    parsed = [split_label(match[2]) for match in lines]
    if not _has_known_roles(parsed):
        return None
    return Header(tuple(name for name, _ in parsed), tuple(unit for _, unit in parsed))


def _has_known_roles(parsed: Sequence[tuple[str, StatedUnit | None]]) -> bool:
    """Return whether at least two labels name coordinates, angles or numbers of profiles."""
    return sum(has_known_role(name) for name, _ in parsed) >= 2


def _is_not_header(line: str, text: str, labels: Sequence[str], separator: str | None) -> bool:
    """Return whether a line with one word per column does not hold their names."""
    if all(map(is_number_or_lost, labels)):  # unless the first is above numbers of the rows
        return bool(labels[0]) or not are_column_numbers(labels[1:])
    if states_unit(line):  # unless it names columns, as "x_mm,z in um" without a comment's mark
        is_comment_line = line.lstrip().startswith(COMMENT_MARKS)
        return is_comment_line or not _has_known_roles(list(map(split_label, labels)))
    if _VALUE_WITH_UNIT.search(text) and not _has_known_roles(list(map(split_label, labels))):
        return True
    return separator is None and _is_key_value(text, labels)


def _split_labels(text: str, separator: str | None, width: int) -> list[str] | None:
    """Return the labels of a header line with `width` columns; None if there are not so many."""
    joined = _BRACKETS.sub(lambda match: match[0].replace(" ", _INNER_BLANK), text)
    # 'x [1/10 mm]' is one label, whatever separates the cells.
    joined = re.sub(r"(?<! ) +(?=[\[(])", "", joined)
    for labels in (
        split_cells(joined, separator),
        [w for w in re.split(r"[,;\s|]+", joined.replace('"', "")) if w],
    ):
        drop_blank_cells(labels, width)
        if len(labels) == width:
            return [label.replace(_INNER_BLANK, " ").strip() for label in labels]
    return None


def _parse_bracketed_units(text: str, width: int) -> list[StatedUnit | None]:
    """Return the unit in brackets of a line as that of all columns; empty without one.

    The line has other names than the columns, so that several units cannot be assigned: they are
    returned as a unit that is not understood. A number behind the brackets has this unit itself.
    """
    if _VALUE_WITH_UNIT.search(text):
        return []
    stated = [find_unit_in_text(word) for word in re.findall(r"\[([^\]]{1,80})\]", text)]
    units = {unit.unit: unit for unit in stated if unit.unit is not None}
    if not units:
        return []
    unit = next(iter(units.values())) if len(units) == 1 else StatedUnit(text, None)
    return [unit] * width


def _parse_unit_row(labels: Sequence[str]) -> list[StatedUnit | None] | None:
    """Return the units of a row that holds nothing but units; None for another row."""
    row: list[StatedUnit | None] = []
    for label in labels:
        name, stated = split_label(label)
        word = label.strip("[](){}<> \"'").lower()
        bracketed = label.strip("\"' ").startswith(("[", "(", "<", "{"))
        if not word or word in ("-", "1", "--"):
            row.append(None)
        elif parse_unit(word) is not None:
            row.append(StatedUnit(word, parse_unit(word)))
        elif word in NOT_LENGTHS or (bracketed and not name and stated):
            row.append(StatedUnit(word, None))
        else:
            return None
    words = [label.lower() for label in labels]
    # 'x m' names two columns rather than giving the unit of one; px is a unit, and a name of x
    names_columns = any(has_known_role(word) and word not in NOT_LENGTHS for word in words)
    return row if any(row) and not names_columns else None


def _names_above(
    preamble: Sequence[str], line: str, separator: str | None, width: int
) -> tuple[list[str], list[StatedUnit | None]] | None:
    """Return names and units of the row above a row of unknown words, if it names coordinates."""
    above = [text for text in preamble[: list(preamble).index(line)] if text.strip()]
    if not above or line.lstrip().startswith(COMMENT_MARKS):
        return None
    labels = _split_labels(_COMMENT.sub("", above[-1]).strip(" \r\n"), separator, width)
    parsed = [split_label(label) for label in labels or ()]
    if not _has_known_roles(parsed):
        return None
    return [name for name, _ in parsed], [unit for _, unit in parsed]


def _units_from_unknown_words(labels: Sequence[str]) -> list[StatedUnit | None]:
    """Return a stated unit for each word that is not a data type."""
    return [
        None if not label or label.lower() in _TYPES else StatedUnit(label, parse_unit(label))
        for label in labels
    ]


def _is_key_value(text: str, labels: Sequence[str]) -> bool:
    """Return whether a line is like ``date: 2026``, and names no coordinate."""
    return bool(_KEY_VALUE.match(text)) and not any(
        has_known_role(split_label(label)[0]) for label in labels
    )


def _count_names(text: str) -> int:
    """Return the number of words of a line if all are names of coordinates; else 0.

    A single word counts if it names a height.
    """
    labels = [w for w in re.split(r"[,;\s|]+", re.sub(r"(?<!\s)\s+(?=[\[(])", "", text)) if w]
    names = [split_label(label.strip('"'))[0] for label in labels]
    is_height = len(names) == 1 and find_role(names[0]) in ("height", "range")
    return len(names) if is_height or (all(map(has_known_role, names)) and len(names) >= 2) else 0
