"""Other cylinders that fit the same points: search, comparison and decision.

Two short arcs on opposite sides, in different planes, lie on two cylinders up to the fourth order:
the axis of the second one is perpendicular to the line that joins the middles of the arcs. Between
both is a range of directions that fit less well, so that a fit from one does not find the other.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from lsvision.cylinder.fit_result import CylinderFit
from lsvision.cylinder.problem import (
    PARAMETERS,
    axis_distances,
    build_weighted_problem,
    cylinder_from_parameters,
    minimise,
    normalised_residuals,
    parameters_from_cylinder,
)
from lsvision.ellipse.problem import RadiusPrior
from lsvision.errors import DegenerateGeometry
from lsvision.geometry import BoolArray, Cylinder, FloatArray, IntArray, Points, build_tangent_frame
from lsvision.geometry.arrays import measure_extent
from lsvision.statistics.robust import SIGNIFICANT_SIGMAS, mad_std, median

AnyCylinder = TypeVar("AnyCylinder", Cylinder, CylinderFit)
MAX_CHI2_INCREASE = 9.0
"""Increase of chi^2, that of 3 standard deviations of one parameter, up to which another cylinder
fits as well."""
MIN_ANGLE = math.radians(0.05)
"""Angle below which two cylinders are the same minimum. Units: rad."""
PLANARITY_TOLERANCE = 1e-9
"""Largest distance of the points of one section from their plane: that of rounding to float64, 40
times the resolution at 1000 times the extent. Unit: extent of all points."""
MIN_PLANE_POINTS = 4
"""Smallest number of points of a section; any three points lie in a plane."""
MIN_NORMAL_COSINE = math.cos(math.radians(45.0))
"""Smallest cosine between the normals of two cylinders that errors along a normal may imitate."""
UNSCALED_VARIANCE = 1e-18
"""Variance of errors of which only the direction is known: so small that it causes no bias. Unit:
square of the extent of the points."""


def refine_cylinder(
    points: Points,
    candidate: Cylinder,
    known_radius: RadiusPrior | None,
    stds: FloatArray | None = None,
) -> Cylinder:
    """Return the least-squares cylinder near a candidate, with equal weights without `stds` (n,).

    The points (n, 3) should be centred at the origin.
    """
    frame = build_tangent_frame(candidate.direction)
    start = parameters_from_cylinder(frame, candidate)
    problem = build_weighted_problem(points @ frame.T, None, start, known_radius)
    if stds is not None:
        problem = replace(problem, stds=stds)
    return cylinder_from_parameters(frame, minimise(problem, start).parameters)


def select_distinct_cylinders(cylinders: Sequence[AnyCylinder]) -> list[AnyCylinder]:
    """Return the cylinders, or fits, without those parallel to an earlier one."""
    directions = np.array([cylinder.direction for cylinder in cylinders]).reshape(-1, 3)
    return [cylinders[k] for k in select_distinct_directions(directions)]


def select_distinct_directions(directions: FloatArray) -> list[int]:
    """Return the indices of the axes, unit vectors (k, 3), not parallel to an earlier one."""
    is_parallel = 1 - (directions @ directions.T) ** 2 <= math.sin(MIN_ANGLE) ** 2
    distinct = list[int]()
    for k, row in enumerate(is_parallel):
        if not row[distinct].any():
            distinct.append(k)
    return distinct


def angle_between_axes(first: Cylinder, second: Cylinder) -> float:
    """Return the angle between two axes without regard to their signs. Units: rad."""
    cross = np.linalg.norm(np.cross(first.direction, second.direction))
    return math.atan2(float(cross), abs(float(first.direction @ second.direction)))


@dataclass(frozen=True, eq=False, slots=True)
class CylinderComparison:
    """Points and their errors, by which cylinders are compared.

    Parameters
    ----------
    points : (n, 3) ndarray
        Points. Units: mm.
    covariances : (n, 3, 3) ndarray or None
        Covariance of each point's error, or a multiple of it if `noise_known` is false. None: the
        direction of the errors is unknown. Units: mm^2.
    noise_known : bool
        Whether the size of the errors is that of the covariances; otherwise it is estimated.
    known_radius : RadiusPrior or None
        Prior on the radius.
    truncation : float
        Normalised residual above which all outliers count the same; infinite without outliers.
    """

    points: Points
    covariances: FloatArray | None
    noise_known: bool
    known_radius: RadiusPrior | None = None
    truncation: float = math.inf

    @property
    def has_outliers(self) -> bool:
        """Whether the points may have outliers."""
        return math.isfinite(self.truncation)

    def select_rows(self, rows: IntArray) -> "CylinderComparison":
        """Return the comparison by the points at some rows."""
        covariances = None if self.covariances is None else self.covariances[rows]
        return replace(self, points=self.points[rows], covariances=covariances)

    def median_residual(self, cylinder: Cylinder) -> float:
        """Return the median of the moduli of the residuals, normalised by covariances if given."""
        return median(np.abs(self._residuals(cylinder)))

    def chi2(self, cylinders: Sequence[Cylinder]) -> FloatArray:
        """Return chi^2 of each cylinder (k,), with a common estimate of the noise if unknown.

        Without known noise the cylinder of the smallest residuals has a chi^2 of n - 5, apart from
        outliers and the prior.
        """
        values = np.array([self._residuals(cylinder) for cylinder in cylinders])
        return self._truncated_chi2(values, cylinders)

    def increase(self, other: Cylinder, best: Cylinder) -> float:
        """Return the increase of chi^2 from one cylinder to another.

        If the direction of the errors is unknown, and the normals of both differ by less than 45
        deg (`MIN_NORMAL_COSINE`), it is the smallest one: errors along the normals of `other` have
        smaller components along those of `best`.
        """
        values = np.array([self._residuals(best), self._residuals(other)])
        if self.covariances is None:
            cosines = np.abs((self._normals(best) * self._normals(other)).sum(axis=0))
            values[1] *= cosines if cosines.min() > MIN_NORMAL_COSINE else 1.0
        first, second = self._truncated_chi2(values, (best, other))
        return float(second - first)

    def _residuals(self, cylinder: Cylinder) -> FloatArray:
        """Return the residuals (n,), in mm, or normalised by covariances if given."""
        residuals, _, normalised = normalised_residuals(self.points, self.covariances, cylinder)
        return residuals if self.covariances is None else normalised

    def _normals(self, cylinder: Cylinder) -> FloatArray:
        """Return the unit normals (3, n) of a cylinder at the points."""
        frame = build_tangent_frame(cylinder.direction)
        parameters = parameters_from_cylinder(frame, cylinder)
        normals: FloatArray = frame.T @ axis_distances(self.points @ frame.T, parameters)[1]
        return normals

    def _truncated_chi2(self, values: FloatArray, cylinders: Sequence[Cylinder]) -> FloatArray:
        """Return truncated chi^2 (k,) of cylinders with residuals (k, n), and of the prior."""
        noise = 1.0
        if self.has_outliers:
            noise = min(mad_std(row) for row in values)
        elif not self.noise_known:
            degrees_of_freedom = max(values.shape[1] - PARAMETERS, 1)
            noise = math.sqrt(float((values**2).sum(axis=1).min()) / degrees_of_freedom)
        if self.noise_known:
            noise = max(noise, 1.0)
        scaled = np.abs(values) / max(noise, np.finfo(float).tiny)
        chi2: FloatArray = (np.minimum(scaled, self.truncation) ** 2).sum(axis=1)
        if self.known_radius is not None:
            deviations = np.array([c.radius for c in cylinders]) - self.known_radius.radius
            chi2 += (deviations / self.known_radius.effective_std) ** 2
        return chi2


def find_equivalent(
    best: CylinderFit, others: Iterable[Cylinder], comparison: CylinderComparison
) -> Cylinder | None:
    """Return the first cylinder that fits as well as the best fit, and differs from it.

    It differs if axis or radius are further off than `SIGNIFICANT_SIGMAS` standard deviations of
    the fit. None if there is none.
    """
    limit = MAX_CHI2_INCREASE * best.variance_factor
    for other in others:
        if differs(best, other) and comparison.increase(other, best.cylinder) < limit:
            return other
    return None


def sort_by_chi2(fits: Sequence[CylinderFit], comparison: CylinderComparison) -> list[CylinderFit]:
    """Return fits to the same points, the best one first."""
    if len(fits) == 1:
        return list(fits)
    chi2 = comparison.chi2([fit.cylinder for fit in fits])
    return [fits[k] for k in np.argsort(chi2, kind="stable")]


def keep_equivalent(
    fits: Sequence[CylinderFit], comparison: CylinderComparison
) -> list[CylinderFit]:
    """Return the best fit, and then the others that fit as well."""
    best, *others = sort_by_chi2(fits, comparison)
    return [best, *(fit for fit in others if find_equivalent(best, [fit.cylinder], comparison))]


def select_fit(
    fits: list[CylinderFit], comparison: CylinderComparison, scale: float
) -> CylinderFit:
    """Return the fit of the lowest chi^2; DegenerateGeometry if another one fits as well.

    `scale` is the unit of the fits in mm.
    """
    best, *others = keep_equivalent(fits, comparison)
    if not others:
        return best
    other = others[0]
    angle = math.degrees(angle_between_axes(best.cylinder, other.cylinder))
    raise DegenerateGeometry(
        f"two cylinders fit the points equally well, with radii of {best.radius * scale:.5g} mm "
        f"and {other.radius * scale:.5g} mm and {angle:.3g} deg between the axes: pass a known "
        "radius or an initial guess near the right one, or add a section or longer arcs"
    )


def differs(fit: CylinderFit, other: Cylinder) -> bool:
    """Return whether a cylinder differs significantly from that of a fit."""
    angle = angle_between_axes(fit.cylinder, other)
    sigmas = SIGNIFICANT_SIGMAS
    is_other_radius = abs(other.radius - fit.radius) > sigmas * fit.radius_std
    return angle > MIN_ANGLE and (angle > sigmas * fit.direction_std or is_other_radius)


def build_in_plane_covariances(points: Points) -> FloatArray | None:
    """Return the shape of the covariances of points that lie in planes: errors within the planes.

    Points (n, 3) of a section follow one another. The covariances (n, 3, 3) have a tiny size, as
    only their direction is known; None if the points are not exactly in planes.
    """
    extent = measure_extent(points)
    tolerance, start = PLANARITY_TOLERANCE * extent, 0
    covariances = np.empty((len(points), 3, 3))
    while start < len(points):
        normal, in_plane = _fit_first_plane(points[start:], tolerance)
        count = len(in_plane) if in_plane.all() else int(np.argmin(in_plane))
        if count < MIN_PLANE_POINTS:
            return None
        projection = np.eye(3) - np.outer(normal, normal)
        covariances[start : start + count] = UNSCALED_VARIANCE * extent**2 * projection
        start += count
    return covariances


def _fit_first_plane(points: Points, tolerance: float) -> tuple[FloatArray, BoolArray]:
    """Return the normal of the plane of the first points, and which of all points lie in it."""
    count = MIN_PLANE_POINTS
    while True:
        centred = points - points[:count].mean(axis=0)
        normal = np.linalg.svd(centred[:count], full_matrices=False)[2][2]
        in_plane: BoolArray = np.abs(centred @ normal) <= tolerance
        following = len(in_plane) if in_plane.all() else int(np.argmin(in_plane))
        if following <= count:
            return normal, in_plane
        count = following
