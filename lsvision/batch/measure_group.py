"""Measurement of a group of profiles at once, in which one profile may fail."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

from lsvision.errors import LsvisionError
from lsvision.measure import Measurement
from lsvision.profile import Profile

MAX_FLIP_CHECK_POINTS = 20_000
"""Largest number of points of a profile that are measured with the heights negated, as a check;
longer profiles are subsampled."""
MeasureFunction = Callable[[Sequence[Profile]], list[Measurement]]
"""Function that measures profiles: `measure_profiles` with its options filled in."""


def measure_group(
    measure: MeasureFunction, profiles: Sequence[Profile]
) -> list[Measurement | Exception]:
    """Measure profiles, if any, at once; if one of them fails, one by one.

    Return for each profile its measurement, or the exception that was raised; see
    `require_measurement`.
    """
    if not profiles:
        return []
    try:
        return list(measure(profiles))
    except Exception as error:  # noqa: BLE001 - a bug in one profile must not stop the others
        if len(profiles) == 1:
            return [error]
    return [result for profile in profiles for result in measure_group(measure, [profile])]


def require_measurement(
    result: Measurement | Exception, file: Path | str, profile: int
) -> Measurement:
    """Return a measurement from `measure_group`, or raise the exception in its place.

    The message of a `LsvisionError` names the file, and the index of the profile in it, from 0.
    """
    if isinstance(result, LsvisionError):
        raise LsvisionError(f"{file}, profile {profile}: {result}") from result
    if isinstance(result, Exception):
        raise result
    return result


def holds_cylinders_upside_down(measure: MeasureFunction, profile: Profile) -> bool:
    """Return whether cylinders are found in a profile after its heights are negated.

    Heights that grow away from the sensor look like this if they are taken to grow towards it.
    """
    step = max(math.ceil(len(profile) / MAX_FLIP_CHECK_POINTS), 1)
    mirrored = Profile(profile.points[::step] * (1.0, -1.0), lost=())
    try:
        (measurement,) = measure([mirrored])
    except LsvisionError:
        return False
    return bool(measurement.cylinders)
