"""Points that a file marks as lost by a value: stated by the user or the file, or guessed."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import BoolArray, FloatArray
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.statistics.lost_markers import find_lost_markers

KEYENCE_LOST = (-99999.9999, -99999.999, -99999.99, -99999.9)
"""Markers of Keyence controllers with different numbers of digits; never a height."""
MIN_INTERRUPTIONS = 3
"""Smallest number of places at which a height of 0 interrupts a surface that goes on behind it,
from which on 0 marks lost points: hardly an object has so many slots with a floor at 0."""
MAX_INTERRUPTION = 3
"""Largest number of points of such a place: between two pipes, more points lie on a floor."""
MAX_STEP_RATIO = 0.25
"""Largest step of the surface across such a place, relative to its distance from 0."""
MIN_ZEROS = 3
"""Smallest number of heights of 0 that are noted when they are read as points."""
MIN_ZERO_DISTANCE = 0.1
"""Smallest distance of all other heights from 0, in spans of these, from which zeros are noted."""
_TOLERANCE = 1e-7  # of a marker, relative: a little more than single precision rounds, 6e-8


class AllPointsLost(UnreadableFile):
    """A file of profiles without a valid point; in a scan they are sections without points."""

    sections: int = 1
    """Number of its profiles."""


@dataclass(frozen=True)
class LostMarker:
    """A value that marks lost points, in the units of the file; ``"0, 0"`` if both are 0.

    It marks `count` points, and is `guessed` if neither the file nor the user states it.
    """

    text: str
    count: int
    guessed: bool

    @property
    def note(self) -> str:
        """Note on a guessed marker."""
        return (
            f"{self.text} occurs in {self.count} points, far from the rest: read as lost points "
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
        marked.add_values((*raw.lost, *_keyence_markers(points)))
        if not points.all():  # there is a 0
            zero_rows = np.concatenate([_repeated_zeros(section) for section in sections])
            marked.add(", ".join(["0"] * points.shape[1]), zero_rows, guessed=False)
        if not points[:, -1].all():
            interrupting = np.concatenate([_interrupting_zeros(section) for section in sections])
            marked.add("0", interrupting, guessed=True)
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

    def add(self, text: str, rows: BoolArray, *, guessed: bool) -> None:
        """Mark some rows, and add the marker if they were not all marked before."""
        unmarked = rows & ~self.lost
        if unmarked.any():
            self.markers.append(LostMarker(text, int(unmarked.sum()), guessed))
            self.lost |= unmarked

    def add_values(self, values: Iterable[float]) -> None:
        """Mark the points whose height is one of the values: an x of -1 or 0 may be measured."""
        for value in values:
            is_marker: BoolArray = np.abs(self.points[:, -1] - value) <= _TOLERANCE * abs(value)
            self.add(f"{value:.10g}", is_marker, guessed=False)


def _keyence_markers(points: FloatArray) -> tuple[float, ...]:
    """Return `KEYENCE_LOST` if a number is low enough to be one of them: most files have none."""
    lowest = float(np.fmin.reduce(points, axis=None, initial=0.0))
    return KEYENCE_LOST if lowest <= max(KEYENCE_LOST) * (1 - _TOLERANCE) else ()


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


def _repeated_zeros(section: FloatArray) -> BoolArray:
    """Return the rows of 0, 0 (lost points of Leuze sensors), (n,); a single one may be a point."""
    zero_rows: BoolArray = np.all(np.equal(section, 0), axis=1)
    return zero_rows if zero_rows.sum() > 1 else np.zeros(len(zero_rows), dtype=bool)


def _interrupting_zeros(section: FloatArray) -> BoolArray:
    """Return the points of height 0 if these interrupt the surface in several places, else none.

    Surfaces go on behind them at a similar height, far from 0; (n,).
    """
    heights = section[:, -1]
    zero: BoolArray = np.equal(heights, 0)
    others_at = np.flatnonzero(~zero)
    gaps = np.diff(others_at)
    ends = np.flatnonzero((gaps > 1) & (gaps <= MAX_INTERRUPTION + 1))
    before, after = heights[others_at[ends]], heights[others_at[ends + 1]]
    distance = np.minimum(np.abs(before), np.abs(after))
    with np.errstate(invalid="ignore", over="ignore"):
        goes_on = np.abs(after - before) < MAX_STEP_RATIO * distance
    others = np.abs(heights[others_at][np.isfinite(heights[others_at])])
    apart = len(others) > 0 and others.min() > MAX_STEP_RATIO * np.median(others)
    return zero if apart and goes_on.sum() >= MIN_INTERRUPTIONS else np.zeros_like(zero)


def note_zeros(sections: list[FloatArray]) -> tuple[str, ...]:
    """Return a note if many heights are 0, apart from all others: read as points, perhaps lost."""
    heights = np.concatenate([section[:, -1] for section in sections] or [np.empty(0)])
    heights = heights[np.isfinite(heights)]
    others = np.abs(heights[heights != 0])
    count = len(heights) - len(others)
    if count < MIN_ZEROS or not len(others):
        return ()
    if not others.min() > MIN_ZERO_DISTANCE * (others.max() - others.min()):
        return ()
    return (
        f"the height is 0 in {count} points, apart from all others: read as points (use --lost 0 "
        "if it marks lost points)",
    )
