"""Matrices of heights: one profile a row, x from the first column and the spacing."""

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.io.profiles.text_table import TextTable, decode_text, parse_table

MIN_COLUMNS = 21
"""A table as wide as this is a matrix of heights: no list of points has so many columns."""


def read_matrix(content: bytes, settings: ReadSettings) -> RawProfiles:
    """Profiles of a text with one row of heights each."""
    return profiles_from_matrix(parse_table(decode_text(content)), settings)


def profiles_from_matrix(table: TextTable, settings: ReadSettings) -> RawProfiles:
    """Profiles of a matrix of heights, or of one row of x over one row of heights.

    Raises
    ------
    UnreadableFile
        If the spacing of the columns is not given (``dx``, ``--dx``) and no row states x.
    """
    heights = table.values
    if heights.shape[1] == 1:
        heights = heights.T
    if settings.dx is None and len(heights) == 2 and _rises(heights[0]):
        return RawProfiles(
            sections=[heights.T], notes=("two rows: the first taken for x, the other for z",)
        )
    x, notes = column_positions(heights.shape[1], len(heights), settings)
    return RawProfiles(
        sections=[np.column_stack([x, row]) for row in heights],
        units=("mm", None),
        notes=notes,
        x_in_mm=True,
    )


def column_positions(
    columns: int, rows: int, settings: ReadSettings
) -> tuple[FloatArray, tuple[str, ...]]:
    """Where each column lies as the user states it, and a note where the first is assumed.

    Raises
    ------
    UnreadableFile
        If the user states no spacing.
    """
    if settings.dx is None:
        raise UnreadableFile(
            f"{rows} rows of {columns} heights without x: "
            "give x of the first column and the spacing in mm, --x0 and --dx"
        )
    x: FloatArray = (settings.x0 or 0.0) + settings.dx * np.arange(columns, dtype=np.float64)
    return x, () if settings.x0 is not None else ("x of the first column taken as 0 mm",)


def _rises(row: FloatArray) -> bool:
    steps = np.diff(row)
    return bool(np.all(steps > 0) or np.all(steps < 0))
