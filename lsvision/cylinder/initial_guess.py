"""Cold start of a cylinder fit: circles in the projections along a grid of directions."""

import numpy as np

from lsvision.cylinder.problem import (
    CylinderProblem,
    cylinder_from_parameters,
    minimise,
    parameters_from_cylinder,
    tangent_frame,
)
from lsvision.ellipse.problem import RadiusPrior
from lsvision.errors import FitFailed
from lsvision.geometry import Cylinder, FloatArray, Points

DIRECTIONS = 400
"""Of the grid over the half sphere: 7 deg apart, well inside the minimum of a short arc."""
TRIES = 8
"""Best directions that are refined."""
DISTINCT_DIRECTION_COSINE = np.cos(np.radians(12.0))
"""Cosine of the angle under which two directions count as one."""
MAX_POINTS = 400
"""A start needs no more."""


def guess_cylinder(points: Points, known_radius: RadiusPrior | None = None) -> Cylinder:
    """Least-squares cylinder of points anywhere, without a start.

    Each direction of a grid is tried by the algebraic circle of the points seen along it; the
    best few are refined, and the best of those wins. Weights are all equal.

    Parameters
    ----------
    points : (n, 3) ndarray
        Centred and scaled to about 1.
    known_radius : RadiusPrior, optional
        In the same scale.

    Raises
    ------
    FitFailed
        If none of the starts leads to a cylinder.
    """
    few = points[np.linspace(0, len(points) - 1, min(len(points), MAX_POINTS)).astype(int)]
    directions = half_sphere(DIRECTIONS)
    centres, radii, costs = projected_circles(few, directions)
    best: Cylinder | None = None
    lowest = np.inf
    for place in _best_distinct_directions(directions, costs):
        start = Cylinder(centres[place], directions[place], radii[place])
        try:
            refined, cost = _refine(few, start, known_radius)
        except FitFailed:
            continue
        if cost < lowest:
            best, lowest = refined, cost
    if best is None:
        raise FitFailed("no direction gives the points a cylinder: they lie on another surface")
    return best


def half_sphere(count: int) -> FloatArray:
    """(count, 3) unit vectors with z > 0, evenly spread (Fibonacci lattice)."""
    k = np.arange(count) + 0.5
    z = 1 - k / count
    azimuth = np.pi * (1 + np.sqrt(5.0)) * k
    ring = np.sqrt(1 - z * z)
    return np.column_stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z])


def projected_circles(
    points: Points, directions: FloatArray
) -> tuple[Points, FloatArray, FloatArray]:
    """Algebraic circle (Kasa) of the points as seen along each direction.

    Parameters
    ----------
    points : (n, 3) ndarray
        Centred.
    directions : (k, 3) ndarray
        Unit vectors.

    Returns
    -------
    centres : (k, 3) ndarray
    radii, costs : (k,) ndarray
        Cost: mean square of the algebraic residual over the diameter, nearly that of the
        distance.
    """
    frames = np.stack([tangent_frame(u)[:2] for u in directions])
    flat = np.einsum("kij,nj->kni", frames, points)
    square = (flat**2).sum(axis=2)
    design = np.concatenate([flat, np.ones((*square.shape, 1))], axis=2)
    normal = np.einsum("kni,knj->kij", design, design)
    ridge = 1e-12 * np.trace(normal, axis1=1, axis2=2)
    normal += ridge[:, None, None] * np.eye(3)
    solution = np.linalg.solve(normal, np.einsum("kni,kn->ki", design, square)[..., None])[..., 0]
    centre = solution[:, :2] / 2
    radii = np.sqrt(np.maximum(solution[:, 2] + (centre**2).sum(axis=1), 1e-12))
    misfit = square - np.einsum("kni,ki->kn", design, solution)
    costs = (misfit**2).mean(axis=1) / (2 * radii) ** 2
    return np.einsum("kij,ki->kj", frames, centre), radii, costs


def _best_distinct_directions(directions: FloatArray, costs: FloatArray) -> list[int]:
    chosen: list[int] = []
    for place in np.argsort(costs, kind="stable"):
        if all(
            abs(directions[place] @ directions[other]) < DISTINCT_DIRECTION_COSINE
            for other in chosen
        ):
            chosen.append(int(place))
            if len(chosen) == TRIES:
                break
    return chosen


def _refine(
    points: Points, start: Cylinder, known_radius: RadiusPrior | None
) -> tuple[Cylinder, float]:
    frame = tangent_frame(start.direction)
    ones = np.ones(len(points))
    problem = CylinderProblem(points @ frame.T, ones, 0 * ones, known_radius)
    parameters = minimise(problem, parameters_from_cylinder(frame, start))
    residuals, _ = problem.evaluate(parameters)
    return cylinder_from_parameters(frame, parameters), float(residuals @ residuals)
