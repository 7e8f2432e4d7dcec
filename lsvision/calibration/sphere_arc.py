"""Detection and fit of the circular arc in which a profile cuts a sphere.

Every section of a sphere is a circle, so that three points yield a hypothesis. The module imports
neither `detection` nor `ellipse`, so that errors of the measurement do not affect the calibration.
"""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.errors import CalibrationFailed, LsvisionError, TooFewPoints
from lsvision.geometry import BoolArray, FloatArray, IntArray, Points
from lsvision.geometry.arrays import freeze_arrays
from lsvision.profile import Profile
from lsvision.statistics.correlation import debiased_autocorrelation_time
from lsvision.statistics.robust import mad_std


@dataclass(frozen=True, kw_only=True, slots=True)
class SphereArcSettings:
    """Settings of the detection of a sphere's arc in a profile.

    Parameters
    ----------
    tolerance : float
        Largest distance of an inlier from the circle during the search. Units: mm.
    max_incidence : float
        Largest angle of an inlier's normal from the section's Y; points on the flanks, seen at
        grazing incidence, are biased. Units: rad.
    min_coverage : float
        Smallest angle of the circle that an arc covers, from the 2nd to the 98th percentile of its
        points. Units: rad.
    min_points : int
        Smallest number of points of an arc, more than 3.
    min_radius : float
        Smallest circle; cuts near the pole of the sphere give little information. Units: mm.
    trials : int
        Number of random triples of points.
    seed : int
        Seed of the random triples.

    Raises
    ------
    ValueError
        If `tolerance`, `max_incidence` or `trials` is not positive, another number negative, or
        `min_points` not above 3.
    """

    tolerance: float = 0.3
    max_incidence: float = math.radians(70)
    min_coverage: float = math.radians(30)
    min_points: int = 20
    min_radius: float = 1.0
    trials: int = 600
    seed: int = 0

    def __post_init__(self) -> None:
        if not self.min_points > 3:
            raise ValueError(f"expected min_points above 3, got {self.min_points}")
        if not (self.tolerance > 0 and self.max_incidence > 0 and self.trials >= 1):
            raise ValueError(f"expected positive tolerance, max_incidence and trials, got {self}")
        if not (self.min_coverage >= 0 and self.min_radius >= 0 and self.seed >= 0):
            raise ValueError(
                f"expected min_coverage, min_radius and seed of at least 0, got {self}"
            )


@dataclass(frozen=True, eq=False)
class SphereArc:
    """Circle in which a profile cuts a sphere.

    Parameters
    ----------
    circle : (3,) array_like
        Centre x, y and radius, section frame. Units: mm.
    covariance : (3, 3) array_like
        Covariance of `circle` for uncorrelated points. Units: mm^2.
    height_scale_gradient : (2, 3) array_like
        Change of `circle` when heights are multiplied by 1 + s about its centre: first row
        times s plus second row times s^2. Units: mm.
    autocorrelation_time : float
        Number of points per effective point; 1 for uncorrelated points. The estimate of a single
        arc is inaccurate: take the mean of many, and multiply `covariance` by it.
    """

    circle: FloatArray
    covariance: FloatArray
    height_scale_gradient: FloatArray
    autocorrelation_time: float

    def __post_init__(self) -> None:
        freeze_arrays(self, circle=(3,), covariance=(3, 3), height_scale_gradient=(2, 3))


DEFAULT_SETTINGS = SphereArcSettings()
_REMEDY = "check that the sphere is in view, and that no larger arc of another object is"
"""Remedy for a profile without the arc."""
MAX_SCORED_POINTS = 700
"""Largest number of points with which hypotheses are scored."""
HEIGHT_SCALE_STEP = 0.1
"""Relative change of the heights for the difference quotients of a circle."""
MAX_NOISE_FACTOR = 1.02
"""Factor by which circles through three noisy points of the largest section may be larger."""
MIN_WINDOW_POINTS = 15
"""Smallest window of neighbouring points from which a triple is drawn."""
OUTLIER_SIGMAS = 3.5
"""Distance in robust standard deviations beyond which a point is an outlier; as in `plane_line`."""


def find_sphere_arc(
    profile: Profile,
    max_radius: float | None = None,
    settings: SphereArcSettings = DEFAULT_SETTINGS,
) -> SphereArc:
    """Return the largest circular arc in a profile that is convex towards the sensor.

    The profile may contain scattered points, plates and artefacts. No section is larger than the
    sphere of radius `max_radius`, where that is known. The geometric least-squares circle of the
    arc is weighted by the profile's noise model if it has one. Units: mm.

    Raises
    ------
    TooFewPoints
        If no arc has enough points.
    CalibrationFailed
        If none covers enough of a circle.

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
        raise TooFewPoints("profile of the sphere", len(points), settings.min_points, _REMEDY)
    circle = _find_best_hypothesis(points, max_radius, settings)
    tolerance = settings.tolerance
    variances = np.ones(len(points))
    inliers = _mask_arc(points, circle, tolerance, settings)
    for _ in range(12):
        _require_arc(points, circle, inliers, settings)
        previous, variances = inliers, _normal_variances(profile, indices, circle)
        circle = _fit_circle(points[inliers], circle, variances[inliers])
        std = mad_std(_residuals(points[inliers], circle))
        tolerance = min(settings.tolerance, max(OUTLIER_SIGMAS * std, 1e-6))
        inliers = _mask_arc(points, circle, tolerance, settings)
        if np.array_equal(inliers, previous):
            break
    _require_arc(points, circle, inliers, settings)
    return _build_arc(points[inliers], circle, variances[inliers], profile.noise is None)


def _find_best_hypothesis(
    points: Points, max_radius: float | None, settings: SphereArcSettings
) -> FloatArray:
    """Return the circle through three points with the largest support (RANSAC).

    The support of a point falls with its squared distance from the circle, to 0 at the tolerance.
    """
    rng = np.random.default_rng(settings.seed)
    circles = _fit_circles_through_triples(
        points[_draw_near_triples(len(points), settings.trials, rng)]
    )
    limit = np.inf if max_radius is None else MAX_NOISE_FACTOR * max_radius + settings.tolerance
    allowed = np.isfinite(circles).all(axis=1)
    allowed &= (circles[:, 2] >= settings.min_radius) & (circles[:, 2] <= limit)
    circles = circles[allowed]
    sample = points[:: math.ceil(len(points) / MAX_SCORED_POINTS)]
    offset = sample[None] - circles[:, None, :2]
    distance = np.hypot(offset[..., 0], offset[..., 1])
    cost = np.minimum(((distance - circles[:, 2:]) / settings.tolerance) ** 2, 1.0)
    facing = offset[..., 1] >= math.cos(settings.max_incidence) * distance
    support = np.where(facing, 1.0 - cost, 0.0).sum(axis=1)
    circles = circles[np.argsort(-support, kind="stable")]
    failure: LsvisionError | None = None
    for circle in circles:
        inliers = _mask_arc(points, circle, settings.tolerance, settings)
        try:
            _require_arc(points, circle, inliers, settings)
        except (TooFewPoints, CalibrationFailed) as error:
            failure = failure or error
        else:
            best: FloatArray = circle
            return best
    raise failure or TooFewPoints("best arc of the sphere", 0, settings.min_points, _REMEDY)


def _draw_near_triples(count: int, trials: int, rng: np.random.Generator) -> IntArray:
    """Return random triples (k, 3) from windows of `MIN_WINDOW_POINTS` up to the whole profile.

    The points of an arc are neighbours in the profile, those of clutter are not.
    """
    shortest = min(count, MIN_WINDOW_POINTS)
    lengths = np.geomspace(shortest, count, trials).astype(np.int64)
    starts = (rng.random(trials) * (count - lengths + 1)).astype(np.int64)
    thirds = (np.arange(3) + rng.random((trials, 3))) / 3
    triples: IntArray = starts[:, None] + (thirds * lengths[:, None]).astype(np.int64)
    return np.minimum(triples, count - 1)


def _fit_circles_through_triples(triples: FloatArray) -> FloatArray:
    """Return the circles (centre x, y, radius) through (k, 3, 2) points; NaN if collinear."""
    first = triples[:, 0]
    b, c = triples[:, 1] - first, triples[:, 2] - first
    double_area = 2 * (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
    b2, c2 = (b**2).sum(axis=1), (c**2).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (c[:, 1] * b2 - b[:, 1] * c2) / double_area
        y = (b[:, 0] * c2 - c[:, 0] * b2) / double_area
    return np.column_stack([x + first[:, 0], y + first[:, 1], np.hypot(x, y)])


def _residuals(points: Points, circle: FloatArray) -> FloatArray:
    """Return the signed distances of points from a circle."""
    offset = points - circle[:2]
    residuals: FloatArray = np.hypot(offset[:, 0], offset[:, 1]) - circle[2]
    return residuals


def _mask_arc(
    points: Points, circle: FloatArray, tolerance: float, settings: SphereArcSettings
) -> BoolArray:
    """Return the mask of points that are near the circle and face the sensor."""
    offset = points - circle[:2]
    distance = np.hypot(offset[:, 0], offset[:, 1])
    close = np.abs(distance - circle[2]) <= tolerance
    on_arc: BoolArray = close & (offset[:, 1] >= math.cos(settings.max_incidence) * distance)
    return on_arc


def _measure_angular_coverage(points: Points, circle: FloatArray) -> float:
    """Return the angle (rad) between the 2nd and 98th percentile of the points on a circle."""
    angles = np.arctan2(points[:, 0] - circle[0], points[:, 1] - circle[1])
    low, high = np.percentile(angles, [2, 98])
    return float(high - low)


def _require_arc(
    points: Points, circle: FloatArray, inliers: BoolArray, settings: SphereArcSettings
) -> None:
    """Raise an error unless the inliers are an arc."""
    if inliers.sum() < settings.min_points:
        raise TooFewPoints(
            "best arc of the sphere", int(inliers.sum()), settings.min_points, _REMEDY
        )
    coverage = _measure_angular_coverage(points[inliers], circle)
    if coverage < settings.min_coverage:
        raise CalibrationFailed(
            f"the best arc of the sphere covers {math.degrees(coverage):.0f} deg and "
            f"{math.degrees(settings.min_coverage):.0f} deg are needed: {_REMEDY}"
        )


def _normal_variances(profile: Profile, indices: IntArray, circle: FloatArray) -> FloatArray:
    """Return the variance n' Sigma n of each point; ones without noise model. Units: mm^2."""
    if profile.noise is None:
        return np.ones(len(indices))
    normals = _normals(profile.points[indices], circle)
    covariances = profile.noise.covariances(profile.points)[indices]
    variances: FloatArray = np.einsum("ni,nij,nj->n", normals, covariances, normals)
    return variances


def _jacobian(points: Points, circle: FloatArray) -> FloatArray:
    """Return the Jacobian (n, 3) of the residuals by centre and radius."""
    return np.column_stack([-_normals(points, circle), -np.ones(len(points))])


def _normals(points: Points, circle: FloatArray) -> FloatArray:
    """Return the unit vectors (n, 2) from the circle's centre to points."""
    offset = points - circle[:2]
    return offset / np.maximum(np.hypot(offset[:, 0], offset[:, 1]), 1e-12)[:, None]


def _fit_circle(points: Points, initial_guess: FloatArray, variances: FloatArray) -> FloatArray:
    """Return the circle that minimises the squared distances, by Gauss-Newton steps."""
    circle = initial_guess.copy()
    weights = 1 / np.sqrt(variances)
    for _ in range(10):
        jacobian = _jacobian(points, circle) * weights[:, None]
        step = np.linalg.lstsq(jacobian, -_residuals(points, circle) * weights, rcond=None)[0]
        circle = circle + step
        if np.abs(step).max() < 1e-10:
            break
    return circle


def _build_arc(
    points: Points,
    circle: FloatArray,
    variances: FloatArray,
    estimate_noise: bool,
) -> SphereArc:
    """Return the arc with covariance and autocorrelation time.

    If `estimate_noise`, the `variances` of the points are relative, and their factor is estimated.
    """
    residuals, jacobian = _residuals(points, circle), _jacobian(points, circle)
    dof = len(points) - 3
    variance_factor = float((residuals**2 / variances).sum()) / dof
    # A stated noise is only increased, where the residuals are larger than it predicts.
    variance_factor = variance_factor if estimate_noise else max(variance_factor, 1.0)
    information = jacobian.T @ (jacobian / variances[:, None])
    # The floor keeps the covariance of exact points invertible.
    covariance = variance_factor * np.linalg.inv(information) + 1e-12 * np.eye(3)
    gradient = _height_scale_gradient(points, circle, variances)
    autocorrelation_time = debiased_autocorrelation_time(residuals / np.sqrt(variances), 3)
    return SphereArc(circle, covariance, gradient, autocorrelation_time)


def _height_scale_gradient(points: Points, circle: FloatArray, variances: FloatArray) -> FloatArray:
    """Return first and half of the second difference quotient of the circle by the height scale."""
    low, high = (
        _fit_circle(circle[:2] + (points - circle[:2]) * (1.0, 1.0 + s), circle, variances)
        for s in (-HEIGHT_SCALE_STEP, HEIGHT_SCALE_STEP)
    )
    return np.stack(
        [(high - low) / (2 * HEIGHT_SCALE_STEP), ((high + low) / 2 - circle) / HEIGHT_SCALE_STEP**2]
    )
