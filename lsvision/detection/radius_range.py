"""Search range of the radius."""

import math

from lsvision.detection.acceptance import AcceptanceSettings
from lsvision.ellipse.problem import RadiusPrior
from lsvision.geometry.arrays import measure_extent
from lsvision.profile import PreparedProfile
from lsvision.statistics.robust import SIGNIFICANT_SIGMAS

NOMINAL_SPREAD = 0.2
"""Half width of the search range, and smallest radius of the range for a known radius with a large
uncertainty, as fractions of the nominal radius."""
MIN_RADIUS_FRACTION = 1 / 3
"""Ratio of the smallest radius to the geometric mean of extent and pitch: the radius is 4 pitches
for a profile of 150 points, 7 for 400, 21 for 4000. A smaller pipe has fewer than twelve points, or
is more likely to be a particle of dust."""
MAX_RADIUS_EXTENTS = 0.5 / math.sin(math.radians(AcceptanceSettings().min_coverage_deg) / 2)
"""Ratio, 1.54, of the largest radius to the extent of the profile: an arc of a larger pipe would
cover less than the smallest accepted angle."""


def find_radius_range(
    radius: float | tuple[float, float] | None, known: RadiusPrior | None, profile: PreparedProfile
) -> tuple[float, float]:
    """Return the smallest and the largest radius of the search. Units: mm.

    Parameters
    ----------
    radius : float, (float, float) or None
        Nominal radius or range (min, max). Units: mm.
    known : RadiusPrior or None
        Prior on the radius, which determines the range if `radius` is None.
    profile : PreparedProfile
        Profile whose extent and pitch determine the range if both are None; (1, 2) if the profile
        has no extent.

    Raises
    ------
    ValueError
        If the radius is not positive and finite, or the range is reversed or empty.
    """
    if isinstance(radius, tuple):
        low, high = map(float, radius)
        if not (0 < low < high < math.inf):
            raise ValueError(
                f"expected a radius range 0 < min < max in mm, got {low:g} to {high:g}"
            )
        return low, high
    if radius is not None:
        if not (math.isfinite(radius) and radius > 0):
            raise ValueError(f"expected a positive radius in mm, got {radius}")
        return (1 - NOMINAL_SPREAD) * radius, (1 + NOMINAL_SPREAD) * radius
    if known is not None:
        spread = NOMINAL_SPREAD * known.radius + SIGNIFICANT_SIGMAS * known.std
        return max(known.radius - spread, NOMINAL_SPREAD * known.radius), known.radius + spread
    extent = measure_extent(profile.points) if len(profile.valid_indices) else 0.0
    if extent == 0:
        return 1.0, 2.0
    low = MIN_RADIUS_FRACTION * math.sqrt(extent * profile.pitch)
    return low, max(MAX_RADIUS_EXTENTS * extent, 2 * low)
