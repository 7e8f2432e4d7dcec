"""Notes on profiles that look wrong: another unit, exchanged columns, no points."""

import numpy as np

from lsvision.geometry import FloatArray
from lsvision.io.profiles.units import mm_per_unit
from lsvision.profile import Profile

_MAX_RANGE_MM = 1e4  # larger than the range of any profile sensor
_USUAL_MM = 1e3  # largest coordinate of most profiles
_FINER_UNITS = ("um", "10nm")  # the first with which coordinates are below _USUAL_MM is suggested
_MIN_ORDERED_POINTS = 20  # smallest number of points whose order distinguishes x from height
_STEADY_FRACTIONS = (0.1, 0.9)  # of rising steps; outside, most steps have the same direction
_MIN_WHOLE_POINTS, _MIN_WHOLE_HEIGHTS = 20, 10  # of a profile, and of its different heights
_MIN_WIDTH_MM = 1.0  # narrower than the field of any profile sensor
_MAX_LIDAR_EXTENT = 10.0  # coordinates up to this may be metres of a lidar, or mm of a sensor


def find_extent(profiles: tuple[Profile, ...]) -> tuple[FloatArray, FloatArray] | None:
    """Return the smallest and the largest (x, height); None if all points are lost. Units: mm."""
    valid_points = [
        profile.points[~np.isnan(profile.points[:, 0])] if profile.lost else profile.points
        for profile in profiles
    ]
    columns = [points.T for points in valid_points if len(points)]
    if not columns:
        return None
    low = [min(float(column[axis].min()) for column in columns) for axis in (0, 1)]
    high = [max(float(column[axis].max()) for column in columns) for axis in (0, 1)]
    return np.array(low), np.array(high)


def find_unit_warnings(profiles: tuple[Profile, ...], stated: str) -> tuple[str, ...]:
    """Return a note if coordinates exceed the range of any sensor, or the width is below its field.

    Without a stated unit also if all heights are whole numbers. `stated` is the unit that the file
    or the caller states, which the note then suggests to check; if it is empty, another unit.
    """
    extent = find_extent(profiles)
    if extent is None:
        return ()
    low, high = extent
    farthest = float(np.abs([low, high]).max())
    if farthest > _MAX_RANGE_MM:
        unit = next(
            (unit for unit in _FINER_UNITS if farthest * mm_per_unit(unit) < _USUAL_MM), "nm"
        )
        problem = f"coordinates reach {farthest:.3g} mm"
        remedy = f"if the unit is another, see --units {unit}"
    elif high[0] - low[0] < _MIN_WIDTH_MM:
        problem = f"the profile is {high[0] - low[0]:.3g} mm wide"
        remedy = "if it is in metres, see --units m"
    else:
        return () if stated else _find_count_warnings(profiles)
    if stated:
        remedy = f"check the stated unit ({stated}), see --units"
    return (f"{problem}: {remedy}",)


def _find_count_warnings(profiles: tuple[Profile, ...]) -> tuple[str, ...]:
    """Return a warning if all heights are whole numbers: counts, or rounded to whole mm.

    A few heights may be whole by chance, or the steps of an object.
    """
    heights = np.concatenate([profile.points[:, 1] for profile in profiles])
    heights = heights[np.isfinite(heights)]
    if len(heights) < _MIN_WHOLE_POINTS or not np.array_equal(heights, np.round(heights)):
        return ()
    if len(np.unique(heights)) < _MIN_WHOLE_HEIGHTS:
        return ()
    return (
        "the heights are whole numbers without a unit, as counts of a sensor are: state the size "
        "of a count, see --units 0.1mm",
    )


def find_other_problems(
    low: FloatArray, high: FloatArray, profiles: tuple[Profile, ...], *, assumed: bool
) -> tuple[str, ...]:
    """Return notes on points of a lidar, exchanged columns and empty profiles.

    Profiles are in the section frame; `low` and `high` are as for `find_unit_warnings`. If the
    units are not `assumed`, the file probably names its columns, and only empty profiles are noted.
    """
    size = f"{high[0] - low[0]:.3g} x {high[1] - low[1]:.3g}"
    notes = []
    wide_enough = high[0] - low[0] >= _MIN_WIDTH_MM
    if assumed and wide_enough and float(np.abs([low, high]).max()) <= _MAX_LIDAR_EXTENT:
        notes.append(f"the points span {size} mm: if these are metres of a lidar, use --units m")
    if assumed and any(map(_seems_exchanged, profiles)):
        notes.append(
            "the heights rise or fall steadily and x does not: if the columns are exchanged, use "
            "--columns 1,0"
        )
    empty = sum(profile.lost == len(profile) for profile in profiles)
    if empty:
        notes.append(f"{empty} of {len(profiles)} profiles hold no point")
    return tuple(notes)


def _seems_exchanged(profile: Profile) -> bool:
    """Return whether the heights are monotonic, as x should be, and x is not."""
    x, height = profile.points[~np.isnan(profile.points[:, 0])].T
    steps, height_steps = np.diff(x), np.diff(height)
    is_monotonic = bool((height_steps > 0).all() or (height_steps < 0).all())
    rising_fraction = np.mean(steps > 0) if len(steps) else 0.0
    low, high = _STEADY_FRACTIONS
    return len(x) >= _MIN_ORDERED_POINTS and is_monotonic and low < rising_fraction < high
