"""Least-squares problem of a cylinder, in a frame whose third axis is close to the cylinder's.

Parameters ``(x, y, a, b, r)``: the axis runs through ``(x, y, 0)`` along ``(a, b, 1)``. They are
regular while the axis stays within 45 deg of the third axis; before each fit the points are
transformed by the `build_tangent_frame` of the current direction.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lsvision.ellipse.problem import RadiusPrior
from lsvision.errors import DegenerateGeometry, FitFailed
from lsvision.geometry import Cylinder, FloatArray, Points, build_tangent_frame
from lsvision.geometry.arrays import TINY, measure_extent
from lsvision.statistics.compiled_routines import LeastSquares, minimise_by_levenberg_marquardt
from lsvision.statistics.robust import mad_std

Evaluation = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Function of the parameters that returns residuals and Jacobian."""
PARAMETERS = 5
"""Number of parameters."""
MAX_RADIUS_EXTENTS = 1e5
"""Largest ratio of the radius to the extent of the points; with a larger one they are on a
plane."""
FOOT_POINT_ITERATIONS = 3
"""Number of iterations for a foot point; each one multiplies its error by about point error /
radius."""
MIN_VARIANCE_RATIO = 1e-12
"""Smallest ratio of the variance of a distance to the trace of its point's covariance, as for an
error along a ray at 1e-6 rad from the surface."""
PLAUSIBLE_SIGMAS = 6.0
"""Distance from the surface, in standard deviations, above which the weight of a point is computed
at the measured point, to first order, because its foot point may not exist."""


SINGULARITY_TOLERANCE = 1e-14
"""Smallest eigenvalue of a regular information matrix, after scaling its diagonal to 1."""


@dataclass(frozen=True, eq=False, slots=True)
class CylinderProblem:
    """Least-squares problem with fixed weights.

    Parameters
    ----------
    points : (n, 3) ndarray
        Points, or with known noise their foot points, in the frame of `build_tangent_frame`.
        Units: mm.
    stds : (n,) ndarray
        Standard deviation of each distance. Units: mm.
    offsets : (n,) ndarray
        Values that are subtracted from the distances of `points` from the surface: the bias due to
        curvature, minus the distance of the measured point from the axis, plus that of its foot
        point. Units: mm.
    known_radius : RadiusPrior or None
        Prior on the radius r.
    """

    points: Points
    stds: FloatArray
    offsets: FloatArray
    known_radius: RadiusPrior | None = None

    def evaluate(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the normalised residuals, and their derivatives by ``(x, y, a, b, r)``.

        The residuals (n,) are the distances from the surface minus `offsets`, divided by `stds`;
        with a prior its residual is the last one, (n + 1,).
        """
        length = float(np.sqrt(parameters[2] ** 2 + parameters[3] ** 2 + 1.0))
        distances, normals, axial_positions = axis_distances(self.points, parameters)
        count = len(distances) + (self.known_radius is not None)
        residuals, jacobian = np.empty(count), np.empty((count, PARAMETERS))
        point_rows, weights = jacobian[: len(distances)], 1 / self.stds
        residuals[: len(distances)] = (distances - parameters[4] - self.offsets) * weights
        point_rows[:, 0], point_rows[:, 1] = -normals[0] * weights, -normals[1] * weights
        height = axial_positions / length
        point_rows[:, 2], point_rows[:, 3] = point_rows[:, 0] * height, point_rows[:, 1] * height
        point_rows[:, 4] = -weights
        if self.known_radius is not None:
            std = self.known_radius.effective_std
            residuals[-1] = (parameters[4] - self.known_radius.radius) / std
            jacobian[-1] = (0.0, 0.0, 0.0, 0.0, 1 / std)
        return residuals, jacobian


def axis_distances(
    points: Points, parameters: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return each point's distance from the axis, unit normal (3, n), and position along the axis.

    The points (n, 3) are in the frame of the parameters ``(x, y, a, b, r)``, of which r is not
    used. Normals point away from the axis, positions are counted from ``(x, y, 0)``. Units: mm.
    """
    x, y, a, b = (float(value) for value in parameters[:4])
    u = np.array([a, b, 1.0]) / np.sqrt(a * a + b * b + 1.0)
    # Stored coordinate by coordinate: the following operations run over the points.
    radial = np.subtract(points.T, np.array([[x], [y], [0.0]]), order="C")
    axial_positions = u @ radial
    radial -= u[:, None] * axial_positions
    distances = np.sqrt(radial[0] ** 2 + radial[1] ** 2 + radial[2] ** 2)
    radial /= np.maximum(distances, TINY)
    return distances, radial, axial_positions


def rotate_covariances(covariances: FloatArray, rotation: FloatArray) -> FloatArray:
    """Return R C R' (n, k, k) for each of n covariances C (m, m), with a matrix R (k, m)."""
    rows, columns = rotation.shape
    # One product takes a tenth of the time of n products.
    rotated: FloatArray = covariances.reshape(-1, columns**2) @ np.kron(rotation, rotation).T
    return rotated.reshape(-1, rows, rows)


def propagate_point_errors(
    points: Points, covariances: FloatArray, parameters: FloatArray
) -> tuple[FloatArray, FloatArray, Points]:
    """Return standard deviation and bias of each point's distance, and its foot point.

    The normal is evaluated at the foot point, the most probable true point on the surface (for an
    error along a ray: where the ray meets the cylinder). At the measured point it would be
    correlated with the error, and the weights would bias the radius. The error along the surface
    that is uncorrelated with the error along the normal, of variance v, adds v / (2 r) to the mean
    distance.

    The Jacobian of a least-squares problem must be evaluated at the foot points as well: at the
    measured points it biases the radius by the same amount, 0.3 standard uncertainties for 1200
    points with 0.1 mm noise.

    Points (n, 3) and covariances (n, 3, 3) are in the frame of the parameters ``(x, y, a, b, r)``.
    With standard deviations and offsets (n,), ``distance - radius - offset`` has mean 0. Foot
    points (n, 3) are on the surface; beyond `PLAUSIBLE_SIGMAS` they are the measured points.
    Units: mm.
    """
    radius = float(parameters[4])
    distances, normals, _ = axis_distances(points, parameters)
    error_directions = _multiply(covariances, normals)
    min_variances = MIN_VARIANCE_RATIO * np.einsum("nii->n", covariances)
    variances = np.maximum((normals * error_directions).sum(axis=0), min_variances)
    plausible = np.abs(distances - radius) < PLAUSIBLE_SIGMAS * np.sqrt(variances)
    normal_errors = np.where(plausible, distances - radius, 0.0)
    for _ in range(FOOT_POINT_ITERATIONS):
        foot_points = points.T - error_directions * (normal_errors / variances)
        foot_distances, foot_normals, _ = axis_distances(foot_points.T, parameters)
        normals = np.where(plausible, foot_normals, normals)
        normal_errors += np.where(plausible, foot_distances - radius, 0.0)
        error_directions = _multiply(covariances, normals)
        variances = np.maximum((normals * error_directions).sum(axis=0), min_variances)
    a, b = float(parameters[2]), float(parameters[3])
    # Cross products of the axis and the normals; `np.cross` takes five times as long.
    cross_product = np.array([[0.0, -1.0, b], [1.0, 0.0, -a], [-b, a, 0.0]])
    tangents = cross_product / math.sqrt(a * a + b * b + 1.0) @ normals
    normal_tangent = (tangents * error_directions).sum(axis=0)
    tangent_variances = (tangents * _multiply(covariances, tangents)).sum(axis=0)
    uncorrelated = tangent_variances - normal_tangent**2 / variances
    offsets = np.where(plausible, distances - radius - normal_errors, 0.0)
    offsets += uncorrelated / (2 * radius)
    foot_points = points.T - error_directions * (normal_errors / variances)
    return np.sqrt(variances), offsets, foot_points.T


def build_weighted_problem(
    points: Points,
    covariances: FloatArray | None,
    parameters: FloatArray,
    known_radius: RadiusPrior | None,
) -> CylinderProblem:
    """Return the least-squares problem with the weights and foot points of a given cylinder.

    The points (n, 3), with their covariances (n, 3, 3), are in the frame of its parameters
    ``(x, y, a, b, r)``; all weights are 1 without covariances. Units: mm.
    """
    if covariances is None:
        ones = np.ones(len(points))
        return CylinderProblem(points, ones, 0 * ones, known_radius)
    stds, offsets, foot_points = propagate_point_errors(points, covariances, parameters)
    distances_from_feet = (
        axis_distances(points, parameters)[0] - axis_distances(foot_points, parameters)[0]
    )
    return CylinderProblem(foot_points, stds, offsets - distances_from_feet, known_radius)


def _multiply(covariances: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return the (3, n) products of (n, 3, 3) matrices and (3, n) vectors."""
    product: FloatArray = np.einsum("nij,jn->in", covariances, vectors)
    return product


def normalised_residuals(
    points: Points, covariances: FloatArray | None, cylinder: Cylinder
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the distances of points from a cylinder, their stds, and the normalised distances.

    All three are (n,), for points (n, 3) with covariances (n, 3, 3) in the frame of the cylinder.
    Distances are positive outside. A normalised distance is the distance minus its bias, divided by
    its std. Without covariances the std is the robust one (MAD) of all distances, and no bias is
    subtracted. Units: mm.
    """
    residuals = cylinder.signed_distances(points)
    if covariances is None:
        std = max(mad_std(residuals), TINY)
        return residuals, np.full(len(points), std), residuals / std
    frame = build_tangent_frame(cylinder.direction)
    stds, offsets, _ = propagate_point_errors(
        points @ frame.T,
        rotate_covariances(covariances, frame),
        parameters_from_cylinder(frame, cylinder),
    )
    return residuals, stds, (residuals - offsets) / stds


def minimise(problem: CylinderProblem, initial_guess: FloatArray) -> LeastSquares:
    """Return the least-squares parameters (5,), by the Levenberg-Marquardt method (MINPACK).

    Raises
    ------
    FitFailed
        If the radius diverges, as for the points of a plane, or numbers overflow.
    """
    evaluate = _cache_last_evaluation(problem.evaluate)
    with np.errstate(all="ignore"):
        solution = minimise_by_levenberg_marquardt(
            lambda x: evaluate(x)[0], lambda x: evaluate(x)[1], initial_guess,
            xtol=1e-13, ftol=1e-15, max_evaluations=200,
        )  # fmt: skip
    extent, radius = measure_extent(problem.points), solution.parameters[4]
    is_finite = np.isfinite(solution.parameters).all()
    if not (is_finite and 0 < radius < MAX_RADIUS_EXTENTS * extent):
        raise FitFailed(
            f"no cylinder fits the points (radius {radius / extent:.3g} times their extent): "
            "they lie on a plane or on several surfaces; use points of one cylinder"
        )
    return solution


def invert_information(information: FloatArray) -> FloatArray:
    """Return the inverse of the information matrix, computed with its diagonal scaled to 1.

    DegenerateGeometry if the points do not determine all five parameters.
    """
    scale = 1 / np.sqrt(np.maximum(np.diag(information), TINY))
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    if not values[0] > SINGULARITY_TOLERANCE:
        raise DegenerateGeometry(
            "the points do not determine the cylinder (too short an arc, or a section "
            "perpendicular to the axis): measure a longer arc, or add a section"
        )
    inverse: FloatArray = (vectors / values) @ vectors.T
    return inverse * np.outer(scale, scale)


def _cache_last_evaluation(evaluate: Evaluation) -> Evaluation:
    """Return the function with its last result stored: MINPACK asks for both parts separately."""
    last: dict[bytes, tuple[FloatArray, FloatArray]] = {}

    def cached(parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        key = parameters.tobytes()
        if key not in last:
            last.clear()
            last[key] = evaluate(parameters)
        return last[key]

    return cached


def parameters_from_cylinder(frame: FloatArray, cylinder: Cylinder) -> FloatArray:
    """Return ``(x, y, a, b, r)`` of a cylinder for points transformed by ``points @ frame.T``."""
    u, c = frame @ cylinder.direction, frame @ cylinder.point
    tilt = u[:2] / u[2]
    return np.array([*(c[:2] - tilt * c[2]), *tilt, cylinder.radius])


def cylinder_from_parameters(frame: FloatArray, parameters: FloatArray) -> Cylinder:
    """Return the cylinder of parameters for ``points @ frame.T``, in the frame of the points.

    Its point is the one of the axis nearest to the origin.
    """
    u = np.array([parameters[2], parameters[3], 1.0])
    c = np.array([parameters[0], parameters[1], 0.0])
    foot = c - (c @ u) / (u @ u) * u
    return Cylinder(frame.T @ foot, frame.T @ u, float(parameters[4]))
