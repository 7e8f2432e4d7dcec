"""Keyence LJ-V and LJ-X: raw 16-bit heights, and the exporter's lines of x and z."""

import dataclasses

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.io.profiles.plain_text import read_plain_text
from lsvision.io.profiles.settings import MM_PER_KEYENCE_STEP, RawProfiles, ReadSettings
from lsvision.io.profiles.text_encoding import decode_text
from lsvision.io.profiles.text_table import parse_table

_ZERO_COUNT = 32768  # height 0
_LOST_COUNT = 0


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
