"""Closed sections: points all around a cylinder, from several sensors or a scan of its contour.

Rough identification finds the arc that faces +Y, as a single sensor sees it. Where the other side
of the same ellipse has points, too, the arc is extended to all of them.
"""

import math

import numpy as np

from lsvision.detection.arcs import MIN_POINTS, IdentifiedArc, ScreenedArc
from lsvision.detection.divided_arcs import MAX_CHI2_INCREASE, fit_robust_ellipse
from lsvision.detection.identification import SENSOR_ERROR_SIGMAS
from lsvision.ellipse.parameters import PARAMETERS, ellipse_from_parameters, parameters_from_ellipse
from lsvision.ellipse.robust_gauss_newton import ellipse_residuals
from lsvision.geometry import Ellipse, FloatArray
from lsvision.geometry.noisy_points import ComplexArray, NoisyPoints
from lsvision.profile import PreparedProfile
from lsvision.statistics.robust import upper_mad_std

MAX_GAP_DEG = 90.0
"""Largest angle between the normals of neighbouring points of a closed section: three sensors
around a pipe leave smaller gaps. Beyond it the points of one sensor, and a few of the floor that
are on the ellipse by chance, would be a closed section. Units: deg."""
MAX_EXTRAPOLATION_ERROR = 0.1
"""Largest distance, as a fraction of the mean semi-axis, of points on the other side from the
ellipse of the arc, which was fitted without them. With 0.07, one in five closed sections of 80
points with a noise of 1.5 % of the radius is not completed; with 0.2 the radii of both sides of a
wall of 5 to 30 % are half as accurate."""


def complete_closed_section(profile: PreparedProfile, arc: IdentifiedArc) -> ScreenedArc | None:
    """Return an arc with the points all around its ellipse; None if the section is not closed.

    Parameters
    ----------
    profile : PreparedProfile
        Profile of the arc. Estimated noise is taken to be isotropic, since no single sensor sees a
        closed section.
    arc : IdentifiedArc
        Arc that faces the sensor.

    Returns
    -------
    ScreenedArc or None
        A closed section has no ends, so that nothing is left for screening. None also if one
        ellipse does not fit both sides as well as two.
    """
    points = profile.noisy_points
    if not _has_points_beyond_centre(points.z, arc.ellipse):
        return None
    if profile.noise_is_estimated:
        points = NoisyPoints.uniform(points.z, profile.noise_std, profile.noise_std)
    start, in_arc = parameters_from_ellipse(arc.ellipse), np.zeros(len(points), dtype=bool)
    in_arc[arc.indices] = True
    extrapolated = ellipse_residuals(points, start)
    near = np.abs(extrapolated.residuals) < MAX_EXTRAPOLATION_ERROR * float(start[2])
    parameters = fit_robust_ellipse(points[near | in_arc], start)
    if math.isnan(parameters[0]):
        return None
    scale = max(upper_mad_std(np.sqrt(extrapolated.normalised_squares[in_arc])), 1.0)
    evaluated = ellipse_residuals(points, parameters)
    inliers = evaluated.normalised_squares < (SENSOR_ERROR_SIGMAS * scale) ** 2
    if not (
        _has_only_small_gaps(evaluated.normals[inliers])
        and _is_one_ellipse(points[inliers], parameters)
    ):
        return None
    indices = inliers.nonzero()[0]
    return ScreenedArc(indices, points[indices], ellipse_from_parameters(parameters), scale**2)


def _is_one_ellipse(points: NoisyPoints, parameters: FloatArray) -> bool:
    """Return whether one ellipse fits both sides of a closed section (n,) as well as two.

    The side that faces the sensor is not the arc, which has lost points that do not agree with it.
    """
    joint = ellipse_residuals(points, parameters)
    faces_sensor = joint.normals.imag > 0
    sides = points[faces_sensor], points[~faces_sensor]
    if min(map(len, sides)) < MIN_POINTS:
        return False
    separate = sum(_minimise_chi2(side, parameters) for side in sides)
    max_increase = MAX_CHI2_INCREASE * separate / (len(points) - 2 * PARAMETERS)
    return float(joint.normalised_squares.sum()) - separate <= max_increase


def _minimise_chi2(points: NoisyPoints, parameters: FloatArray) -> float:
    """Return chi^2 of points (n,) from their own ellipse; NaN if there is none."""
    own = ellipse_residuals(points, fit_robust_ellipse(points, parameters))
    return float(own.normalised_squares.sum())


def _has_points_beyond_centre(z: ComplexArray, ellipse: Ellipse) -> bool:
    """Return whether points x + iy are near an ellipse, on the side that faces away from +Y."""
    offsets = z - complex(*ellipse.centre)
    beyond = offsets.imag < -ellipse.semi_minor / 2
    beyond &= np.abs(offsets) < (1 + MAX_EXTRAPOLATION_ERROR) * ellipse.semi_major
    return bool(beyond.any())


def _has_only_small_gaps(normals: ComplexArray) -> bool:
    """Return whether unit normals (n,) have no gap above `MAX_GAP_DEG` all around."""
    angles_deg = np.sort(np.degrees(np.angle(normals)))
    gaps_deg = np.diff(angles_deg, append=angles_deg[:1] + 360.0)
    return bool(len(gaps_deg) > 0 and gaps_deg.max() <= MAX_GAP_DEG)
