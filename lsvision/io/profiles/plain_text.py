"""Plain text: x and height (or x, y and z) of one point per line, or lines of heights.

Also the texts of Keyence LJ-V and LJ-X: raw 16-bit heights, and the exporter's lines of x and z.
"""

import dataclasses
from functools import partial

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.io.profiles.column_roles import names_section
from lsvision.io.profiles.columns import profiles_from_table
from lsvision.io.profiles.matrix import (
    are_heights,
    profiles_from_matrix,
    profiles_from_text_matrix,
    select_only_height,
)
from lsvision.io.profiles.pose_documents import reject_pose_text
from lsvision.io.profiles.settings import MM_PER_KEYENCE_STEP, RawProfiles, ReadSettings
from lsvision.io.profiles.stated_positions import read_with_stated_positions
from lsvision.io.profiles.text_encoding import decode_text
from lsvision.io.profiles.text_table import parse_table

_ZERO_COUNT, _LOST_COUNT = 32768, 0
"""Counts of Keyence for a height of 0 and for a lost point."""


def read_plain_text(content: bytes, settings: ReadSettings) -> RawProfiles:
    r"""Return the profiles of a table of points, or of a matrix of heights.

    A table is a matrix if it is to be transposed; or if its columns are not named as x and height,
    and it has at least `MIN_COLUMNS` of them, or the spacing ``dx`` of other than 2 or 3. With
    ``dx``, a table whose header names one column of heights or ranges and no x has one profile.
    Where heights have no x, and the text states its start and step, these are used.

    Raises
    ------
    UnreadableFile
        If it is no table of numbers, or ``dx`` is given for a table of points with x.

    Examples
    --------
    >>> raw = read_plain_text(b"x [mm], range [mm]\n0, 400\n1, 399\n", ReadSettings())
    >>> raw.units, raw.away
    (('mm', 'mm'), True)
    """
    text = decode_text(content)
    try:
        return read_with_stated_positions(
            partial(_profiles_from_text, text), text.splitlines, settings
        )
    except UnreadableFile:
        reject_pose_text(text)
        raise


def _profiles_from_text(text: str, settings: ReadSettings) -> RawProfiles:
    """Return the profiles of a table of points or a matrix; see `read_plain_text`."""
    table = parse_table(text, settings.lost_words)
    is_matrix = settings.transpose or (
        are_heights(table.values.shape[1], settings) and not names_section(table.names)
    )
    if is_matrix and settings.columns is None:
        return profiles_from_text_matrix(table, settings)
    if settings.dx is not None and settings.columns is None:
        height = select_only_height(table)
        if height is None:
            raise UnreadableFile(
                f"{table.values.shape[1]} columns, but --dx is for heights without x: leave it out "
                "if the file has x, or write decimals with a point"
            )
        return profiles_from_matrix(height, settings)
    return profiles_from_table(table, settings)


def read_keyence_raw(content: bytes, settings: ReadSettings) -> RawProfiles:
    """Return the profiles of 16-bit counts, one per row; the count 0 is a lost point.

    Definition: x = XStart + k XPitch for column k, height = (count - 32768) ZUnit.

    Raises
    ------
    UnreadableFile
        If `settings` lack the controller's scales, which the file does not hold, or state a unit.
    """
    if settings.x_start is None or settings.x_pitch is None or settings.height_scale is None:
        raise UnreadableFile(
            "raw Keyence counts without their scale: give XStart, XPitch and ZUnit of the "
            "controller (0.01 um) with --x-start, --x-pitch and --z-unit"
        )
    if settings.units is not None:
        raise UnreadableFile(
            "raw Keyence counts, whose scale is given by --x-pitch and --z-unit: leave --units out"
        )
    counts = parse_table(decode_text(content)).values
    x = (settings.x_start + settings.x_pitch * np.arange(counts.shape[1])) * MM_PER_KEYENCE_STEP
    heights = (counts - _ZERO_COUNT) * settings.height_scale
    heights[counts == _LOST_COUNT] = np.nan
    return RawProfiles(sections=[np.column_stack([x, row]) for row in heights], units=("mm", "mm"))


def read_keyence(content: bytes, settings: ReadSettings) -> RawProfiles:
    """Return the profile of the exporter's UTF-16 lines of x and z, in mm by default."""
    raw = read_plain_text(content, settings)
    return dataclasses.replace(raw, units=(raw.units[0] or "mm", raw.units[1] or "mm"))
