"""Joining of the arcs on both sides of a cable, seam, groove or shadow that divides a pipe.

The extrapolation of one part over such a gap is too inaccurate to find the other one by region
growing, but one ellipse fits both. Two pipes do not: the sections of two bodies do not overlap.
"""

import math
from collections.abc import Sequence

import numpy as np

from lsvision.detection.arcs import INTERRUPTING_RUN, IdentifiedArc
from lsvision.ellipse.parameters import (
    PARAMETERS,
    ellipse_from_parameters,
    parameters_from_ellipse,
)
from lsvision.ellipse.robust_gauss_newton import ellipse_residuals, gauss_newton_step
from lsvision.geometry import FloatArray
from lsvision.geometry.noisy_points import NoisyPoints
from lsvision.profile import PreparedProfile

GAUSS_NEWTON_STEPS = 4
"""Number of steps of the joint fit, from the ellipse of the longer part. With 4 or more, 384 of 400
pipes under a cable are measured as one, with 3 378, with 2 215."""
MAX_CHI2_INCREASE = 20.5
"""Largest increase of chi^2 from the fits of both parts to the joint fit, over the variance factor
of the former: exceeded by chance in one of 1000 pipes (chi^2 with 5 degrees of freedom)."""


def join_divided_arcs(
    profile: PreparedProfile, arcs: Sequence[IdentifiedArc]
) -> list[IdentifiedArc]:
    """Return the arcs of a profile, with those that are parts of one pipe joined.

    Parameters
    ----------
    profile : PreparedProfile
        The profile.
    arcs : sequence of IdentifiedArc
        Arcs without common points.
    """
    joined: list[IdentifiedArc] = []
    for arc in arcs:
        for i, other in enumerate(joined):
            both = _join(profile, other, arc)
            if both is not None:
                joined[i] = both
                break
        else:
            joined.append(arc)
    return joined


def _join(
    profile: PreparedProfile, first: IdentifiedArc, second: IdentifiedArc
) -> IdentifiedArc | None:
    """Return two arcs as one if one ellipse fits both as well as two; None if not.

    None also if there is no gap between them, or their points alternate along the line.
    """
    distance = math.dist(first.ellipse.centre, second.ellipse.centre)
    if distance > max(first.ellipse.semi_major, second.ellipse.semi_major):
        return None
    if not (_is_separate(profile, first, second) or _is_separate(profile, second, first)):
        return None
    longer = max(first, second, key=lambda arc: len(arc.indices))
    indices = np.sort(np.concatenate([first.indices, second.indices]))
    points, parameters = profile.noisy_points[indices], parameters_from_ellipse(longer.ellipse)
    for _ in range(GAUSS_NEWTON_STEPS):
        parameters = gauss_newton_step(ellipse_residuals(points, parameters), parameters)
        if math.isnan(parameters[0]):
            return None
    separate = sum(
        _chi2(profile.noisy_points[arc.indices], parameters_from_ellipse(arc.ellipse))
        for arc in (first, second)
    )
    variance_factor = separate / (len(indices) - 2 * PARAMETERS)
    if _chi2(points, parameters) - separate > MAX_CHI2_INCREASE * variance_factor:
        return None
    return IdentifiedArc(indices, ellipse_from_parameters(parameters))


def _is_separate(profile: PreparedProfile, arc: IdentifiedArc, other: IdentifiedArc) -> bool:
    """Return whether an arc is beside another one, or in a gap of it, and next to none of its ends.

    False also if the points of both alternate along the line.
    """
    first, last = arc.indices[[0, -1]].tolist()
    before, after = other.indices.searchsorted([first, last]).tolist()
    if before != after:
        return False
    z, ends = profile.noisy_points.z, other.indices.tolist()
    distances = [abs(z[first] - z[end]) for end in ends[:before][-1:]]
    distances += [abs(z[last] - z[end]) for end in ends[after:][:1]]
    return all(distance > INTERRUPTING_RUN * profile.pitch for distance in distances)


def _chi2(points: NoisyPoints, parameters: FloatArray) -> float:
    """Return the sum of the squared residuals of points over their variances."""
    return float(ellipse_residuals(points, parameters).normalised_squares.sum())
