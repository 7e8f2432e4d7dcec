"""Joining of the arcs on both sides of a cable, seam, groove or shadow that divides a pipe.

The extrapolation of one part over such a gap is too inaccurate to find the other one by region
growing, but one ellipse fits both. Two pipes do not: the sections of two bodies do not overlap. A
pipe under several cables has parts that are too short to be accepted as cylinders themselves.
"""

import math
from collections.abc import Sequence

import numpy as np

from lsvision.detection.acceptance import AcceptanceSettings, find_shape_rejection_reason
from lsvision.detection.arcs import INTERRUPTING_RUN, MIN_NORMAL_Y, IdentifiedArc
from lsvision.ellipse.parameters import (
    PARAMETERS,
    ellipse_from_parameters,
    parameters_from_ellipse,
)
from lsvision.ellipse.robust_gauss_newton import (
    EllipseResiduals,
    ellipse_residuals,
    take_gauss_newton_step,
)
from lsvision.geometry import FloatArray
from lsvision.geometry.noisy_points import NoisyPoints
from lsvision.profile import PreparedProfile

GAUSS_NEWTON_STEPS = 4
"""Number of steps of the joint fit, from the ellipse of the part that fits both better. With 4 or
more, 390 of 400 pipes under a cable are measured as one, with 3 381, with 2 278."""
MAX_CHI2_INCREASE = 20.5
"""Largest increase of chi^2 from the fits of both parts to the joint fit, over the variance factor
of the former: exceeded by chance in one of 1000 pipes (chi^2 with 5 degrees of freedom)."""


def join_divided_arcs(
    profile: PreparedProfile,
    arcs: Sequence[IdentifiedArc],
    rejected: Sequence[IdentifiedArc],
    radius_range: tuple[float, float],
    settings: AcceptanceSettings = AcceptanceSettings(),
) -> list[IdentifiedArc]:
    """Return the arcs of a profile, with those that are parts of one pipe joined.

    Parameters
    ----------
    profile : PreparedProfile
        The profile.
    arcs : sequence of IdentifiedArc
        Arcs without common points.
    rejected : sequence of IdentifiedArc
        Arcs with another shape than that of a cylinder, such as too short ones. They are returned
        only as parts of a joined arc.
    radius_range : (float, float)
        Smallest and largest radius of a joined arc. Units: mm.
    settings : AcceptanceSettings
        Limits on the shape of a joined arc.
    """
    joined: list[IdentifiedArc] = []
    for arc in [*arcs, *rejected]:
        for i, other in enumerate(joined):
            both = _join(profile, other, arc, radius_range, settings)
            if both is not None:
                joined[i] = both
                break
        else:
            joined.append(arc)
    return [arc for arc in joined if not any(arc is other for other in rejected)]


def _join(
    profile: PreparedProfile,
    first: IdentifiedArc,
    second: IdentifiedArc,
    radius_range: tuple[float, float],
    settings: AcceptanceSettings,
) -> IdentifiedArc | None:
    """Return two arcs as one if one ellipse fits both as well as two; None if not.

    None also if there is no gap between them, their points alternate along the line, a part faces
    away from the sensor, or the ellipse does not have the shape of a cylinder.
    """
    distance = math.dist(first.ellipse.centre, second.ellipse.centre)
    if distance > max(first.ellipse.semi_major, second.ellipse.semi_major):
        return None
    if not (_is_separate(profile, first, second) or _is_separate(profile, second, first)):
        return None
    indices = np.sort(np.concatenate([first.indices, second.indices]))
    points = profile.noisy_points[indices]
    starts = [parameters_from_ellipse(arc.ellipse) for arc in (first, second)]
    start = min(starts, key=lambda start: _chi2(ellipse_residuals(points, start)))
    parameters = fit_robust_ellipse(points, start)
    if math.isnan(parameters[0]):
        return None
    separate = sum(_chi2(_compute_residuals(profile, arc)) for arc in (first, second))
    variance_factor = separate / (len(indices) - 2 * PARAMETERS)
    joint = ellipse_residuals(points, parameters)
    if _chi2(joint) - separate > MAX_CHI2_INCREASE * variance_factor:
        return None
    ellipse, faces_sensor = ellipse_from_parameters(parameters), joint.normals.imag > MIN_NORMAL_Y
    reason = find_shape_rejection_reason(ellipse, joint.normals, radius_range, settings)
    if reason is not None or not faces_sensor.all():
        return None
    return IdentifiedArc(indices, ellipse)


def fit_robust_ellipse(points: NoisyPoints, parameters: FloatArray) -> FloatArray:
    """Return the parameters (5,) of the ellipse of points (n,) by `GAUSS_NEWTON_STEPS`, in mm.

    `parameters` (5,) are the initial ones; the result is NaN if a step is no ellipse.
    """
    for _ in range(GAUSS_NEWTON_STEPS):
        parameters = take_gauss_newton_step(ellipse_residuals(points, parameters), parameters)
        if math.isnan(parameters[0]):
            break
    return parameters


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


def _compute_residuals(profile: PreparedProfile, arc: IdentifiedArc) -> EllipseResiduals:
    """Return the residuals of an arc from its ellipse."""
    parameters = parameters_from_ellipse(arc.ellipse)
    return ellipse_residuals(profile.noisy_points[arc.indices], parameters)


def _chi2(residuals: EllipseResiduals) -> float:
    """Return the sum of the squared residuals over their variances."""
    return float(residuals.normalised_squares.sum())
