"""Which radii are looked for."""

import math

from lsvision.ellipse.problem import RadiusPrior
from lsvision.geometry.arrays import extent_of
from lsvision.profile import PreparedProfile

NOMINAL_SPREAD = 0.2
"""A nominal radius is searched within this share of itself, a known one never below the share."""
MIN_RADIUS_PITCHES = 3.0
MIN_RADIUS_VIEW_FRACTION, MIN_RADIUS_VIEW_PITCHES = 1 / 75, 20.0
"""A smaller pipe has under ten points; or is dust, 1/75 of the field of view or 20 pitches
small, whichever is less: give a range to find those."""
MAX_RADIUS_EXTENTS = 1.5
"""A larger pipe would be seen as a few tens of degrees of an arc."""


def search_range(
    radius: float | tuple[float, float] | None, known: RadiusPrior | None, profile: PreparedProfile
) -> tuple[float, float]:
    """Smallest and largest radius that a measurement looks for.

    Parameters
    ----------
    radius : float, (float, float) or None
        Nominal radius, or a range. Units: mm.
    known : RadiusPrior or None
        Its radius counts as nominal where `radius` is None.
    profile : PreparedProfile
        Where both are None: from the smallest that is no dust to 1.5 times the extent.

    Returns
    -------
    low, high : float
        Units: mm.

    Raises
    ------
    ValueError
        If a radius is not positive or the range is reversed.
    """
    if isinstance(radius, tuple):
        low, high = (float(value) for value in radius)
        if not (0 < low < high < math.inf):
            raise ValueError(f"want a radius range 0 < min < max in mm, got {low:g} to {high:g}")
        return low, high
    if radius is not None:
        if not (math.isfinite(radius) and radius > 0):
            raise ValueError(f"want a positive radius in mm, got {radius}")
        return (1 - NOMINAL_SPREAD) * radius, (1 + NOMINAL_SPREAD) * radius
    if known is not None:
        spread = NOMINAL_SPREAD * known.radius + 3 * known.std
        return max(known.radius - spread, NOMINAL_SPREAD * known.radius), known.radius + spread
    points = profile.points[profile.valid_indices]
    if len(points) < 2:
        return 1.0, 2.0
    extent = extent_of(points)
    dust = min(MIN_RADIUS_VIEW_FRACTION * extent, MIN_RADIUS_VIEW_PITCHES * profile.pitch)
    low = max(MIN_RADIUS_PITCHES * profile.pitch, dust)
    return low, max(MAX_RADIUS_EXTENTS * extent, 2 * low)
