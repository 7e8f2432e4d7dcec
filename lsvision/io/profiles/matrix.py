"""Matrices of heights, in a text or an image: one profile per row; x from the options or a row."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray
from lsvision.io.images import TooManyPixels, decode_image
from lsvision.io.profiles.column_roles import HEIGHT_ROLES, find_role
from lsvision.io.profiles.columns import profiles_from_table
from lsvision.io.profiles.number_table import NumberTable, floats_from, holds_number
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.stated_heights import resolve_direction
from lsvision.io.profiles.stated_positions import read_with_stated_positions
from lsvision.io.profiles.stated_units import find_common_unit, require_known_unit, select_for_axis
from lsvision.io.profiles.text_encoding import decode_text
from lsvision.io.profiles.text_table import parse_table
from lsvision.io.profiles.units import split_label
from lsvision.results.summaries import format_count

_NUMBER_AT_END = re.compile(r"[-+]?[0-9]+(?:[.,][0-9]*)?[\])]?$")
"""Number of a column at the end of its name."""
_OTHER_AXIS = re.compile(r"^(?!.*\b(?:z|heights?)\b).*(?:\b(?:[xy]|lateral)\b|px\b|pixel)")
"""Line about x or y, and not about heights."""
MIN_COLUMNS = 21
"""Smallest number of columns of a matrix of heights: lists of points have fewer."""
MAX_HINTED_COLUMNS = 200
"""Largest number of columns for the hint that profiles may lie in columns: rows of profiles usually
have more points."""
MIN_ROWS = 3
"""Smallest number of rows whose first numbers are compared with the heights beside them."""
MAX_NUMBER_UNEVENNESS = 1e-6
"""Largest difference of the steps of numbers of rows, relative to their mean."""
MAX_UNEVENNESS = 0.05
"""Largest deviation of the steps of x, relative to their mean, in a row of evenly spaced x: they
are rounded to a few digits."""


def read_matrix(content: bytes, settings: ReadSettings) -> RawProfiles:
    """Return the profiles of a text with one row of heights each."""
    table = parse_table(decode_text(content), settings.lost_words)
    return read_with_stated_positions(
        partial(profiles_from_text_matrix, table), lambda: table.mentions, settings
    )


def profiles_from_text_matrix(table: NumberTable, settings: ReadSettings) -> RawProfiles:
    """Return the profiles of a matrix in a text, without the numbers of its columns and rows.

    Programs such as pandas write numbers of columns, 0, 1, ..., above a matrix, and those of rows
    beside it, under an empty cell. Rows whose first cells name x and others, as in ``X [mm];1;2``
    over ``Z [mm];5;6``, are the columns of a table of points.

    Raises
    ------
    UnreadableFile
        As `profiles_from_matrix`, and if the first row may be such numbers or x.
    """
    labels = table.texts.get(0, ())
    if not table.names and labels and find_role(split_label(labels[0])[0]) == "x":
        return profiles_from_table(_transpose_labelled_rows(table), settings)
    if not table.names and not settings.transpose:
        table = _without_row_numbers(table)
    values = table.values
    beside_rows = int(np.isnan(values[0, 0]))
    first = values[0, beside_rows:]
    if table.names or min(len(values) - 1, len(first)) < 2 or not _are_column_numbers(first):
        return profiles_from_matrix(table, settings)
    start = first[0]
    row = f"the first row, {start:g}, {start + 1:g}, ..., {first[-1]:g},"
    if settings.dx is None and not (beside_rows or settings.transpose):
        raise UnreadableFile(
            f"{row} numbers the columns or is x in mm: state x with --x0 and --dx, which are "
            f"{start:g} and 1 if it is x"
        )
    notes = (*table.notes, f"{row} numbers the columns: left out")
    return profiles_from_matrix(
        replace(table, values=values[1:, beside_rows:], notes=notes), settings
    )


def _without_row_numbers(table: NumberTable) -> NumberTable:
    """Return a matrix without the columns before the heights: numbers, times or places of rows.

    Their numbers rise in equal steps, or far from the heights, or each is the number of heights.
    They may also be beside a row of x, under an empty cell or 0.
    """
    values, start = table.values, 0
    has_corner = not np.nan_to_num(values[0, 0]) and not _are_column_numbers(values[0, 1:])
    if min(values.shape) > 2 and has_corner and _is_x_row(values[:, 1:]) and not _is_x_row(values):
        start = 1
    while len(values) >= MIN_ROWS and values.shape[1] - start > 2:
        if not _are_row_numbers(values[:, start], values[:, start + 1 :]):
            break
        start += 1
    if start == 0:
        return table
    first = ", ".join(f"{number:.10g}" for number in values[:3, 0])
    columns = "column 0" if start == 1 else f"columns 0 to {start - 1}"
    note = f"{columns} ({first}, ...) beside the heights left out"
    return replace(table, values=values[:, start:], notes=(*table.notes, note))


def _are_column_numbers(row: FloatArray) -> bool:
    """Return whether a row is 0, 1, 2, ... or 1, 2, 3, ..., as the numbers of columns are."""
    return (
        len(row) > 0
        and row[0] in (0, 1)
        and bool(np.array_equal(row, row[0] + np.arange(len(row))))
    )


def _are_row_numbers(column: FloatArray, heights: FloatArray) -> bool:
    """Return whether a column before heights, (k, n), numbers the rows or counts the heights."""
    if (column == heights.shape[1]).all():
        return True
    with np.errstate(over="ignore", invalid="ignore"):
        steps, last_steps = np.diff(column), np.diff(heights[:, -1])
        if not (steps > 0).all():
            return False
        is_even = np.ptp(steps) < MAX_NUMBER_UNEVENNESS * steps.mean()
        last_is_even = np.ptp(last_steps) <= MAX_NUMBER_UNEVENNESS * np.abs(last_steps).mean()
        low, high = np.nanmin(heights), np.nanmax(heights)
        is_far = column.min() > high + (high - low) or column.max() < low - (high - low)
    return bool((is_even and not last_is_even) or is_far)


def _transpose_labelled_rows(table: NumberTable) -> NumberTable:
    """Return the table whose columns are the rows of another one, named by its first column."""
    parsed = [split_label(label) for label in table.texts[0]]
    names = tuple(name for name, _ in parsed)
    units = tuple(unit for _, unit in parsed)
    return replace(
        table, values=table.values[:, 1:].T, names=names, units=units, texts={}, invalid_cells={}
    )


def are_heights(width: int, settings: ReadSettings) -> bool:
    """Return whether rows of `width` numbers without names are heights, not one point each."""
    return width >= MIN_COLUMNS or (settings.dx is not None and width not in (2, 3))


def profiles_from_matrix(table: NumberTable, settings: ReadSettings) -> RawProfiles:
    """Return the profiles of a matrix of heights, or of one row of x over rows of heights.

    Columns that are all named as ranges, such as range_0, hold ranges.

    Raises
    ------
    UnreadableFile
        If the spacing of the columns is not given (``dx``, ``--dx``) and no row states x, or if
        both do, or a number has thousands separators.
    """
    columns = _select_height_columns(table)
    _reject_numbers_in_text(table, columns)
    away, height_notes = _resolve_direction(table, columns, settings)
    left_out = [table.label(c) for c in range(table.values.shape[1]) if c not in columns]
    if left_out and not settings.transpose:
        note = f"no heights in column {', '.join(left_out)}: left out"
        table = replace(
            table,
            values=table.values[:, columns],
            units=tuple(table.units[c] for c in columns if table.units),
            notes=(*table.notes, note),
        )
    heights = table.values.T if settings.transpose else table.values
    if heights.shape[1] == 1:  # one column is one profile
        heights = heights.T
    hint, has_x = "", len(heights) > 2 and _is_x_row(heights)
    if settings.dx is not None and has_x:
        raise UnreadableFile("the first row is evenly spaced, as x: leave --dx out, or this row")
    if has_x:
        x, rows = heights[0], heights[1:]
        _reject_repeated_x(heights)
        notes: tuple[str, ...] = ("the first row is evenly spaced: read as x",)
    elif settings.dx is None and len(heights) == 2 and is_monotonic(heights[0]):
        x, rows = heights[0], heights[1:]
        notes = ("two rows: the first read as x, the other as z",)
    else:
        rows, hint = heights, "" if settings.transpose else _transpose_hint(*heights.shape)
        x, notes = compute_column_positions(heights.shape[1], len(heights), settings)
    x_in_mm = rows is heights
    return RawProfiles(
        sections=[np.column_stack([x, row]) for row in rows],
        units=("mm", settings.count_unit or _find_stated_unit(table, settings))
        if x_in_mm
        else _list_units_of_rows(table, settings),
        away=away,
        notes=(*table.notes, *notes, *filter(None, [hint]), *height_notes),
        lost=table.lost,
        limits=table.limits,
        x_in_mm=x_in_mm,
    )


def _reject_repeated_x(heights: FloatArray) -> None:
    """Raise an error if another row equals the first one, which is x: rows x, z, x, z, ..."""
    again = [row for row in range(1, len(heights)) if np.array_equal(heights[row], heights[0])]
    if again:
        raise UnreadableFile(
            f"row {again[0]} is evenly spaced as row 0, which is x: write x once, above the heights"
        )


def _select_height_columns(table: NumberTable) -> list[int]:
    """Return the columns of heights: those with names such as z_0, z_1; else those without times.

    A column of times is text with digits; other text may mark lost points.
    """
    columns = list(range(table.values.shape[1]))
    stems = list(map(_strip_number, table.names))
    stem, count = Counter(stems).most_common(1)[0] if stems else ("", 0)
    if 2 * count > len(columns):
        return [c for c in columns if stems[c] == stem]
    return [c for c in columns if not re.search("[0-9]", "".join(table.texts.get(c, ())))]


def _resolve_direction(
    table: NumberTable, columns: Sequence[int], settings: ReadSettings
) -> tuple[bool, tuple[str, ...]]:
    """Return the result of `resolve_direction`; heights are ranges if all columns are so named."""
    stems = [_strip_number(table.names[c]).rstrip(" _-[(") for c in columns if table.names]
    are_ranges = bool(stems) and all(find_role(stem) == "range" for stem in stems)
    return resolve_direction(table.mentions, settings, is_range=are_ranges)


def _reject_numbers_in_text(table: NumberTable, columns: Sequence[int]) -> None:
    """Raise an error for a number with thousands separators, or with other text beside heights.

    Other text marks lost points.
    """
    for column, cells in table.texts.items():
        cell_text = next(filter(holds_number, cells), None)
        if column not in columns and cell_text is not None:
            raise UnreadableFile(
                f"column {table.label(column)} holds numbers with other text ({cell_text[:40]!r}): "
                "write the numbers alone"
            )
    for column in columns:
        cell = table.invalid_cells.get(column)
        if cell is not None and cell.grouped:
            raise UnreadableFile(f"line {cell.row}: {cell.text[:40]!r} {cell.reason}")


def _strip_number(name: str) -> str:
    """Return the name of a column without the number at its end."""
    return _NUMBER_AT_END.sub("", name)


def compute_column_positions(
    columns: int, rows: int, settings: ReadSettings
) -> tuple[FloatArray, tuple[str, ...]]:
    """Return x of each column from the user's options, and a note if the first is assumed.

    Raises
    ------
    UnreadableFile
        If the user states no spacing.
    """
    if settings.dx is None:
        raise UnreadableFile(
            f"{format_count(rows, 'row')} of {columns} heights without x: "
            "give x of the first column and the spacing in mm, --x0 and --dx"
            + (f" ({hint})" if (hint := _transpose_hint(rows, columns)) else "")
        )
    x: FloatArray = (settings.x0 or 0.0) + settings.dx * np.arange(columns, dtype=np.float64)
    return x, () if settings.x0 is not None else ("x of the first column taken as 0 mm",)


def _find_stated_unit(table: NumberTable, settings: ReadSettings) -> str | None:
    """Return the unit of heights that the file states; None if the user states one in `units`."""
    if settings.units is not None:
        return None
    statements = select_for_axis(table.statements, "height")
    unit = find_common_unit(next(filter(None, table.units), None), statements)
    about_heights = [line for line in table.mentions if not _OTHER_AXIS.search(line.lower())]
    require_known_unit((None, unit), about_heights, settings)
    return unit


def _list_units_of_rows(
    table: NumberTable, settings: ReadSettings
) -> tuple[str | None, str | None]:
    """Return the units of a row of x and of the heights below it; `z_unit` is that of heights."""
    unit = _find_stated_unit(table, settings)
    if settings.count_unit is None:
        return unit, unit
    return unit or settings.units or "mm", settings.count_unit


def _transpose_hint(rows: int, columns: int) -> str:
    """Return a hint for tables that are much longer than wide; else an empty text."""
    if rows < 2 * columns or columns > MAX_HINTED_COLUMNS:
        return ""
    return f"{columns} columns of {rows}: profiles may lie in columns, use --transpose"


def _is_x_row(heights: FloatArray) -> bool:
    """Return whether the first row changes in equal steps, and most others are not monotonic."""
    with np.errstate(over="ignore", invalid="ignore"):
        steps = np.diff(heights[0])
        is_even = bool(np.all(np.abs(steps - steps.mean()) < MAX_UNEVENNESS * abs(steps.mean())))
    return is_even and 2 * sum(map(is_monotonic, heights[1:])) < len(heights) - 1


def is_monotonic(row: FloatArray) -> bool:
    """Return whether the numbers that are not lost increase or decrease strictly."""
    finite = row[np.isfinite(row)]
    return len(finite) > 1 and bool(
        np.all(finite[1:] > finite[:-1]) or np.all(finite[1:] < finite[:-1])
    )


def read_height_map(content: bytes, settings: ReadSettings) -> RawProfiles:
    """Return the profiles of an image of heights: counts of 16 or 32 bit, or floating point.

    Raises
    ------
    UnreadableFile
        If it is a photograph (8 bit, colours) or damaged, or its spacing or the size of a count
        is not given.
    """
    if settings.dx is None:
        raise UnreadableFile(
            "an image: of a laser line it needs its rig, lsvision measure --light-section "
            "rig.json; of heights it needs --x0, --dx and --z-unit"
        )
    try:
        image = decode_image(content)
    except TooManyPixels as error:
        raise UnreadableFile(f"{error}: cut it, or save its heights as NPY") from None
    if image is None or not image.size:
        raise UnreadableFile("an image that OpenCV cannot decode: save its heights as NPY or CSV")
    if image.ndim != 2 or image.dtype == np.uint8:
        channels = 1 if image.ndim == 2 else image.shape[2]
        raise UnreadableFile(
            f"an image of {channels} x {8 * image.dtype.itemsize} bit, no height map: expected one "
            "channel of 16 bit or floating point"
        )
    limits: tuple[float, ...] = ()
    if image.dtype.kind in "iu":
        if settings.z_unit is None and settings.units is None:
            raise UnreadableFile(
                "counts without their size: state the size of one, as --z-unit 0.5um or --units um"
            )
        type_limits = np.iinfo(image.dtype)
        limits = (float(type_limits.min), float(type_limits.max))
    return profiles_from_matrix(NumberTable(floats_from(image), limits=limits), settings)


def select_only_height(table: NumberTable) -> NumberTable | None:
    """Return the column of a table that is named as heights, ranges or y, if none is named x.

    Also the second of two columns without names, if the first numbers the points. None for another
    table, and if several columns are named as heights.
    """
    if not table.names and table.values.shape[1] == 2 and not table.invalid_cells:
        first = table.values[:, 0]
        if first[0] in (0, 1) and np.array_equal(first, first[0] + np.arange(len(first))):
            return replace(table, values=table.values[:, 1:])
    roles = list(map(find_role, table.names))
    named = [c for c, role in enumerate(roles) if role in HEIGHT_ROLES]
    if len(named) != 1 or "x" in roles or named[0] in table.texts:
        return None
    (column,) = named
    return replace(
        table,
        values=table.values[:, [column]],
        names=(table.names[column],),
        units=(table.units[column],),
        texts={},
        invalid_cells={},
    )
