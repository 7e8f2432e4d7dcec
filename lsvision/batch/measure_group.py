"""Measurement of a group of profiles at once, in which one profile may fail."""

from collections.abc import Callable, Sequence

from lsvision.errors import LsvisionError
from lsvision.measure import Measurement
from lsvision.profile import Profile

MAX_FLIP_CHECK_POINTS = 20_000
"""Largest number of points of a profile that is measured upside down as a check; longer profiles
are subsampled."""
MeasureFunction = Callable[[Sequence[Profile]], list[Measurement]]
"""Function that measures profiles: `measure_profiles` with its options filled in."""


def measure_group(
    measure: MeasureFunction, profiles: Sequence[Profile]
) -> list[Measurement | Exception]:
    """Measure profiles at once; if one of them fails, one by one.

    Parameters
    ----------
    measure : callable
        Function that measures profiles.
    profiles : sequence of Profile
        The profiles.

    Returns
    -------
    list of Measurement or Exception
        For each profile its measurement, or the exception that was raised.
    """
    if not profiles:
        return []
    try:
        return list(measure(profiles))
    except Exception as error:  # noqa: BLE001 - a bug in one profile must not stop the others
        if len(profiles) == 1:
            return [error]
    return [result for profile in profiles for result in measure_group(measure, [profile])]


def holds_cylinders_upside_down(measure: MeasureFunction, profile: Profile) -> bool:
    """Return whether cylinders are found in a profile whose heights are negated."""
    step = 1 + len(profile) // MAX_FLIP_CHECK_POINTS
    mirrored = Profile(profile.points[::step] * (1.0, -1.0), lost=())
    try:
        (measurement,) = measure([mirrored])
    except LsvisionError:
        return False
    return bool(measurement.cylinders)
