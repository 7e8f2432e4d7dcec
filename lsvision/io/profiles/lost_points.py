"""Points that a file marks as lost by a value: stated by the user or the file, or guessed."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import BoolArray, FloatArray
from lsvision.io.profiles.interrupting_markers import find_interrupting_values, find_repeated_value
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.statistics.lost_markers import find_lost_markers
from lsvision.statistics.rounding import find_rounding

KEYENCE_LOST = (-99999.9999, -99999.999, -99999.99, -99999.9)
"""Markers of Keyence controllers with different numbers of digits; never a height."""
MIN_ZEROS = 3
"""Smallest number of heights of 0 that are noted when they are read as points."""
MIN_ZERO_DISTANCE = 0.1
"""Smallest distance of all other heights from 0, in spans of these, from which zeros are noted."""
SAMPLE_PROFILES = 20
"""Number of profiles of a file in which repeated heights are searched."""
_RELATIVE_TOLERANCE = 1e-7
"""Largest deviation of a marker, relative: single precision rounds to 6e-8."""


class AllPointsLost(UnreadableFile):
    """A file of profiles without a valid point; in a scan they are sections without points."""

    sections: int = 1
    """Number of its profiles."""


@dataclass(frozen=True)
class LostMarker:
    """A value that marks lost points, in the units of the file; ``"0, 0"`` if both are 0.

    It marks `count` points, and is `guessed` if neither the file nor the user states it; such a one
    is far from all other values, or `interrupts` a surface that goes on behind it.
    """

    text: str
    count: int
    guessed: bool
    interrupts: bool = False

    @property
    def note(self) -> str:
        """Note on a guessed marker."""
        where = "interrupts the surface" if self.interrupts else "far from the rest"
        return (
            f"{self.text} occurs in {self.count} points, {where}: read as lost points "
            "(use --lost none if it is a measured value)"
        )


def remove_lost(
    raw: RawProfiles, settings: ReadSettings
) -> tuple[list[FloatArray], tuple[LostMarker, ...]]:
    """Return sections with NaN in place of lost points (markers and infinities), and the markers.

    If the user states markers, only these are used; otherwise the markers that the file states,
    well-known ones, and values that look like a marker, see `find_lost_markers`. The sections, (n,
    2) or (n, 3), stay in the units of the file. The markers are in the order in which they were
    applied; each counts the points that no earlier one marks.
    """
    sections = [  # one quiet NaN for all: arithmetic with a signalling one warns
        section if np.isfinite(section).all() else np.where(np.isfinite(section), section, np.nan)
        for section in raw.sections
    ]
    points = sections[0] if len(sections) == 1 else np.concatenate(sections or [np.empty((0, 2))])
    marked = _MarkedPoints(points)
    if settings.lost_values is not None:
        marked.add_values(settings.lost_values)
    else:
        marked.add_values((*raw.lost, *_find_keyence_markers(points)))
        if not points.all():  # there is a 0
            zero_rows = np.concatenate([_find_repeated_zeros(section) for section in sections])
            marked.add(", ".join(["0"] * points.shape[1]), zero_rows, guessed=False)
        _add_interrupting(marked, sections)
        _add_guesses(marked, raw, is_range=raw.away and settings.flip is not False)
    if not marked.lost.any():
        return sections, ()
    stops = np.cumsum([len(section) for section in sections])
    return np.split(marked.remaining, stops[:-1]), tuple(marked.markers)


class _MarkedPoints:
    """Points, the markers found in them so far, and a mask of the points that these mark."""

    def __init__(self, points: FloatArray) -> None:
        self.points = points
        self.markers: list[LostMarker] = []
        self.lost: BoolArray = np.zeros(len(points), dtype=bool)

    @property
    def remaining(self) -> FloatArray:
        """The points, NaN where marked."""
        if not self.lost.any():
            return self.points
        return np.where(self.lost[:, np.newaxis], np.nan, self.points)

    def add(self, text: str, rows: BoolArray, *, guessed: bool, interrupts: bool = False) -> None:
        """Mark some rows, and add the marker if they were not all marked before."""
        unmarked = rows & ~self.lost
        if unmarked.any():
            self.markers.append(LostMarker(text, int(unmarked.sum()), guessed, interrupts))
            self.lost |= unmarked

    def add_values(self, values: Iterable[float]) -> None:
        """Mark the points whose height is one of the values: an x of -1 or 0 may be measured."""
        for value in values:
            deviation = np.abs(self.points[:, -1] - value)
            is_marker: BoolArray = deviation <= _RELATIVE_TOLERANCE * abs(value)
            self.add(f"{value:.10g}", is_marker, guessed=False)


def _find_keyence_markers(points: FloatArray) -> tuple[float, ...]:
    """Return `KEYENCE_LOST` if a number is low enough to be one of them: most files have none."""
    lowest = float(np.fmin.reduce(points, axis=None, initial=0.0))
    return KEYENCE_LOST if lowest <= max(KEYENCE_LOST) * (1 - _RELATIVE_TOLERANCE) else ()


def _add_guesses(marked: _MarkedPoints, raw: RawProfiles, *, is_range: bool) -> None:
    """Mark the points with a coordinate that looks like a marker, first the heights."""
    remaining = marked.remaining
    height = remaining.shape[1] - 1
    for axis in range(height, -1, -1):
        guesses = find_lost_markers(
            remaining[:, axis],
            limits=raw.limits if axis > 0 else (),  # x may be computed: the limits are of heights
            is_range=is_range and axis == height,
        )
        for value in guesses:
            marked.add(f"{value:.10g}", np.equal(remaining[:, axis], value), guessed=True)


def _add_interrupting(marked: _MarkedPoints, sections: Sequence[FloatArray]) -> None:
    """Mark the heights that interrupt the surface of a profile, in that profile."""
    heights = [section[:, -1] for section in sections]
    for value, is_marker in sorted(find_interrupting_values(heights).items()):
        rows = [np.equal(z, value) & found for z, found in zip(heights, is_marker, strict=True)]
        marked.add(f"{value:.10g}", np.concatenate(rows), guessed=True, interrupts=True)


def _find_repeated_zeros(section: FloatArray) -> BoolArray:
    """Return the rows of 0, 0 (lost points of Leuze sensors), (n,); a single one may be a point."""
    zero_rows: BoolArray = np.all(np.equal(section, 0), axis=1)
    return zero_rows if zero_rows.sum() > 1 else np.zeros(len(zero_rows), dtype=bool)


def note_repeated(sections: list[FloatArray]) -> tuple[str, ...]:
    """Return a note on a height read as points that may mark lost ones.

    It occurs much more often than others, which are not rounded; or it is 0, several times, and
    apart from all others.
    """
    columns = [section[:, -1] for section in sections]
    heights = np.concatenate([*columns, np.empty(0)])
    heights = heights[np.isfinite(heights)]
    others = np.abs(heights[heights != 0])
    count = len(heights) - len(others)
    apart = ""
    if count >= MIN_ZEROS and len(others):
        is_apart = others.min() > MIN_ZERO_DISTANCE * (others.max() - others.min())
        apart = ", apart from all others" if is_apart else ""
    value = (
        0.0
        if apart
        else find_repeated_value(np.concatenate([*columns[:SAMPLE_PROFILES], np.empty(0)]))
    )
    if value is None or not (apart or find_rounding(columns) is None):
        return ()
    count = int(np.count_nonzero(heights == value))
    return (
        f"the height is {value:.10g} in {count} points{apart or ', and none else so often'}: read "
        f"as points (use --lost {value:.10g} if it marks lost points)",
    )
