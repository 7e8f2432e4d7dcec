"""The maximum-likelihood cylinder of points in space: one cylinder from all sections at once.

One section leaves the axis with a twin and a wide error; points of two sections or more fix it.
The residual is the distance from the surface over its standard deviation sqrt(n' Sigma n).
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from lsvision.cylinder.fit_result import CylinderFit, variance_factor
from lsvision.cylinder.initial_guess import guess_cylinder
from lsvision.cylinder.problem import (
    PARAMETERS,
    CylinderProblem,
    cylinder_from_parameters,
    distance_stds_and_biases,
    minimise,
    parameters_from_cylinder,
    tangent_frame,
    weighted_problem,
)
from lsvision.ellipse.problem import RadiusPrior
from lsvision.errors import DegenerateGeometry, TooFewPoints
from lsvision.geometry import Cylinder, FloatArray, Points, as_readonly_array
from lsvision.geometry.arrays import require_coordinates, require_covariances
from lsvision.statistics.numerical_failures import refuse_numerical_failure, require_finite

MIN_EXTENT_MM = 1e-9
"""Smallest extent of points that a cylinder is fitted to: the size of an atom."""
COPLANARITY_TOLERANCE = 1e-7
"""Thickness of a set of points over its extent under which it lies in a plane or on a line."""
SINGULARITY_TOLERANCE = 1e-14
"""Smallest eigenvalue of the information, its diagonal scaled to 1, that still is one."""


@dataclass(frozen=True, kw_only=True, slots=True)
class CylinderFittingSettings:
    """Joint fit of a cylinder.

    Parameters
    ----------
    reweightings : int
        How often the weights 1 / (n' Sigma n) are renewed at the fitted cylinder.
    truncation : float, optional
        Leave out points farther off than so many standard deviations, and fit again until
        the set stays; for points of which less than half are clutter. None keeps all. The
        deviation is the noise model's, or 1.4826 times the median of the residuals where
        that is more or there is no model.
    """

    reweightings: int = 3
    truncation: float | None = None

    def __post_init__(self) -> None:
        if not self.reweightings >= 1:
            raise ValueError(f"want one reweighting or more, got {self.reweightings}")
        if self.truncation is not None and not self.truncation > 1:
            raise ValueError(f"want a truncation above 1 sigma, got {self.truncation}")


def fit_cylinder(
    points: npt.ArrayLike,
    covariances: npt.ArrayLike | None = None,
    *,
    initial_guess: Cylinder | None = None,
    known_radius: RadiusPrior | None = None,
    settings: CylinderFittingSettings = CylinderFittingSettings(),
) -> CylinderFit:
    """Maximum-likelihood cylinder of points in space.

    Parameters
    ----------
    points : (n, 3) array_like
        In one frame, none lost; their order is used only to notice errors that neighbours
        share. Units: mm.
    covariances : (n, 3, 3) array_like, optional
        Covariance of each point's error. None: plain least squares of the distances, the
        noise estimated from the residuals. Units: mm^2.
    initial_guess : Cylinder, optional
        Where to begin; without, the fit finds its own start. With a start the minimum nearest
        to it is taken, also of one section's points, which have two (the twins).
    known_radius : RadiusPrior, optional
        A prior on the radius.
    settings : CylinderFittingSettings
        Reweightings and truncation.

    Returns
    -------
    CylinderFit
        The sign of its direction is that of the start; from a cold start its largest
        component is positive.

    Raises
    ------
    ValueError
        If the shapes are others, a number is not finite or beyond 1e9 mm, or a covariance is
        none: not positive semi-definite, or zero.
    TooFewPoints
        Under 6 points.
    DegenerateGeometry
        If all points lie at one place or on a line; or, without a start, in a plane: one section
        has two cylinders.
    FitFailed
        If no cylinder fits: the points of a plane with noise; or the numbers overflow.

    Notes
    -----
    Distances are corrected for the curvature over the length of a point's error, sigma^2 /
    (2 r) and the like: nothing beside the error of one point, much beside that of 10 000.

    Examples
    --------
    >>> angle, height = np.meshgrid(np.linspace(0, 2, 30), [0.0, 10.0])
    >>> pipe = np.stack([19 * np.cos(angle), 19 * np.sin(angle), height], axis=-1).reshape(-1, 3)
    >>> fit = fit_cylinder(pipe)
    >>> f"radius {fit.radius:.6f} mm, axis {fit.direction.round(6) + 0.0}"
    'radius 19.000000 mm, axis [0. 0. 1.]'
    """
    points, covariances = _checked(points, covariances)
    with refuse_numerical_failure("a cylinder"):
        fit = _fit_checked(points, covariances, initial_guess, known_radius, settings)
    cylinder = fit.cylinder
    require_finite("a cylinder", cylinder.point, cylinder.direction, fit.radius, fit.covariance)
    return fit


def _fit_checked(
    points: Points,
    covariances: FloatArray | None,
    initial_guess: Cylinder | None,
    known_radius: RadiusPrior | None,
    settings: CylinderFittingSettings,
) -> CylinderFit:
    origin, scale = points.mean(axis=0), float(np.ptp(points, axis=0).max())
    _refuse_degenerate(points - origin, twins_are_settled=initial_guess is not None)
    small = (points - origin) / scale
    small_covariances = None if covariances is None else covariances / scale**2
    known = known_radius and RadiusPrior(known_radius.radius / scale, known_radius.std / scale)
    if initial_guess is None:
        small_start = guess_cylinder(small, known)
    else:
        small_start = Cylinder(
            (initial_guess.point - origin) / scale,
            initial_guess.direction,
            initial_guess.radius / scale,
        )
    fit = _fit_truncated(small, small_covariances, small_start, known, settings)
    return _orient_like_initial_guess(_scaled_back(fit, origin, scale), initial_guess)


def _checked(
    points: npt.ArrayLike, covariances: npt.ArrayLike | None
) -> tuple[Points, FloatArray | None]:
    points = as_readonly_array(points, ("n", 3), "points")
    if len(points) <= PARAMETERS:
        raise TooFewPoints("a cylinder", len(points), PARAMETERS + 1, "see more of it")
    if not np.isfinite(points).all():
        raise ValueError("want finite points, got NaN or infinity: leave lost points out")
    require_coordinates(points)
    if np.ptp(points, axis=0).max() < MIN_EXTENT_MM:
        raise DegenerateGeometry(
            f"all {len(points)} points lie within {MIN_EXTENT_MM:g} mm, which any cylinder there "
            "fits: see an arc of it, or check the units"
        )
    if covariances is None:
        return points, None
    covariances = as_readonly_array(covariances, (len(points), 3, 3), "covariances")
    require_covariances(covariances)
    return points, covariances


def _refuse_degenerate(centred: Points, *, twins_are_settled: bool) -> None:
    thickness = np.linalg.svd(centred, compute_uv=False)
    if not thickness[1] > COPLANARITY_TOLERANCE * thickness[0]:
        raise DegenerateGeometry(
            f"all {len(centred)} points lie on one straight line, which any cylinder along it "
            "fits: see an arc of it"
        )
    if not twins_are_settled and not thickness[2] > COPLANARITY_TOLERANCE * thickness[0]:
        raise DegenerateGeometry(
            f"all {len(centred)} points lie in one plane: one section has two cylinders, the "
            "twins: add a second section, or give a start near the one you mean"
        )


def _fit_truncated(
    points: Points,
    covariances: FloatArray | None,
    start: Cylinder,
    known_radius: RadiusPrior | None,
    settings: CylinderFittingSettings,
) -> CylinderFit:
    kept = np.ones(len(points), dtype=bool)
    for _ in range(MAX_TRUNCATION_ITERATIONS):
        mine = None if covariances is None else covariances[kept]
        fit = _fit(points[kept], mine, start, known_radius, settings.reweightings)
        if settings.truncation is None:
            return fit
        start = fit.cylinder
        distances, stds, z = _compare_all(points, covariances, start)
        # Clutter spoils the first rounds; the limit closes in as the fit comes free of it.
        spread = max(1.0, 1.4826 * float(np.median(np.abs(z))))
        near = np.abs(z) <= settings.truncation * spread
        if near.sum() <= PARAMETERS or (near == kept).all():
            break
        kept = near
    return replace(fit, residuals=distances, normalised=z, stds=stds, inliers=kept)


MAX_TRUNCATION_ITERATIONS = 20
"""Rounds of truncation; five are usual."""


def _compare_all(
    points: Points, covariances: FloatArray | None, cylinder: Cylinder
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distances of all points, their standard deviations, and one over the other."""
    frame = tangent_frame(cylinder.direction)
    distances = cylinder.signed_distances(points)
    if covariances is None:
        spread = max(1.4826 * float(np.median(np.abs(distances))), 1e-300)
        return distances, np.full(len(points), spread), distances / spread
    turned = frame @ covariances @ frame.T
    stds, offsets, _ = distance_stds_and_biases(
        points @ frame.T, turned, parameters_from_cylinder(frame, cylinder)
    )
    return distances, stds, (distances - offsets) / stds


def _fit(
    points: Points,
    covariances: FloatArray | None,
    cylinder: Cylinder,
    known_radius: RadiusPrior | None,
    reweightings: int,
) -> CylinderFit:
    for _ in range(reweightings + 1):
        frame = tangent_frame(cylinder.direction)
        turned = None if covariances is None else frame @ covariances @ frame.T
        parameters = parameters_from_cylinder(frame, cylinder)
        problem = weighted_problem(points @ frame.T, turned, parameters, known_radius)
        cylinder = cylinder_from_parameters(frame, minimise(problem, parameters))
    feet = problem.points @ frame
    return _build_fit(points, feet, cylinder, problem, known_noise=covariances is not None)


def _build_fit(
    points: Points,
    feet: Points,
    cylinder: Cylinder,
    problem: CylinderProblem,
    *,
    known_noise: bool,
) -> CylinderFit:
    frame = tangent_frame(cylinder.direction)
    here = replace(problem, points=feet @ frame.T)
    evaluated, weighted = here.evaluate(parameters_from_cylinder(frame, cylinder))
    normalised = evaluated[: len(points)]
    factor, freedom, spread = variance_factor(
        normalised, len(evaluated) - PARAMETERS, known_noise=known_noise
    )
    return CylinderFit(
        cylinder=cylinder,
        covariance=factor * spread**2 * _inverse(weighted.T @ weighted),
        residuals=cylinder.signed_distances(points),
        normalised=normalised / spread,
        stds=problem.stds * spread,
        inliers=np.ones(len(points), dtype=bool),
        variance_factor=factor,
        degrees_of_freedom=freedom,
    )


def _inverse(information: FloatArray) -> FloatArray:
    """Inverse of the information after scaling.

    Raises
    ------
    DegenerateGeometry
        If a combination of the unknowns is free.
    """
    scale = 1 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    if not values[0] > SINGULARITY_TOLERANCE:
        raise DegenerateGeometry(
            "the points leave the cylinder free (too short an arc, or a section square to the "
            "axis): see more of it, or add a section"
        )
    inverse: FloatArray = (vectors / values) @ vectors.T
    return inverse * np.outer(scale, scale)


def _scaled_back(fit: CylinderFit, origin: FloatArray, scale: float) -> CylinderFit:
    small = fit.cylinder
    units = np.array([scale, scale, 1.0, 1.0, scale])
    return replace(
        fit,
        cylinder=Cylinder(small.point * scale + origin, small.direction, small.radius * scale),
        covariance=fit.covariance * np.outer(units, units),
        residuals=fit.residuals * scale,
        stds=fit.stds * scale,
    )


def _orient_like_initial_guess(fit: CylinderFit, start: Cylinder | None) -> CylinderFit:
    if start is None:
        backwards = fit.direction[np.argmax(np.abs(fit.direction))] < 0
    else:
        backwards = fit.direction @ start.direction < 0
    return fit.with_reversed_direction() if backwards else fit
