"""Form deviations of a scanned cylinder: bow, taper, ovality, and the centre of each section.

The joint fit assumes a straight circular cylinder. Here a deviating cylinder is fitted to the same
points: its axis is a parabola, its radius changes linearly along the axis, and its cross-section
is r + o1 cos 2 psi + o2 sin 2 psi. Each of the three deviations is tested against zero. psi is
the angle about the axis in space, so that the tilt of the sections needs no correction.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from lsvision.cylinder.fit_result import estimate_variance_factor
from lsvision.errors import DegenerateGeometry
from lsvision.geometry import FloatArray, IntArray, Points, build_tangent_frame
from lsvision.scan.pose_errors import PoseErrors
from lsvision.scan.scan_result import ScannedCylinder
from lsvision.scan.shape_pose_errors import PoseDisplacements, centre_covariances
from lsvision.scan.shape_result import CylinderShape, FormDeviation, SectionCentres

PARAMETERS = 10
"""Point (2) and direction (2) perpendicular to the axis, radius; bow (2), taper (1), ovality
(2)."""
CENTRE, TILT, RADIUS = slice(0, 2), slice(2, 4), 4
"""Indices of the parameters of the straight cylinder."""
BOW, TAPER, OVALITY = slice(5, 7), slice(7, 8), slice(8, 10)
"""Indices of the deviations among the parameters."""
DERIVATIVE_STEP_RADII = 1e-5
"""Step of the central differences by the parameters. Units: radii."""
MIN_POSITIONS = 3
"""Smallest number of positions of sections along the axis: two centres always lie on a straight
line."""
MIN_SPACING_FRACTION = 0.05
"""Distance along the axis below which two sections count as one position, as a fraction of the
distance between the first and the last: at 0.02 some fits of the bow do not converge."""
MAX_LINEAR_STD_FRACTION = 0.02
"""Largest standard deviation of a parameter with which the fit continues at the bent shape, over
the smaller of radius and half of the measured length. Of scans of straight cylinders shorter than
half a radius, 11 % would have a bow with a p-value below 0.001 without this limit, 1 % with 0.03,
and none of 40 has with 0.02."""
GAUSS_NEWTON_ITERATIONS = 6
"""Gauss-Newton steps for the circle of a section; from 1 mm away four are enough."""
FACETS = 96
"""Facets around a cylinder's surface; they deviate from the circle by less than r / 1800."""


def measure_shape(cylinder: ScannedCylinder) -> CylinderShape:
    """Return bow, taper, ovality and the section centres of a scanned cylinder.

    Parameters
    ----------
    cylinder : ScannedCylinder
        Measured in sections at three or more positions along it.

    Returns
    -------
    CylinderShape
        Bow, taper and ovality are estimated together; each test accounts for the other two.

    Raises
    ------
    DegenerateGeometry
        If the cylinder was measured at fewer than three positions, see `count_positions`, or all
        points are as near to one plane as their noise.

    Notes
    -----
    An arc of less than about 90 deg hardly distinguishes an oval from a displaced circle: the
    covariance is large then and the test not significant. Errors of the poses that were stated to
    `measure_scan` are included; those that were not show as a bow, taper or ovality: of straight
    cylinders in 5 sections with an unstated error of 0.1 mm, 3 of 10 have a significant bow. A feed
    that deviates from a straight line shows as the same bow on every cylinder.

    Examples
    --------
    >>> import lsvision as lsv
    >>> profiles = lsv.read_profiles("fixtures/scan_welded_pair")[::5]
    >>> poses = [lsv.Pose.along((0, 0, 1), 5.0 * k) for k in range(len(profiles))]
    >>> scan = lsv.measure_scan(profiles, poses)
    >>> shape = measure_shape(scan.cylinders[0])
    >>> shape.bow.size < 5 * shape.bow.size_std
    True
    """
    positions = count_positions(cylinder)
    if positions < MIN_POSITIONS:
        raise DegenerateGeometry(
            f"the shape of a cylinder needs sections at {MIN_POSITIONS} different positions along "
            f"it, got {positions}: scan more of it"
        )
    _require_noncoplanar_points(cylinder)
    axis_points = _transform_to_axis_frame(cylinder)
    estimate, jacobian, residuals = _fit_deviations(axis_points)
    covariance, factor, dof, std_scale = _estimate_covariance(cylinder, jacobian, residuals)
    bow, taper, ovality = (
        _test_form_deviation(estimate[indices], covariance[indices, indices], dof)
        for indices in (BOW, TAPER, OVALITY)
    )
    # Centres refer to the straight axis of the joint fit; only the radius is the mean radius here.
    points = axis_points.points + np.array([[0.0], [0.0], [sum(cylinder.axial_range) / 2]])
    stds = axis_points.stds * std_scale * math.sqrt(factor)
    radius, radius_std = float(estimate[RADIUS]), math.sqrt(covariance[RADIUS, RADIUS])
    centres = fit_section_centres(cylinder.point_sections, points, stds, radius, radius_std)
    if cylinder.pose_errors != PoseErrors():
        by_poses = centre_covariances(cylinder, centres.along)
        centres = replace(centres, deviation_covariances=centres.deviation_covariances + by_poses)
    return CylinderShape(
        centres=centres,
        bow=bow,
        taper=taper,
        ovality_terms=ovality,
        radius=radius,
        half_length=axis_points.half_length,
    )


def _estimate_covariance(
    cylinder: ScannedCylinder, jacobian: FloatArray, residuals: FloatArray
) -> tuple[FloatArray, float, float, float]:
    """Return the covariance (10, 10) of the parameters, with the stated errors of the poses.

    Behind it the variance factor, the degrees of freedom and the scale of the points' standard
    deviations; see `estimate_variance_factor`.
    """
    inverse = np.asarray(np.linalg.inv(jacobian.T @ jacobian), dtype=np.float64)
    by_poses, absorbed_dof = np.zeros((PARAMETERS, PARAMETERS)), 0.0
    if cylinder.pose_errors != PoseErrors():
        displacements = PoseDisplacements.of_cylinder(cylinder)
        by_poses = displacements.covariance(jacobian, inverse)
        residuals, absorbed_dof = displacements.remove_from(residuals, jacobian)
    factor, dof, std_scale = estimate_variance_factor(
        residuals,
        max(len(residuals) - PARAMETERS - round(absorbed_dof), 1),
        known_noise=math.isinf(cylinder.fit.degrees_of_freedom),
    )
    return factor * std_scale**2 * inverse + by_poses, factor, dof, std_scale


def count_positions(cylinder: ScannedCylinder) -> int:
    """Return the number of positions along the axis at which sections were measured.

    Sections closer together than `MIN_SPACING_FRACTION`, such as profiles of a sensor that stands
    still, count once.
    """
    along = (cylinder.points - cylinder.point) @ cylinder.direction
    _, index = np.unique(cylinder.point_sections, return_inverse=True)
    means = np.sort(np.bincount(index, along) / np.bincount(index))
    spacing = MIN_SPACING_FRACTION * float(means[-1] - means[0])
    count, last = 1, means[0]
    for mean in means[1:]:
        if mean - last > spacing:
            count, last = count + 1, mean
    return count


def _require_noncoplanar_points(cylinder: ScannedCylinder) -> None:
    """Raise DegenerateGeometry unless the points are farther from a common plane than their noise.

    Some deviations combined have no effect in one plane. Their derivatives at noisy points there
    are proportional to the noise: fitted to it, they would be large and significant.
    """
    centred = cylinder.points - cylinder.points.mean(axis=0)
    distance_rms = float(np.linalg.svd(centred, compute_uv=False)[-1]) / math.sqrt(len(centred))
    noise = float(np.median(cylinder.fit.stds))
    if distance_rms <= noise:
        raise DegenerateGeometry(
            "the shape of a cylinder needs sections apart from each other, got points "
            f"{distance_rms:.2g} mm rms from one plane, with a noise of {noise:.2g} mm: scan more "
            "of it"
        )


@dataclass(frozen=True, eq=False, slots=True)
class _AxisFramePoints:
    """Points of a cylinder along e_phi, e_theta and axis, from the middle of the measured length.

    Parameters
    ----------
    points : (3, n) ndarray
        Coordinates. Units: mm.
    stds, offsets : (n,) ndarray
        Standard deviation and expected value of ``distance from the axis - radius``. Units: mm.
    radius, half_length : float
        Radius of the joint fit, and half of the measured length. Units: mm.
    """

    points: FloatArray
    stds: FloatArray
    offsets: FloatArray
    radius: float
    half_length: float


def _transform_to_axis_frame(cylinder: ScannedCylinder) -> _AxisFramePoints:
    """Return the points of a cylinder along e_phi, e_theta and its axis."""
    fit = cylinder.fit
    middle = fit.point + fit.direction * sum(cylinder.axial_range) / 2
    points = build_tangent_frame(fit.direction) @ (cylinder.points - middle).T
    offsets = fit.residuals - fit.normalised * fit.stds
    half_length = (cylinder.axial_range[1] - cylinder.axial_range[0]) / 2
    return _AxisFramePoints(points, fit.stds, offsets, fit.radius, half_length)


def _fit_deviations(axis_points: _AxisFramePoints) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the parameters (10,), the derivatives (n, 10) of the normalised residuals, and these.

    If one Gauss-Newton step from the straight cylinder shows that the points do not determine the
    deviations, its result is returned: further steps would lead to any shape, with an uncertainty
    that is far too small.
    """
    straight = np.zeros(PARAMETERS)
    straight[RADIUS] = axis_points.radius
    residuals, jacobian = _residuals(axis_points, straight), _jacobian(axis_points, straight)
    covariance = np.asarray(np.linalg.inv(jacobian.T @ jacobian), dtype=np.float64)
    step = -covariance @ jacobian.T @ residuals
    residuals += jacobian @ step
    variance_factor = float(residuals @ residuals) / max(len(residuals) - PARAMETERS, 1)
    largest_std = math.sqrt(variance_factor * covariance.diagonal().max())
    if not largest_std < MAX_LINEAR_STD_FRACTION * min(axis_points.radius, axis_points.half_length):
        return straight + step, jacobian, residuals
    return _fit_bent_tube(axis_points, straight)


def _fit_bent_tube(
    axis_points: _AxisFramePoints, initial_guess: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what `_fit_deviations` returns, at the minimum next to an initial guess (10,)."""
    from scipy.optimize import leastsq

    solution: FloatArray
    solution, *_ = leastsq(
        lambda x: _residuals(axis_points, x),
        initial_guess,
        xtol=1e-10,
        ftol=1e-12,
        epsfcn=1e-11,
        maxfev=400,
    )
    return solution, _jacobian(axis_points, solution), _residuals(axis_points, solution)


def _jacobian(axis_points: _AxisFramePoints, parameters: FloatArray) -> FloatArray:
    """Return the derivatives (n, 10) of the normalised residuals. Units: 1/mm."""
    step = DERIVATIVE_STEP_RADII * axis_points.radius
    columns = [
        _residuals(axis_points, parameters + row) - _residuals(axis_points, parameters - row)
        for row in step * np.eye(PARAMETERS)
    ]
    return np.column_stack(columns) / (2 * step)


def _residuals(axis_points: _AxisFramePoints, parameters: FloatArray) -> FloatArray:
    """Return the normalised distances from the bent, tapering, oval cylinder.

    Tilt, bow and taper are displacements at the end of the measured length (t = 1): so all
    parameters are in mm and of similar magnitude.
    """
    centre, tilt, bow = parameters[CENTRE], parameters[TILT], parameters[BOW]
    t = axis_points.points[2] / axis_points.half_length
    from_axis = axis_points.points[:2] - centre[:, None] - np.outer(tilt, t) - np.outer(bow, t * t)
    slope = (tilt[:, None] + 2 * np.outer(bow, t)) / axis_points.half_length
    # Squared component of from_axis along the tangent (slope, 1) of the bent axis.
    along_tangent = (from_axis * slope).sum(axis=0) ** 2 / (1 + (slope**2).sum(axis=0))
    distance = np.sqrt((from_axis**2).sum(axis=0) - along_tangent)
    psi = np.arctan2(from_axis[1], from_axis[0])
    (taper,), (o1, o2) = parameters[TAPER], parameters[OVALITY]
    radius = parameters[RADIUS] + taper * t
    radius += o1 * np.cos(2 * psi) + o2 * np.sin(2 * psi)
    residuals: FloatArray = (distance - radius - axis_points.offsets) / axis_points.stds
    return residuals


def _test_form_deviation(values: FloatArray, covariance: FloatArray, dof: float) -> FormDeviation:
    """Return the deviation with the p-value of an F test, or of a chi^2 test if dof is inf."""
    from scipy.stats import chi2, f

    count = len(values)
    statistic = float(values @ np.linalg.solve(covariance, values))
    noise_known = math.isinf(dof)
    p_value = chi2.sf(statistic, count) if noise_known else f.sf(statistic / count, count, dof)
    return FormDeviation(values, covariance, float(p_value))


def fit_section_centres(
    point_sections: IntArray,
    points: FloatArray,
    stds: FloatArray,
    radius: float,
    radius_std: float,
) -> SectionCentres:
    """Return the circle fitted to the points of each section, projected along the axis.

    Points (3, n) along e_phi, e_theta and the axis, origin on the axis; `point_sections` and `stds`
    (n,) are the section of each and the standard deviation of its distance from the axis; `radius`
    and `radius_std` those of the cylinder's mean radius. Units: mm.
    """
    sections, index = np.unique(point_sections, return_inverse=True)
    lateral, along = points[:2], points[2]
    centres, covariances = _fit_circles(lateral, stds, index, radius, free=2)
    wrong_centres, _ = _fit_circles(lateral, stds, index, radius + radius_std, free=2)
    by_radius = (wrong_centres - centres)[:, :2]
    covariances = covariances + by_radius[:, :, None] * by_radius[:, None, :]
    circles, circle_covariances = _fit_circles(lateral, stds, index, radius, free=3)
    return SectionCentres(
        sections=sections,
        along=np.bincount(index, along) / np.bincount(index),
        deviations=centres[:, :2],
        deviation_covariances=covariances,
        radii=radius + circles[:, 2],
        radii_std=np.sqrt(circle_covariances[:, 2, 2]),
    )


def _fit_circles(
    lateral: FloatArray, stds: FloatArray, index: IntArray, radius: float, *, free: int
) -> tuple[FloatArray, FloatArray]:
    """Return (centre_1, centre_2, deviation from radius) of each section, and the covariances.

    The first `free` of the three are estimated, the others stay 0.
    """
    count = int(index.max()) + 1
    circles = np.zeros((count, 3))
    # Levenberg damping by the information of a std of one radius, which also limits the covariance:
    # a circle stays finite whose arc is too short to determine it.
    damping = np.eye(free) / radius**2
    for _ in range(GAUSS_NEWTON_ITERATIONS):
        from_centre = lateral - circles[index, :2].T
        distance = np.hypot(*from_centre)
        jacobian = np.column_stack([(from_centre / distance).T, np.ones(len(stds))])[:, :free]
        jacobian /= stds[:, None]
        residuals = (distance - radius - circles[index, 2]) / stds
        information = np.tile(damping, (count, 1, 1))
        np.add.at(information, index, jacobian[:, :, None] * jacobian[:, None, :])
        gradient = np.zeros((count, free))
        np.add.at(gradient, index, jacobian * residuals[:, None])
        covariances = np.asarray(np.linalg.inv(information), dtype=np.float64)
        circles[:, :free] += (covariances @ gradient[..., None])[..., 0]
    return circles, covariances


def triangulate_cylinder(
    cylinder: ScannedCylinder, facets: int = FACETS
) -> tuple[Points, IntArray]:
    """Return a triangle mesh of the fitted cylinder over its measured length; ends are open.

    Points (2 * facets, 3): ring at the first end, then ring at the second, base frame, in mm.
    Triangles (2 * facets, 3): rows of the points, counter-clockwise seen from outside.
    """
    angles = np.linspace(0.0, 2 * np.pi, facets, endpoint=False)
    rings = [cylinder.cylinder.ring(end, angles) for end in cylinder.axial_range]
    vertex = np.arange(facets)
    next_vertex = (vertex + 1) % facets
    lower = np.column_stack([vertex, next_vertex, next_vertex + facets])
    upper = np.column_stack([vertex, next_vertex + facets, vertex + facets])
    return np.concatenate(rings), np.concatenate([lower, upper])
