"""The arc that a sphere shows in one profile, found in clutter and fitted as a circle.

Written apart from `detection` and `ellipse`: a calibration does not rest on what it is to
calibrate. Every section of a sphere is a circle, so three points make a hypothesis.
"""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.calibration.autocorrelation import autocorrelation_time
from lsvision.errors import TooFewPoints
from lsvision.geometry import BoolArray, FloatArray, IntArray, Points, as_readonly_array
from lsvision.profile import Profile


@dataclass(frozen=True, kw_only=True, slots=True)
class SphereArcSettings:
    """How the arc of a sphere is told from what else a profile shows.

    Parameters
    ----------
    tolerance : float
        Distance from the circle at which a point still counts while searching. Units: mm.
    max_incidence : float
        Points whose normal leans further from the sensor's Y are left out: flanks are seen at
        a glance and lie. Units: rad.
    min_coverage : float
        Smallest angle of circle an arc must cover. Units: rad.
    min_points : int
        Fewest points of an arc.
    min_radius : float
        Smallest circle believed; cuts near the pole of the sphere say little. Units: mm.
    trials : int
        Triples of points tried.
    seed : int
        Of the choice of triples; same seed, same arc.
    """

    tolerance: float = 0.3
    max_incidence: float = math.radians(70)
    min_coverage: float = math.radians(30)
    min_points: int = 20
    min_radius: float = 1.0
    trials: int = 600
    seed: int = 0


@dataclass(frozen=True, eq=False)
class SphereArc:
    """Circle in which a profile cuts a sphere.

    Parameters
    ----------
    circle : (3,) array_like
        Centre x, y and radius, section frame. Units: mm.
    covariance : (3, 3) array_like
        Of `circle`, were each point's error its own. Units: mm^2.
    height_scale_gradient : (2, 3) array_like
        Change of `circle` when heights are multiplied by 1 + s about its centre: first row
        times s plus second row times s^2. Units: mm.
    autocorrelation_time : float
        Points that say as much as one whose error is its own; 1 where neighbours do not err
        alike. A single arc tells it roughly: take the mean of many, and multiply `covariance`.
    indices : tuple of int
        Points of the profile it rests on.
    residual_std : float
        Of those points from the circle. Units: mm.
    """

    circle: FloatArray
    covariance: FloatArray
    height_scale_gradient: FloatArray
    autocorrelation_time: float
    indices: tuple[int, ...]
    residual_std: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "circle", as_readonly_array(self.circle, (3,), "circle"))
        object.__setattr__(
            self, "covariance", as_readonly_array(self.covariance, (3, 3), "covariance")
        )
        object.__setattr__(
            self,
            "height_scale_gradient",
            as_readonly_array(self.height_scale_gradient, (2, 3), "height_scale_gradient"),
        )


DEFAULT = SphereArcSettings()
MAX_SCORED_POINTS = 700
HEIGHT_SCALE_STEP = 0.1
"""Relative change of the heights at which a circle's change with them is read off."""
OUTLIER_SIGMAS = 3.5
"""Robust standard deviations beyond which a point is none of the sphere's."""


def find_sphere_arc(
    profile: Profile, max_radius: float | None = None, settings: SphereArcSettings = DEFAULT
) -> SphereArc:
    """Largest arc of a circle, convex towards the sensor.

    Parameters
    ----------
    profile : Profile
        Section frame; scattered points, plates and false ends may be in it.
    max_radius : float, optional
        Radius of the sphere where known: no section is larger. Units: mm.
    settings : SphereArcSettings
        See there.

    Returns
    -------
    SphereArc
        Geometric least-squares circle, weighted by the profile's noise model if it has one.

    Raises
    ------
    TooFewPoints
        If no arc covers enough of a circle with enough points.

    Examples
    --------
    >>> angle = np.linspace(0.6, 2.5, 200)
    >>> points = np.column_stack([15 * np.cos(angle), 15 * np.sin(angle) - 300])
    >>> find_sphere_arc(Profile(points)).circle.round(6) + 0.0
    array([   0., -300.,   15.])
    """
    indices = np.flatnonzero(np.isfinite(profile.points[:, 0]))
    points = profile.points[indices]
    if len(points) < settings.min_points:
        raise TooFewPoints("profile of the sphere", len(points), settings.min_points, _HINT)
    circle = _best_hypothesis(points, max_radius, settings)
    tolerance = settings.tolerance
    variances = np.ones(len(points))
    keep = _on_arc(points, circle, tolerance, settings)
    for _ in range(12):
        _require(points, circle, keep, settings)
        previous, variances = keep, _normal_variances(profile, indices, circle)
        circle = _fit_circle(points[keep], circle, variances[keep])
        spread = _mad_std(_residuals(points[keep], circle))
        tolerance = min(settings.tolerance, max(OUTLIER_SIGMAS * spread, 1e-6))
        keep = _on_arc(points, circle, tolerance, settings)
        if np.array_equal(keep, previous):
            break
    _require(points, circle, keep, settings)
    return _as_arc(points[keep], circle, variances[keep], indices[keep], profile.noise is None)


_HINT = "is the sphere in view, and no circle of another size more prominent?"


def _best_hypothesis(
    points: Points, max_radius: float | None, settings: SphereArcSettings
) -> FloatArray:
    rng = np.random.default_rng(settings.seed)
    circles = _circles_through(points[_near_triples(len(points), settings.trials, rng)])
    limit = np.inf if max_radius is None else 1.02 * max_radius + settings.tolerance
    fits = np.isfinite(circles).all(axis=1)
    fits &= (circles[:, 2] >= settings.min_radius) & (circles[:, 2] <= limit)
    circles = circles[fits]
    sample = points[:: max(1, len(points) // MAX_SCORED_POINTS)]
    offset = sample[None] - circles[:, None, :2]
    distance = np.hypot(offset[..., 0], offset[..., 1])
    cost = np.minimum(((distance - circles[:, 2:]) / settings.tolerance) ** 2, 1.0)
    facing = offset[..., 1] >= math.cos(settings.max_incidence) * distance
    support = np.where(facing, 1.0 - cost, 0.0).sum(axis=1)
    for index in np.argsort(-support):
        keep = _on_arc(points, circles[index], settings.tolerance, settings)
        if keep.sum() >= settings.min_points and _angular_coverage(
            points[keep], circles[index]
        ) >= (settings.min_coverage):
            best: FloatArray = circles[index]
            return best
    raise TooFewPoints("best arc of the sphere", 0, settings.min_points, _HINT)


def _near_triples(count: int, trials: int, rng: np.random.Generator) -> IntArray:
    """Triples from windows of many lengths: an arc is a run of neighbours, clutter is not."""
    shortest = min(count, 15)
    lengths = np.geomspace(shortest, count, trials).astype(np.int64)
    starts = (rng.random(trials) * (count - lengths + 1)).astype(np.int64)
    thirds = (np.arange(3) + rng.random((trials, 3))) / 3
    triples: IntArray = starts[:, None] + (thirds * lengths[:, None]).astype(np.int64)
    return np.minimum(triples, count - 1)


def _circles_through(triples: FloatArray) -> FloatArray:
    """Circles (centre x, y, radius) through (k, 3, 2) points; NaN where they are collinear."""
    first = triples[:, 0]
    b, c = triples[:, 1] - first, triples[:, 2] - first
    double_area = 2 * (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
    b2, c2 = (b**2).sum(axis=1), (c**2).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (c[:, 1] * b2 - b[:, 1] * c2) / double_area
        y = (b[:, 0] * c2 - c[:, 0] * b2) / double_area
    return np.column_stack([x + first[:, 0], y + first[:, 1], np.hypot(x, y)])


def _residuals(points: Points, circle: FloatArray) -> FloatArray:
    offset = points - circle[:2]
    residuals: FloatArray = np.hypot(offset[:, 0], offset[:, 1]) - circle[2]
    return residuals


def _on_arc(
    points: Points, circle: FloatArray, tolerance: float, settings: SphereArcSettings
) -> BoolArray:
    offset = points - circle[:2]
    distance = np.hypot(offset[:, 0], offset[:, 1])
    near = np.abs(distance - circle[2]) <= tolerance
    keep: BoolArray = near & (offset[:, 1] >= math.cos(settings.max_incidence) * distance)
    return keep


def _angular_coverage(points: Points, circle: FloatArray) -> float:
    """Angle between the outer percentiles: a few stray points cover nothing."""
    angles = np.arctan2(points[:, 0] - circle[0], points[:, 1] - circle[1])
    low, high = np.percentile(angles, [2, 98])
    return float(high - low)


def _require(
    points: Points,
    circle: FloatArray,
    keep: BoolArray,
    settings: SphereArcSettings,
) -> None:
    count = int(keep.sum())
    if (
        count < settings.min_points
        or _angular_coverage(points[keep], circle) < settings.min_coverage
    ):
        raise TooFewPoints("best arc of the sphere", count, settings.min_points, _HINT)


def _normal_variances(profile: Profile, indices: IntArray, circle: FloatArray) -> FloatArray:
    """Variance n' Sigma n of each point's noise; ones where the profile knows none. Units: mm^2."""
    if profile.noise is None:
        return np.ones(len(indices))
    normals = profile.points[indices] - circle[:2]
    normals = normals / np.maximum(np.hypot(normals[:, 0], normals[:, 1]), 1e-12)[:, None]
    covariances = profile.noise.covariances(profile.points)[indices]
    variances: FloatArray = np.einsum("ni,nij,nj->n", normals, covariances, normals)
    return variances


def _jacobian(points: Points, circle: FloatArray) -> FloatArray:
    offset = points - circle[:2]
    units = offset / np.maximum(np.hypot(offset[:, 0], offset[:, 1]), 1e-12)[:, None]
    return np.column_stack([-units, -np.ones(len(points))])


def _fit_circle(points: Points, start: FloatArray, variances: FloatArray) -> FloatArray:
    """Gauss-Newton on distances from the circle; from a RANSAC start a few steps suffice."""
    circle = start.copy()
    weights = 1 / np.sqrt(variances)
    for _ in range(10):
        jacobian = _jacobian(points, circle) * weights[:, None]
        step = np.linalg.lstsq(jacobian, -_residuals(points, circle) * weights, rcond=None)[0]
        circle = circle + step
        if np.abs(step).max() < 1e-10:
            break
    return circle


def _mad_std(residuals: FloatArray) -> float:
    return 1.4826 * float(np.median(np.abs(residuals)))


def _as_arc(
    points: Points, circle: FloatArray, variances: FloatArray, indices: IntArray, unknown: bool
) -> SphereArc:
    residuals, jacobian = _residuals(points, circle), _jacobian(points, circle)
    dof = len(points) - 3
    scale = float((residuals**2 / variances).sum()) / dof
    # A stated noise is only ever made larger, where the points scatter more than it says.
    scale = scale if unknown else max(scale, 1.0)
    information = jacobian.T @ (jacobian / variances[:, None])
    covariance = scale * np.linalg.inv(information) + 1e-12 * np.eye(3)
    std = math.sqrt(float((residuals**2).sum()) / dof)
    stretch = _height_scale_gradient(points, circle, variances)
    likeness = autocorrelation_time(residuals / np.sqrt(variances), 3)
    return SphereArc(circle, covariance, stretch, likeness, tuple(int(i) for i in indices), std)


def _height_scale_gradient(points: Points, circle: FloatArray, variances: FloatArray) -> FloatArray:
    low, high = (
        _fit_circle(circle[:2] + (points - circle[:2]) * (1.0, 1.0 + s), circle, variances)
        for s in (-HEIGHT_SCALE_STEP, HEIGHT_SCALE_STEP)
    )
    return np.stack(
        [(high - low) / (2 * HEIGHT_SCALE_STEP), ((high + low) / 2 - circle) / HEIGHT_SCALE_STEP**2]
    )
