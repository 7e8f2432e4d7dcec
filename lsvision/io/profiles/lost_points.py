"""Points that a file marks as lost by a value: stated by the user or the file, or guessed."""

from dataclasses import dataclass

import numpy as np

from lsvision.geometry import BoolArray, FloatArray
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.statistics.lost_markers import find_lost_markers

KEYENCE_LOST = (-99999.9999, -99999.999, -99999.99, -99999.9)
"""Markers of Keyence controllers with different numbers of digits; never a height."""
_TOLERANCE = 1e-7  # of a marker, relative: more digits than single precision has


@dataclass(frozen=True)
class LostMarker:
    """A value that marks lost points.

    Parameters
    ----------
    text : str
        The value in the units of the file; ``"0, 0"`` where both coordinates are 0.
    count : int
        Number of points that it marks.
    guessed : bool
        True if neither the file nor the user states it.
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
    """Return sections with NaN in place of markers, and the markers.

    If the user states markers, only these are used; otherwise the markers that the file states,
    well-known ones, and values that look like a marker, see `find_lost_markers`.

    Parameters
    ----------
    raw : RawProfiles
        Sections in the units of the file.
    settings : ReadSettings
        Reading options with the markers that the user states.
    """
    sections = [  # one quiet NaN for all: arithmetic with a signalling one warns
        section if np.isfinite(section).all() else np.where(np.isfinite(section), section, np.nan)
        for section in raw.sections
    ]
    points = sections[0] if len(sections) == 1 else np.concatenate(sections or [np.empty((0, 2))])
    height = points.shape[1] - 1
    lost = np.zeros(len(points), dtype=bool)
    markers: list[LostMarker] = []

    def mark(text: str, rows: BoolArray, *, guessed: bool) -> None:
        unmarked = rows & ~lost
        if unmarked.any():
            markers.append(LostMarker(text, int(unmarked.sum()), guessed))
            lost[unmarked] = True

    if settings.lost_values is not None:
        for value in settings.lost_values:
            mark(f"{value:.10g}", _holds_marker(points, value), guessed=False)
    else:
        lowest = float(np.fmin.reduce(points, axis=None, initial=0.0))
        well_known = KEYENCE_LOST if lowest <= max(KEYENCE_LOST) * (1 - _TOLERANCE) else ()
        for value in (*raw.lost, *well_known):
            mark(f"{value:.10g}", _holds_marker(points, value), guessed=False)
        if not points.all():
            zero_rows = np.concatenate([_repeated_zeros(section) for section in sections])
            mark(", ".join("0" * points.shape[1]), zero_rows, guessed=False)
        remaining = np.where(lost[:, np.newaxis], np.nan, points) if lost.any() else points
        for axis in range(height, -1, -1):
            guesses = find_lost_markers(
                remaining[:, axis],
                limits=raw.limits if axis else (),
                is_range=raw.away and axis == height,
            )
            for value in guesses:
                mark(f"{value:.10g}", np.equal(remaining[:, axis], value), guessed=True)
    if not lost.any():
        return sections, ()
    cleaned = np.where(lost[:, np.newaxis], np.nan, points)
    return np.split(cleaned, np.cumsum([len(s) for s in sections])[:-1]), tuple(markers)


def _holds_marker(points: FloatArray, value: float) -> BoolArray:
    """Return whether a coordinate of each point is a marker, (n,)."""
    marked: BoolArray = np.any(np.abs(points - value) <= _TOLERANCE * abs(value), axis=1)
    return marked


def _repeated_zeros(section: FloatArray) -> BoolArray:
    """Return the rows of 0, 0 (lost points of Leuze sensors), (n,); a single one may be a point."""
    zero_rows: BoolArray = np.all(np.equal(section, 0), axis=1)
    return zero_rows if zero_rows.sum() > 1 else np.zeros(len(zero_rows), dtype=bool)
