"""Initial guess of a cylinder: circles in the projections along a grid of directions."""

import numpy as np

from lsvision.cylinder.alternatives import (
    CylinderComparison,
    refine_cylinder,
    select_distinct_cylinders,
)
from lsvision.cylinder.other_minima import find_tilted_minima
from lsvision.ellipse.problem import RadiusPrior
from lsvision.errors import DegenerateGeometry, FitFailed
from lsvision.geometry import (
    Cylinder,
    FloatArray,
    IntArray,
    Points,
    build_hemisphere_directions,
    build_tangent_frame,
)
from lsvision.geometry.arrays import TINY, rms
from lsvision.profile import MAX_RELATIVE_SCATTER
from lsvision.statistics.robust import mad_std

DIRECTION_COUNT = 400
"""Number of directions in the grid over the hemisphere. They are 7 deg apart, so that the
refinement of one of them converges to the cylinder even for a short arc."""
MAX_CANDIDATES = 8
"""Number of best directions of each grid that are refined."""
MIN_STRETCH = 2.0
"""Ratio of length to width of the points, above which the stretched grid is also searched. The
initial direction must be correct to about radius / length; the regular grid is sufficient for
ratios up to about 5."""
MAX_DISTINCT_COSINE = np.cos(np.radians(12.0))
"""Largest cosine of the angle between two candidates: that of 12 deg."""
SAME_COST_TOLERANCE = 1e-6
"""Relative difference of the costs of candidates that have converged to the same cylinder."""
MAX_POINTS = 400
"""Largest number of points for the initial guess, selected evenly; more points do not improve
it."""
MAX_DISTINCT_COSINE_WITH_OUTLIERS = np.cos(np.radians(25.0))
"""Largest cosine between two candidates if there may be outliers: that of 25 deg. Outliers make
many neighbouring directions across short arcs better than those along them."""
MAX_CANDIDATES_WITH_OUTLIERS = 12
"""Number of best directions of each grid that are refined if there may be outliers."""
ROBUST_STEPS = 8
"""Number of robust fits; the half of the points nearest to the last fit, instead of weights, finds
fewer cylinders of short arcs."""
RIDGE = 1e-12
"""Ridge of a normal matrix relative to its trace, with which it is invertible also where projected
points are collinear, and smallest squared radius, for points with an extent of 1."""
MIN_ROBUST_STD = 1e-9
"""Smallest standard deviation of a robust fit. Unit: extent of the points."""


def guess_cylinders(comparison: CylinderComparison) -> list[Cylinder]:
    """Estimate a cylinder without an initial guess, and others that fit nearly as well.

    For each direction of a grid, an algebraic circle is fitted to the projection of the points
    along it; the best directions are refined by least squares with equal weights. For elongated
    points a second grid is used, which is finer near their long axis. From the best cylinder others
    are searched that are too near to it for the grid.

    Parameters
    ----------
    comparison : CylinderComparison
        Points, centred at the origin and scaled to an extent of about 1, with their errors. With
        a truncation, cylinders are refined with robust weights, and the median of the residuals
        decides.

    Returns
    -------
    list of Cylinder
        The best cylinder first, then the other minima, however well they fit with equal weights.

    Raises
    ------
    FitFailed
        If no direction leads to a cylinder.
    DegenerateGeometry
        If the direction of the errors is unknown, and the best cylinder is one between two sections
        of short arcs; see `_require_no_wider_arc`.
    """
    rows = np.linspace(0, len(comparison.points) - 1, min(len(comparison.points), MAX_POINTS))
    subset = comparison.select_rows(rows.astype(int))
    candidates = _build_candidates(subset.points, has_outliers=subset.has_outliers)
    cylinders = _refine_all(candidates, subset, robustly=subset.has_outliers)
    if not cylinders:
        raise FitFailed(
            "no cylinder fits the points: they lie on another surface; use points of one cylinder"
        )
    best = cylinders[_find_best(cylinders, subset)]
    inliers = subset.select_rows(_find_inliers(best, subset))
    cylinders += find_tilted_minima(inliers.points, best, inliers.known_radius)
    best = cylinders.pop(_find_best(cylinders, subset))
    if subset.covariances is None:
        _require_no_wider_arc(subset, best, cylinders)
    return select_distinct_cylinders([best, *cylinders])


def _find_inliers(cylinder: Cylinder, comparison: CylinderComparison) -> IntArray:
    """Return the rows of the points near a cylinder; without outliers those of all points."""
    distances = np.abs(cylinder.signed_distances(comparison.points))
    limit = comparison.truncation * max(mad_std(distances), MIN_ROBUST_STD)
    return np.flatnonzero(distances <= limit)


def _refine_all(
    candidates: list[Cylinder], comparison: CylinderComparison, *, robustly: bool = False
) -> list[Cylinder]:
    """Return the least-squares cylinders near candidates, without those that fail."""
    points, known_radius, refined = comparison.points, comparison.known_radius, list[Cylinder]()
    for candidate in candidates:
        try:
            cylinder = refine_cylinder(points, candidate, known_radius)
            if robustly:
                cylinder = _refine_robustly(points, cylinder, known_radius)
        except FitFailed:
            continue
        refined.append(cylinder)
    return refined


def _find_best(cylinders: list[Cylinder], comparison: CylinderComparison) -> int:
    """Return the index of the first of the cylinders with the lowest cost."""
    if comparison.has_outliers:
        costs = np.array([comparison.median_residual(cylinder) for cylinder in cylinders])
    else:
        costs = comparison.chi2(cylinders)
    return int(np.argmax(costs <= costs.min() * (1 + SAME_COST_TOLERANCE)))


def _require_no_wider_arc(
    comparison: CylinderComparison, best: Cylinder, cylinders: list[Cylinder]
) -> None:
    """Raise DegenerateGeometry if points on two sides of a cylinder may also lie on a wider arc.

    Two sections of a short arc lie near a second cylinder, between the laser planes, which touches
    each of them along a line. Errors within the planes are tangential to it, so that its residuals
    may be smaller than those of the true cylinder.
    """
    points = comparison.points
    half_width, has_two_sides = _measure_coverage(points, best)
    for other in cylinders if has_two_sides else []:
        other_half_width, other_has_two_sides = _measure_coverage(points, other)
        is_wider = other_half_width > half_width and not other_has_two_sides
        distances = other.signed_distances(points)
        scatter = mad_std(distances) if comparison.has_outliers else rms(distances)
        if is_wider and scatter <= MAX_RELATIVE_SCATTER * other.radius:
            raise DegenerateGeometry(
                "two cylinders fit the points: one between two sections, and one along them, with "
                f"{other.radius / best.radius:.2g} times its radius; pass covariances, an initial "
                "guess near the right one, or a third section"
            )


def _measure_coverage(points: Points, cylinder: Cylinder) -> tuple[float, bool]:
    """Return the largest angle (rad) between the normals at points and their main direction.

    Opposite normals count as one direction. The second result is whether the points are on two
    sides, with an angle of at most 45 deg.
    """
    normals = cylinder.normals(points)
    _, vectors = np.linalg.eigh(normals.T @ normals)
    cosines = normals @ vectors[:, -1]
    half_width = float(np.arccos(np.abs(cosines).min().clip(0.0, 1.0)))
    return half_width, half_width <= np.pi / 4 and cosines.min() < 0 < cosines.max()


def _build_candidates(points: Points, *, has_outliers: bool) -> list[Cylinder]:
    """Return the best cylinders of a regular and, for elongated points, of a stretched grid.

    The stretched grid is regular in coordinates that are compressed along the long axis until the
    points are as wide as long; its directions are closer together near that axis.
    """
    grid = build_hemisphere_directions(DIRECTION_COUNT)
    grids = [grid]
    _, extents, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    stretch = extents[0] / max(extents[1], TINY)
    if stretch > MIN_STRETCH:
        stretched = grid + (stretch - 1) * np.outer(grid @ axes[0], axes[0])
        grids.append(stretched / np.linalg.norm(stretched, axis=1, keepdims=True))
    candidates = []
    for directions in grids:
        centres, radii, costs = fit_projected_circles(points, directions)
        candidates += [
            Cylinder(centres[k], directions[k], radii[k])
            for k in _select_best_distinct_directions(grid, costs, has_outliers=has_outliers)
        ]
    return candidates


def fit_projected_circles(
    points: Points, directions: FloatArray
) -> tuple[Points, FloatArray, FloatArray]:
    """Return the algebraic circles (Kasa) fitted to the projections along each direction.

    For centred points (n, 3) and k unit vectors (k, 3): centres (k, 3) on the planes through the
    origin perpendicular to the directions, radii (k,), and costs (k,), the mean squares of
    (algebraic residual / diameter), which approximate the mean square distances from the circles.
    """
    frames = np.stack([build_tangent_frame(u)[:2] for u in directions])
    projected = np.einsum("kij,nj->kni", frames, points)
    squared_distances = (projected**2).sum(axis=2)
    design = np.concatenate([projected, np.ones((*squared_distances.shape, 1))], axis=2)
    normal = np.einsum("kni,knj->kij", design, design)
    ridge = RIDGE * np.trace(normal, axis1=1, axis2=2)
    normal += ridge[:, None, None] * np.eye(3)
    solution = np.linalg.solve(
        normal, np.einsum("kni,kn->ki", design, squared_distances)[..., None]
    )[..., 0]
    centre = solution[:, :2] / 2
    radii = np.sqrt(np.maximum(solution[:, 2] + (centre**2).sum(axis=1), RIDGE))
    residuals = squared_distances - np.einsum("kni,ki->kn", design, solution)
    costs = (residuals**2).mean(axis=1) / (2 * radii) ** 2
    return np.einsum("kij,ki->kj", frames, centre), radii, costs


def _select_best_distinct_directions(
    directions: FloatArray, costs: FloatArray, *, has_outliers: bool
) -> list[int]:
    """Return the indices of the distinct directions with the lowest costs, best first.

    For a stretched grid, `directions` are those before stretching.
    """
    cosine = MAX_DISTINCT_COSINE_WITH_OUTLIERS if has_outliers else MAX_DISTINCT_COSINE
    count = MAX_CANDIDATES_WITH_OUTLIERS if has_outliers else MAX_CANDIDATES
    selected: list[int] = []
    for index in np.argsort(costs, kind="stable"):
        if all(abs(directions[index] @ directions[other]) < cosine for other in selected):
            selected.append(int(index))
            if len(selected) == count:
                break
    return selected


def _refine_robustly(
    points: Points, cylinder: Cylinder, known_radius: RadiusPrior | None
) -> Cylinder:
    """Return a cylinder refitted several times with the weights of a Cauchy distribution."""
    for _ in range(ROBUST_STEPS):
        distances = cylinder.signed_distances(points)
        std = max(mad_std(distances), MIN_ROBUST_STD)
        cylinder = refine_cylinder(points, cylinder, known_radius, np.hypot(1.0, distances / std))
    return cylinder
