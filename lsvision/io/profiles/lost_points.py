"""Points that a file marks as lost by a value: stated by the user or the file, or guessed."""

from dataclasses import dataclass

import numpy as np

from lsvision.geometry import BoolArray, FloatArray
from lsvision.io.profiles.settings import RawProfiles, ReadSettings
from lsvision.statistics.lost_markers import find_lost_markers

KEYENCE_LOST = (-99999.9999, -99999.999, -99999.99, -99999.9)
"""Markers of Keyence controllers, by the number of digits; never a height."""
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
            f"{self.text} occurs in {self.count} points, far from the rest: taken for lost points "
            "(--lost none if it is measured)"
        )


def remove_lost(
    raw: RawProfiles, settings: ReadSettings
) -> tuple[list[FloatArray], tuple[LostMarker, ...]]:
    """Return sections with NaN in place of markers, and the markers.

    A marker that the user states is the only one; otherwise those that the file states, well-known
    ones, and values that look like one, see `find_lost_markers`.

    Parameters
    ----------
    raw : RawProfiles
        Sections in the units of the file.
    settings : ReadSettings
        Gives the user's markers.
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
        fresh = rows & ~lost
        if fresh.any():
            markers.append(LostMarker(text, int(fresh.sum()), guessed))
            lost[fresh] = True

    if settings.lost_values is not None:
        for value in settings.lost_values:
            mark(f"{value:.10g}", _has(points, value), guessed=False)
    else:
        lowest = float(np.fmin.reduce(points, axis=None, initial=0.0))
        known = KEYENCE_LOST if lowest <= max(KEYENCE_LOST) * (1 - _TOLERANCE) else ()
        for value in (*raw.lost, *known):
            mark(f"{value:.10g}", _has(points, value), guessed=False)
        if not points.all():
            zero = np.concatenate([_repeated_zeros(section) for section in sections])
            mark(", ".join("0" * points.shape[1]), zero, guessed=False)
        left = np.where(lost[:, np.newaxis], np.nan, points) if lost.any() else points
        for axis in range(height, -1, -1):
            guesses = find_lost_markers(
                left[:, axis],
                limits=raw.limits if axis else (),
                is_range=raw.away and axis == height,
            )
            for value in guesses:
                mark(f"{value:.10g}", np.equal(left[:, axis], value), guessed=True)
    if not lost.any():
        return sections, ()
    kept = np.where(lost[:, np.newaxis], np.nan, points)
    return np.split(kept, np.cumsum([len(s) for s in sections])[:-1]), tuple(markers)


def _has(points: FloatArray, value: float) -> BoolArray:
    near: BoolArray = np.any(np.abs(points - value) <= _TOLERANCE * abs(value), axis=1)
    return near


def _repeated_zeros(section: FloatArray) -> BoolArray:
    """Return several rows of 0, 0, as Leuze writes lost points; a single one may be a point."""
    zero: BoolArray = np.all(np.equal(section, 0), axis=1)
    return zero if zero.sum() > 1 else np.zeros(len(zero), dtype=bool)
