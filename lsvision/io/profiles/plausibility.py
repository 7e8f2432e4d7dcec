"""Notes on profiles that look wrong: another unit, exchanged columns, no points."""

from collections.abc import Sequence

import numpy as np

from lsvision.errors import UnreadableFile
from lsvision.geometry import FloatArray
from lsvision.io.profiles.units import find_mm_per_unit
from lsvision.profile import Profile
from lsvision.statistics.rounding import find_rounding

_MAX_RANGE_MM = 1e4  # larger than the range of any profile sensor
_USUAL_MM = 1e3  # largest coordinate of most profiles
_FINER_UNITS = ("um", "10nm")  # the first with which coordinates are below _USUAL_MM is suggested
_MIN_ORDERED_POINTS = 20  # smallest number of points whose order distinguishes x from height
_STEADY_FRACTIONS = (0.1, 0.9)  # of rising steps; outside, most steps have the same direction
_MIN_WHOLE_POINTS, _MIN_WHOLE_HEIGHTS = 20, 10  # of a profile, and of its different heights
_WRAPPED_BITS = (16, 32)  # of integers without a sign
_MIN_WRAPPED_RATIO = 4.0  # of the span of wrapped heights to that of the right ones
_MIN_WIDTH_MM = 1.0  # narrower than the field of any profile sensor
_MAX_LIDAR_EXTENT = 10.0  # coordinates up to this may be metres of a lidar, or mm of a sensor


_Extent = tuple[FloatArray, FloatArray] | None


def find_extent(profiles: tuple[Profile, ...]) -> _Extent:
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


def reject_wrapped_numbers(sections: Sequence[FloatArray]) -> None:
    """Raise UnreadableFile if negative heights were written as integers without a sign.

    They are then 2^16 or 2^32 too large, and far above the others. The sections, (n, 2) or (n, 3),
    are in the units of the file.
    """
    heights = np.concatenate([section[:, -1] for section in sections] or [np.empty(0)])
    heights = heights[np.isfinite(heights)]
    if not len(heights) or heights.min() < 0 or heights.max() < 2 ** (_WRAPPED_BITS[0] - 1):
        return
    for bits in _WRAPPED_BITS:
        is_high = heights >= 2 ** (bits - 1)
        if heights.max() >= 2**bits or is_high.all() or not is_high.any():
            continue
        high, low = heights[is_high], heights[~is_high]
        span = low.max() - (high.min() - 2**bits)
        if high.min() < high.max() and _MIN_WRAPPED_RATIO * span < np.ptp(heights):
            raise UnreadableFile(
                f"heights of {low.min():g} to {low.max():g} and of {high.min():g} to "
                f"{high.max():g}: negative numbers were written as {bits}-bit integers without a "
                f"sign: subtract {2**bits} from these"
            )


def find_unit_warnings(
    profiles: tuple[Profile, ...], extent: _Extent, stated: str
) -> tuple[str, ...]:
    """Return a note if coordinates exceed the range of any sensor, or the width is below its field.

    Without a stated unit also if all heights are whole numbers. `extent` is that of `find_extent`,
    `stated` the unit that the file or the caller states, which the note then suggests to check; if
    it is empty, another unit.
    """
    if extent is None:
        return ()
    low, high = extent
    farthest = float(np.abs([low, high]).max())
    if farthest > _MAX_RANGE_MM:
        unit = next(
            (unit for unit in _FINER_UNITS if farthest * find_mm_per_unit(unit) < _USUAL_MM), "nm"
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
    profiles: tuple[Profile, ...], extent: _Extent, *, assumed: bool, has_x: bool
) -> tuple[str, ...]:
    """Return notes on rounding, points of a lidar, exchanged columns, numbers as x, empty profiles.

    Profiles are in the section frame. If the units are not `assumed`, the file probably names its
    columns, and only rounding and empty profiles are noted. `has_x` is false if the user stated x.
    """
    if extent is None:
        return ()
    low, high = extent
    size = f"{high[0] - low[0]:.3g} x {high[1] - low[1]:.3g}"
    notes = []
    step = find_rounding([profile.points[:, 1] for profile in profiles])
    if step is not None:
        notes.append(
            f"the heights are rounded to {step:.3g} mm, more than their noise, which is taken to "
            f"be {step / np.sqrt(12):.2g} mm where no sensor is stated: export more decimals"
        )
    wide_enough = high[0] - low[0] >= _MIN_WIDTH_MM
    if assumed and wide_enough and float(np.abs([low, high]).max()) <= _MAX_LIDAR_EXTENT:
        notes.append(f"the points span {size} mm: if these are metres of a lidar, use --units m")
    if assumed and any(map(_seems_exchanged, profiles)):
        notes.append(
            "the heights rise or fall steadily and x does not: if the columns are exchanged, use "
            "--columns 1,0"
        )
    if assumed and has_x and all(map(_is_numbered, profiles)):
        notes.append(
            "x is a whole number that rises by 1: if it numbers the points, write their x, or "
            "state it with --x0 and --dx"
        )
    return (*notes, *note_empty_profiles(count_empty_profiles(profiles), len(profiles)))


def count_empty_profiles(profiles: tuple[Profile, ...]) -> int:
    """Return the number of profiles without a valid point."""
    return sum(profile.lost == len(profile) for profile in profiles)


def note_empty_profiles(empty: int, count: int) -> tuple[str, ...]:
    """Return a note on the empty ones of `count` profiles, if there are any."""
    return (f"{empty} of {count} profiles hold no point",) if empty else ()


def _seems_exchanged(profile: Profile) -> bool:
    """Return whether the heights are monotonic, as x should be, and x is not."""
    x, height = profile.points[~np.isnan(profile.points[:, 0])].T
    steps, height_steps = np.diff(x), np.diff(height)
    is_monotonic = bool((height_steps > 0).all() or (height_steps < 0).all())
    rising_fraction = np.mean(steps > 0) if len(steps) else 0.0
    low, high = _STEADY_FRACTIONS
    return len(x) >= _MIN_ORDERED_POINTS and is_monotonic and low < rising_fraction < high


def _is_numbered(profile: Profile) -> bool:
    """Return whether x is 0, 1, 2, ... or 1, 2, 3, ... and the heights are no whole numbers."""
    x, height = profile.points.T
    known = np.isfinite(x)
    expected = np.arange(len(x))[known]
    is_numbered = any(np.array_equal(x[known], expected + start) for start in (0, 1))
    has_decimals = not np.array_equal(height[known], np.round(height[known]))
    return len(expected) >= _MIN_ORDERED_POINTS and is_numbered and has_decimals
