"""The least-squares problem of one cylinder, in a frame where its axis is nearly the third one.

Unknowns ``(x, y, a, b, r)``: the axis runs through ``(x, y, 0)`` along ``(a, b, 1)``. That is
regular for every cylinder whose axis stays within 45 deg of the frame's; before each fit
`tangent_frame` turns the frame after the axis.
"""

from dataclasses import dataclass

import numpy as np

from lsvision.ellipse.problem import RadiusPrior, cache_last_evaluation
from lsvision.errors import FitFailed
from lsvision.geometry import Cylinder, FloatArray, Points

PARAMETERS = 5
MAX_RADIUS_EXTENTS = 1e5
"""Largest radius over the extent of the points: beyond, they are a plane."""
FOOT_ITERATIONS = 3
"""Steps to the point of the surface from which an error led here; each gains the digits that
the error has over the radius."""
MIN_VARIANCE_RATIO = 1e-12
"""Smallest variance of a distance over the trace of its point's covariance: an error along a ray
that grazes the surface to 1e-6 rad."""
PLAUSIBLE_SIGMAS = 6.0
"""Points farther off get the first-order weight: their foot may not exist."""


@dataclass(frozen=True, eq=False, slots=True)
class CylinderProblem:
    """Least-squares problem with its weights held fixed.

    Parameters
    ----------
    points : (n, 3) ndarray
        In the frame of `tangent_frame`; their feet where the noise is known. Units: mm.
    stds : (n,) ndarray
        Standard deviation of each residual. Units: mm.
    offsets : (n,) ndarray
        Taken from the distances: what the curvature adds to them, less the errors that lead
        from the feet to the points. Units: mm.
    known_radius : RadiusPrior or None
        Prior on r.
    """

    points: Points
    stds: FloatArray
    offsets: FloatArray
    known_radius: RadiusPrior | None = None

    def evaluate(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals over their standard deviations, and their derivative.

        Returns
        -------
        residuals : (n,) or, with a prior, (n + 1,) ndarray
        jacobian : (n, 5) or (n + 1, 5) ndarray
            Units: 1/mm.
        """
        length = float(np.sqrt(parameters[2] ** 2 + parameters[3] ** 2 + 1.0))
        distances, normals, along = axis_distances(self.points, parameters)
        rows = len(distances) + (self.known_radius is not None)
        residuals, jacobian = np.empty(rows), np.empty((rows, PARAMETERS))
        body, weights = jacobian[: len(distances)], 1 / self.stds
        residuals[: len(distances)] = (distances - parameters[4] - self.offsets) * weights
        body[:, 0], body[:, 1] = -normals[0] * weights, -normals[1] * weights
        lever = along / length
        body[:, 2], body[:, 3], body[:, 4] = body[:, 0] * lever, body[:, 1] * lever, -weights
        if self.known_radius is not None:
            std = self.known_radius.effective_std
            residuals[-1] = (parameters[4] - self.known_radius.radius) / std
            jacobian[-1] = (0.0, 0.0, 0.0, 0.0, 1 / std)
        return residuals, jacobian


def axis_distances(
    points: Points, parameters: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distance of each point from the axis, unit normal there, and place along the axis.

    Returns
    -------
    distances : (n,) ndarray
        Units: mm.
    normals : (3, n) ndarray
        Away from the axis.
    along : (n,) ndarray
        From ``(x, y, 0)``. Units: mm.
    """
    x, y, a, b = (float(value) for value in parameters[:4])
    u = np.array([a, b, 1.0]) / np.sqrt(a * a + b * b + 1.0)
    across = points.T - np.array([[x], [y], [0.0]])
    along = u @ across
    across -= u[:, None] * along
    distances = np.sqrt(across[0] ** 2 + across[1] ** 2 + across[2] ** 2)
    across /= np.maximum(distances, 1e-300)
    return distances, across, along


def distance_stds_and_biases(
    points: Points, covariances: FloatArray, parameters: FloatArray
) -> tuple[FloatArray, FloatArray, Points]:
    """Standard deviation of each point's distance, and what curvature adds to it.

    A point's error moves it along the surface as well as across. The normal that counts is the
    one where the point most probably came from (for an error along a ray: where the ray meets
    the cylinder), not the one where it lies; with the latter, weights go with the errors and
    the radius is biased. What remains of the motion along the surface, t' Sigma t without its
    part that goes with the normal's, adds its half over the radius to the distance.

    The gradient of a least-squares problem must stand there too: taken where the points lie,
    it goes with their errors like the weights and pulls the radius as far (measured: 0.3 sigma
    of 1200 points of 0.1 mm noise).

    Parameters
    ----------
    points : (n, 3) ndarray
        Units: mm.
    covariances : (n, 3, 3) ndarray
        Units: mm^2.
    parameters : (5,) ndarray
        The cylinder.

    Returns
    -------
    stds, offsets : (n,) ndarray
        ``distance - radius - offset`` has mean 0 and standard deviation std. Units: mm.
    feet : (n, 3) ndarray
        Where the points most probably came from, on the surface. Units: mm.
    """
    radius = float(parameters[4])
    distances, normals, _ = axis_distances(points, parameters)
    spread = _times(covariances, normals)
    least = MIN_VARIANCE_RATIO * np.trace(covariances, axis1=1, axis2=2)
    variances = np.maximum((normals * spread).sum(axis=0), least)
    near = np.abs(distances - radius) < PLAUSIBLE_SIGMAS * np.sqrt(variances)
    step = distances - radius
    for _ in range(FOOT_ITERATIONS):
        feet = points.T - spread * (np.where(near, step, 0.0) / variances)
        there, foot_normals, _ = axis_distances(feet.T, parameters)
        normals = np.where(near, foot_normals, normals)
        step = step + np.where(near, there - radius, 0.0)
        spread = _times(covariances, normals)
        variances = np.maximum((normals * spread).sum(axis=0), least)
    tangents = _tangents(normals, parameters)
    shared = (tangents * spread).sum(axis=0)
    loose = (tangents * _times(covariances, tangents)).sum(axis=0) - shared**2 / variances
    offsets = np.where(near, distances - radius - step, 0.0) + loose / (2 * radius)
    feet = points.T - spread * (np.where(near, step, 0.0) / variances)
    return np.sqrt(variances), offsets, feet.T


def weighted_problem(
    points: Points,
    covariances: FloatArray | None,
    parameters: FloatArray,
    known_radius: RadiusPrior | None = None,
) -> CylinderProblem:
    """The least-squares problem whose weights and gradients hold near a cylinder.

    Parameters
    ----------
    points : (n, 3) ndarray
        Units: mm.
    covariances : (n, 3, 3) ndarray or None
        None: all weights 1. Units: mm^2.
    parameters : (5,) ndarray
        The cylinder.
    known_radius : RadiusPrior, optional
        Prior on r.
    """
    if covariances is None:
        ones = np.ones(len(points))
        return CylinderProblem(points, ones, 0 * ones, known_radius)
    stds, offsets, feet = distance_stds_and_biases(points, covariances, parameters)
    errors = axis_distances(points, parameters)[0] - axis_distances(feet, parameters)[0]
    return CylinderProblem(feet, stds, offsets - errors, known_radius)


def _times(covariances: FloatArray, vectors: FloatArray) -> FloatArray:
    product: FloatArray = np.einsum("nij,jn->in", covariances, vectors)
    return product


def _tangents(normals: FloatArray, parameters: FloatArray) -> FloatArray:
    u = np.array([parameters[2], parameters[3], 1.0])
    tangents: FloatArray = np.cross(u / np.linalg.norm(u), normals, axisb=0).T
    return tangents


def minimise(problem: CylinderProblem, start: FloatArray) -> FloatArray:
    """Parameters of least squares, by Levenberg-Marquardt (MINPACK) with analytic Jacobian.

    Raises
    ------
    FitFailed
        If the points have no cylinder: the radius runs away, as it does on a plane.
    """
    from scipy.optimize import leastsq

    evaluate = cache_last_evaluation(problem.evaluate)
    with np.errstate(all="ignore"):
        found, *_ = leastsq(
            lambda x: evaluate(x)[0], start, Dfun=lambda x: evaluate(x)[1],
            xtol=1e-13, ftol=1e-15, maxfev=200, full_output=True,
        )  # fmt: skip
    extent = float(np.ptp(problem.points, axis=0).max())
    if not (np.isfinite(found).all() and 0 < found[4] < MAX_RADIUS_EXTENTS * extent):
        raise FitFailed(
            f"the points have no cylinder (radius {found[4]:.3g} mm over an extent of "
            f"{extent:.3g} mm): they lie on a plane or on several surfaces; leave the others out"
        )
    parameters: FloatArray = found
    return parameters


def tangent_frame(direction: FloatArray) -> FloatArray:
    """(3, 3) rotation whose rows are e_phi, e_theta and the direction.

    e_theta = Z x direction is the way the azimuth grows, e_phi the way the angle from Z grows;
    for a direction along Z: X and Y.
    """
    theta_way = np.array([-direction[1], direction[0], 0.0])
    length = float(np.linalg.norm(theta_way))
    theta_way = theta_way / length if length > 0 else np.array([0.0, 1.0, 0.0])
    return np.stack([np.cross(theta_way, direction), theta_way, direction])


def parameters_from_cylinder(frame: FloatArray, cylinder: Cylinder) -> FloatArray:
    """(x, y, a, b, r) of a cylinder whose points are written as ``points @ frame.T``."""
    u, c = frame @ cylinder.direction, frame @ cylinder.point
    tilt = u[:2] / u[2]
    return np.array([*(c[:2] - tilt * c[2]), *tilt, cylinder.radius])


def cylinder_from_parameters(frame: FloatArray, parameters: FloatArray) -> Cylinder:
    """Inverse of `parameters_from_cylinder`; its point is the axis point nearest to the origin."""
    u = np.array([parameters[2], parameters[3], 1.0])
    c = np.array([parameters[0], parameters[1], 0.0])
    foot = c - (c @ u) / (u @ u) * u
    return Cylinder(frame.T @ foot, frame.T @ u, float(parameters[4]))
