"""Cramer-Rao bounds of one section (an ellipse) and of a scan (a cylinder).

Both invert the Fisher information of independent Gaussian errors normal to the surface. The fits
use none of this code, so that they can be compared with it.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from lsvision.errors import DegenerateGeometry, TooFewPoints
from lsvision.geometry import (
    Cylinder,
    Ellipse,
    FloatArray,
    Points,
    as_readonly_array,
    build_tangent_frame,
)
from lsvision.geometry.arrays import TINY, require_coordinates
from lsvision.planning.predictions import ScanPrediction, SectionPrediction
from lsvision.planning.sensor_view import cylinder_normals

if TYPE_CHECKING:
    from scipy.sparse import csr_array

SINGULARITY_TOLERANCE = 1e-13
"""Smallest eigenvalue of a regular information matrix, after scaling its diagonal to 1."""
UNIFORM_THETA_STD = math.pi / math.sqrt(12)
"""Standard deviation of an angle that is uniform in [0, pi): 52 deg."""
_UNDETERMINED = (
    "the points leave radius and axis undetermined (too few, or too short an arc): "
    "measure more of the pipe, add sections, or give the known radius"
)
"""Message for points that do not determine all parameters."""


def compute_fisher_information(jacobian: FloatArray, variances: FloatArray) -> FloatArray:
    """Return the Fisher information (k, k) of points with independent Gaussian errors.

    The sum over the points of j j' / variance. A row j of the Jacobian (n, k) is the derivative by
    the parameters of the surface's displacement along its outward normal, and the variance (n,)
    that of the point's error along this normal, n' Sigma n, in mm^2. Its dependence on the
    parameters is neglected: a std proportional to range^2 would add a fraction of about 8 (std /
    range)^2.

    Raises
    ------
    TooFewPoints
        If there are fewer than two points. From two points on, `invert_information` decides, since
        a known radius replaces a point.
    ValueError
        If a variance is not positive and finite.
    """
    if len(jacobian) < 2:
        hint = "reduce the standoff or the pitch, or measure more of the pipe"
        raise TooFewPoints("the planned view", len(jacobian), jacobian.shape[1], hint)
    if not (np.isfinite(variances).all() and (variances > 0).all()):
        raise ValueError("expected positive finite variances along the surface normal in mm^2")
    weighted = jacobian / np.sqrt(variances)[:, None]
    return weighted.T @ weighted


def invert_information(
    information: FloatArray, radius_prior: tuple[int, float] | None
) -> FloatArray:
    """Return the Cramer-Rao bound (k, k): the smallest covariance of any unbiased estimate.

    `radius_prior` is the index of the radius among the parameters, and the standard deviation of a
    prior on it in mm. With 0 it is exactly known, and its row and column are zero.

    Raises
    ------
    DegenerateGeometry
        If points and prior do not determine all parameters.
    ValueError
        If the standard deviation of the prior is negative or NaN.
    """
    information = information.copy()
    free = np.ones(len(information), dtype=bool)
    if radius_prior is not None:
        index, std = radius_prior
        if not std >= 0:
            raise ValueError(f"expected known_radius_std >= 0 mm, got {std}")
        variance = std * std  # 0 or inf where std**2 would raise an error
        free[index] = variance >= TINY
        information[index, index] += 1 / max(variance, TINY)
    bound = np.zeros_like(information)
    bound[np.ix_(free, free)] = _invert_scaled(information[np.ix_(free, free)])
    return bound


def _invert_scaled(matrix: FloatArray) -> FloatArray:
    """Return the inverse of a matrix, computed with its diagonal scaled to 1."""
    scale = np.sqrt(np.diag(matrix))
    if not (scale > 0).all():
        raise DegenerateGeometry(_UNDETERMINED)
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    if values[0] < SINGULARITY_TOLERANCE:
        raise DegenerateGeometry(_UNDETERMINED)
    inverse: FloatArray = (vectors / values) @ vectors.T / np.outer(scale, scale)
    return inverse


def section_bound(
    ellipse: Ellipse,
    points: Points,
    covariances: FloatArray,
    known_radius_std: float | None = None,
) -> SectionPrediction:
    """Return the Cramer-Rao bound of radius, theta, phi and centre from points of one section.

    Parameters
    ----------
    ellipse : Ellipse
        True section.
    points : (n, 2) ndarray
        Noise-free points on the ellipse, section frame; NaN rows are lost points. Units: mm.
    covariances : (n, 2, 2) ndarray
        Covariance of each point's error. Only n' Sigma n, the variance along the curve's normal, is
        used: for noise along the ray that is exactly the information of the measured ranges.
        Units: mm^2.
    known_radius_std : float, optional
        Standard deviation of a prior on the radius; 0 = exactly known. Units: mm.

    Returns
    -------
    SectionPrediction
        Standard uncertainties of radius, theta, phi and centre.

    Raises
    ------
    TooFewPoints
        If fewer than two points are valid.
    DegenerateGeometry
        If the points do not determine the ellipse (fewer than five, four with a known radius, or
        too short an arc).
    ValueError
        If shapes do not match, a variance is not positive, or `known_radius_std` is negative.

    Notes
    -----
    The parameters are (centre, a, b, eta): b is the radius, and eta = (a - b) times the change of
    theta, in mm, is regular for a circle, unlike theta. The bound is then propagated linearly to
    theta and to phi = arccos(b / a); for the limits near a circle see `SectionPrediction`.

    Examples
    --------
    >>> pipe = Ellipse((0.0, -400.0), semi_major=20.22, semi_minor=19.0, theta=0.35)
    >>> points = pipe.points_at(np.linspace(0.0, 2.4, 70))
    >>> sigma = section_bound(pipe, points, np.tile(0.01 * np.eye(2), (70, 1, 1)))
    >>> f"radius {sigma.radius_std:.2f} mm, phi {math.degrees(sigma.phi_std):.1f} deg"
    'radius 0.47 mm, phi 2.2 deg'
    """
    points = as_readonly_array(points, ("n", 2), "points")
    covariances = as_readonly_array(covariances, (len(points), 2, 2), "covariances")
    valid = np.isfinite(points).all(axis=1)
    jacobian, normals = _section_jacobian(ellipse, points[valid])
    variances = np.einsum("ni,nij,nj->n", normals, covariances[valid], normals)
    prior = None if known_radius_std is None else (3, known_radius_std)
    bound = invert_information(compute_fisher_information(jacobian, variances), prior)
    return _predict_section(ellipse, bound, int(valid.sum()))


def _section_jacobian(ellipse: Ellipse, points: Points) -> tuple[FloatArray, FloatArray]:
    """Return the Jacobian of points by (centre, a, b, eta), and their outward normals."""
    a, b = ellipse.semi_major, ellipse.semi_minor
    u, v = ellipse.to_ellipse_frame(points).T
    anomaly = np.arctan2(v / b, u / a)
    cos, sin = np.cos(anomaly), np.sin(anomaly)
    length = np.hypot(b * cos, a * sin)
    ellipse_normals = np.column_stack([b * cos, a * sin]) / length[:, None]
    # Without the centre only the rotation to the section frame remains.
    normals = ellipse.from_ellipse_frame(ellipse_normals) - ellipse.centre
    a_jacobian, b_jacobian = ellipse_normals[:, 0] * cos, ellipse_normals[:, 1] * sin
    eta_jacobian = (a + b) * sin * cos / length
    return np.column_stack([normals, a_jacobian, b_jacobian, eta_jacobian]), normals


def _predict_section(ellipse: Ellipse, bound: FloatArray, points: int) -> SectionPrediction:
    """Return the prediction from the covariance (5, 5) of centre, a, b and eta."""
    a, b = ellipse.semi_major, ellipse.semi_minor
    centre_x_std, centre_y_std, _, radius_std, eta_std = np.sqrt(np.diag(bound))
    ratio_jacobian = np.array([-b / a**2, 1 / a])
    ratio_std = math.sqrt(ratio_jacobian @ bound[2:4, 2:4] @ ratio_jacobian)
    difference, sin_phi = a - b, math.sin(ellipse.phi)
    covariance = bound.copy()
    covariance[4, :4] = covariance[:4, 4] = bound[4, :4] / difference if difference > 0 else 0.0
    covariance[4, 4] = (eta_std / difference) ** 2 if difference > 0 else math.inf
    linear_phi_std = ratio_std / sin_phi if sin_phi > 0 else math.inf
    return SectionPrediction(
        radius_std=float(radius_std),
        theta_std=min(math.sqrt(covariance[4, 4]), UNIFORM_THETA_STD),
        phi_std=min(linear_phi_std, math.sqrt(2 * ratio_std)),
        centre_x_std=float(centre_x_std),
        centre_y_std=float(centre_y_std),
        covariance=covariance,
        points=points,
    )


def scan_bound(
    cylinder: Cylinder,
    points: Points,
    variances: FloatArray,
    *,
    known_radius_std: float | None = None,
    shared_errors: "FloatArray | csr_array[np.float64] | None" = None,
) -> ScanPrediction:
    """Return the Cramer-Rao bound of a cylinder from points anywhere on its surface.

    Parameters
    ----------
    cylinder : Cylinder
        True cylinder, in the frame of the points; the uncertainty of the position refers to its
        `point` and is smallest in the middle of the points.
    points : (n, 3) ndarray
        Noise-free points on the surface, all finite. Units: mm.
    variances : (n,) ndarray
        Variance of each point's error along the surface normal, n' Sigma n. Units: mm^2.
    known_radius_std : float, optional
        Standard deviation of a prior on the radius; 0 = exactly known. Units: mm.
    shared_errors : (n, k) ndarray or sparse array, optional
        Displacement of each point along the outward normal by one standard deviation of each of
        k errors that points share, such as errors of a pose. Their effect on a fit that takes
        the poses as exact is added; the result is then no longer a bound. Units: mm.

    Returns
    -------
    ScanPrediction
        Standard uncertainties; `sections` is 1 and `length` 0, whatever the points.

    Raises
    ------
    TooFewPoints
        If there are fewer than two points.
    DegenerateGeometry
        If the points do not determine the cylinder.
    ValueError
        If shapes do not match, a point or shared error is not finite, a variance is not positive,
        or `known_radius_std` is negative.
    """
    points = as_readonly_array(points, ("n", 3), "points")
    require_coordinates(points)
    variances = as_readonly_array(variances, (len(points),), "variances")
    basis = build_tangent_frame(cylinder.direction)[:2]
    axial_positions = (points - cylinder.point) @ cylinder.direction
    lateral_normals = cylinder_normals(cylinder, points) @ basis.T
    jacobian = np.column_stack(
        [lateral_normals, axial_positions[:, None] * lateral_normals, np.ones(len(points))]
    )
    prior = None if known_radius_std is None else (4, known_radius_std)
    covariance = invert_information(compute_fisher_information(jacobian, variances), prior)
    if shared_errors is not None:
        # Linear response of the weighted least-squares fit to each shared error.
        weighted = covariance @ (jacobian / variances[:, None]).T
        response = _multiply_errors(weighted, shared_errors)
        covariance = covariance + response @ response.T
    return _predict_scan(cylinder, covariance, len(points))


def _multiply_errors(
    matrix: FloatArray, errors: "FloatArray | csr_array[np.float64]"
) -> FloatArray:
    """Return the product of a matrix (5, n) and checked errors (n, k), dense or sparse.

    Errors of many poses are sparse: as a dense array, those of 2048 sections take gigabytes.
    """
    from scipy.sparse import csr_array, issparse

    if not issparse(errors):
        errors = csr_array(as_readonly_array(errors, (matrix.shape[1], "k"), "shared_errors"))
    if not np.isfinite(errors.data).all():
        raise ValueError("expected finite shared_errors in mm")
    return matrix @ errors


def _predict_scan(cylinder: Cylinder, covariance: FloatArray, points: int) -> ScanPrediction:
    """Return the prediction from the covariance (5, 5) of position, direction and radius.

    Position and direction are along the tangent basis: first e_phi, then e_theta.
    """
    variances = np.diag(covariance)
    sin_phi = math.hypot(cylinder.direction[0], cylinder.direction[1])
    theta_std = math.sqrt(variances[3]) / sin_phi if sin_phi > 0 else math.inf
    return ScanPrediction(
        radius_std=math.sqrt(variances[4]),
        direction_std=math.sqrt(variances[2] + variances[3]),
        theta_std=min(theta_std, UNIFORM_THETA_STD),
        phi_std=math.sqrt(variances[2]),
        position_std=math.sqrt(variances[0] + variances[1]),
        covariance=covariance,
        points=points,
    )
