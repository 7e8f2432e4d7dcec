"""Other least-squares cylinders of the same points, found by tilting one that fits them.

The fits from all tilted initial guesses advance together, one step of the Levenberg-Marquardt
method at a time: one fit after the other takes five times as long.
"""

import math

import numpy as np

from lsvision.cylinder.alternatives import select_distinct_cylinders, select_distinct_directions
from lsvision.cylinder.problem import (
    MAX_RADIUS_EXTENTS,
    PARAMETERS,
    build_weighted_problem,
    cylinder_from_parameters,
    parameters_from_cylinder,
)
from lsvision.ellipse.problem import RadiusPrior
from lsvision.geometry import BoolArray, Cylinder, FloatArray, IntArray, Points, build_tangent_frame
from lsvision.geometry.arrays import TINY, measure_extent

TILTS_DEG = (1.5, 3.0, 6.0, 12.0, 24.0, 48.0)
"""Tilts of the initial guesses for another minimum, to four sides. Half way between two minima the
fit is worst, so that one guess within a factor of 1.4 of the other minimum suffices."""
MAX_STEPS = 100
"""Largest number of steps of a fit; usually six are needed."""
FIRST_DAMPING, DAMPING_FACTOR = 1e-3, 10.0
"""Damping after a step that has failed, and the factor by which it changes in the next ones. The
diagonal of the information is scaled to 1."""
MIN_DAMPING = 1e-7
"""Damping below which there is none. A larger one ends in long flat valleys before the minimum."""
MAX_DAMPING = 1e9
"""Damping above which a fit ends: its steps are too small to change the parameters."""
MIN_DECREASE = 1e-9
"""Decrease of the sum of squares by the next step, over the sum, below which a fit has converged:
one of 0.0003 standard deviations for 100 points."""
MAX_ROUNDING_EXTENTS = 1e-13
"""Root mean square residual that is rounding. Unit: extent of the points."""
MAX_GROUP_POINTS = 2500
"""Number of points that are evaluated together, of several fits: more do not fit into the cache."""
RIDGE = 1e-13
"""Addition to the information that keeps it invertible, relative to its diagonal."""


def find_other_minima(
    points: Points, cylinder: Cylinder, known_radius: RadiusPrior | None
) -> list[Cylinder]:
    """Return the least-squares cylinders near a tilted one that are not parallel to it.

    The points (n, 3) have equal weights.
    """
    return select_distinct_cylinders(
        [cylinder, *find_tilted_minima(points, cylinder, known_radius)]
    )[1:]


def find_tilted_minima(
    points: Points, cylinder: Cylinder, known_radius: RadiusPrior | None
) -> list[Cylinder]:
    """Return the least-squares cylinders near tilted ones, of parallel ones the first.

    The points (n, 3) have equal weights. The tilts are `TILTS_DEG`, about the axis point nearest to
    the centroid, to both sides along both principal axes of the error of the direction: the points
    determine it best along one and least along the other. Another minimum is along the second
    one from one cylinder, but not always from the other.
    """
    origin = points.mean(axis=0)
    centred = points - origin
    centred_cylinder = Cylinder(cylinder.point - origin, cylinder.direction, cylinder.radius)
    frames = _tilt_frames(_compute_principal_frame(centred, centred_cylinder))
    # The pivot is the axis point nearest to the origin.
    along = centred_cylinder.point @ cylinder.direction
    guesses = np.zeros((len(frames), PARAMETERS))
    guesses[:, :2] = (frames @ (centred_cylinder.point - along * cylinder.direction))[:, :2]
    guesses[:, 4] = cylinder.radius
    solutions = _minimise_all(frames @ centred.T, guesses, known_radius)
    max_radius = MAX_RADIUS_EXTENTS * measure_extent(centred)
    valid = np.isfinite(solutions).all(axis=1)
    valid &= (solutions[:, 4] > 0) & (solutions[:, 4] < max_radius)
    frames, solutions = frames[valid], solutions[valid]
    tilts = np.column_stack([solutions[:, 2:4], np.ones(len(solutions))])
    directions = np.einsum("ki,kij->kj", tilts, frames)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return [
        _translate(cylinder_from_parameters(frames[k], solutions[k]), origin)
        for k in select_distinct_directions(directions)
    ]


def _translate(cylinder: Cylinder, displacement: FloatArray) -> Cylinder:
    """Return a cylinder moved by a displacement (3,)."""
    return Cylinder(cylinder.point + displacement, cylinder.direction, cylinder.radius)


def _compute_principal_frame(points: Points, cylinder: Cylinder) -> FloatArray:
    """Return the principal axes of the error of the direction, and the direction, in rows."""
    frame = build_tangent_frame(cylinder.direction)
    parameters = parameters_from_cylinder(frame, cylinder)
    _, jacobian = build_weighted_problem(points @ frame.T, None, parameters, None).evaluate(
        parameters
    )
    covariance = np.linalg.pinv(jacobian.T @ jacobian, hermitian=True)[2:4, 2:4]
    return np.vstack([np.linalg.eigh(covariance)[1].T @ frame[:2], cylinder.direction])


def _tilt_frames(principal_frame: FloatArray) -> FloatArray:
    """Return frames (k, 3, 3) of which the third rows are the tilted directions."""
    first, second, direction = principal_frame
    sides = np.array([first, second, -first, -second])
    tilts = np.radians(TILTS_DEG)[:, None, None]
    tilted = np.cos(tilts) * direction + np.sin(tilts) * sides
    towards = np.cos(tilts) * sides - np.sin(tilts) * direction
    across = np.broadcast_to(np.cross(direction, sides), tilted.shape)
    return np.stack([towards, across, tilted], axis=2).reshape(-1, 3, 3)


def _minimise_all(
    points: FloatArray, parameters: FloatArray, known_radius: RadiusPrior | None
) -> FloatArray:
    """Return the least-squares parameters (k, 5) near some, (k, 5), NaN where there are none.

    The points (k, 3, n) are in the frames of the parameters ``(x, y, a, b, r)``.
    """
    min_cost = points.shape[2] * (MAX_ROUNDING_EXTENTS * float(np.ptp(points[0]))) ** 2
    parameters, damping = parameters.copy(), np.zeros(len(parameters))
    with np.errstate(all="ignore"):
        active = np.arange(len(parameters))
        equations = _build_normal_equations(points, active, parameters, known_radius)
        for _ in range(MAX_STEPS):
            steps, decreases = _solve_damped_steps(equations[active], damping[active])
            trials = parameters[active] + steps
            trial_equations = _build_normal_equations(points, active, trials, known_radius)
            costs = equations[active, -1, -1]
            converged = (decreases <= MIN_DECREASE * costs + min_cost) & (damping[active] == 0)
            better = trial_equations[:, -1, -1] < costs
            rows = active[better]
            parameters[rows], equations[rows] = trials[better], trial_equations[better]
            damping[active] = _update_damping(damping[active], better)
            active = active[~converged & (damping[active] < MAX_DAMPING)]
            if len(active) == 0:
                break
    parameters[~np.isfinite(equations[:, -1, -1])] = math.nan
    return parameters


def _update_damping(damping: FloatArray, better: BoolArray) -> FloatArray:
    """Return the damping (k,) of the next steps."""
    increased = np.maximum(DAMPING_FACTOR * damping, FIRST_DAMPING)
    decreased = damping / DAMPING_FACTOR
    return np.where(better, np.where(decreased < MIN_DAMPING, 0.0, decreased), increased)


def _solve_damped_steps(
    equations: FloatArray, damping: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the steps (k, 5), and by how much they decrease the sums of squares (k,).

    NaN where the equations (k, 6, 6) are not finite.
    """
    information, gradient = equations[:, :-1, :-1], equations[:, :-1, -1]
    scales = np.sqrt(np.maximum(np.einsum("kii->ki", information), TINY))
    scaled = information / (scales[:, :, None] * scales[:, None, :])
    scaled += (damping + RIDGE)[:, None, None] * np.eye(PARAMETERS)
    finite = np.isfinite(equations).all(axis=(1, 2))
    scaled[~finite] = np.eye(PARAMETERS)
    steps = -np.linalg.solve(scaled, (gradient / scales)[..., None])[..., 0] / scales
    steps[~finite] = math.nan
    return steps, -(gradient * steps).sum(axis=1)


def _build_normal_equations(
    points: FloatArray,
    rows: IntArray,
    parameters: FloatArray,
    known_radius: RadiusPrior | None,
) -> FloatArray:
    """Return [J r]'[J r] (k, 6, 6) of each cylinder, with the Jacobian J and the residuals r.

    `rows` (k,) are those of the points (m, 3, n) in the frames of the parameters (k, 5).
    """
    size = max(1, MAX_GROUP_POINTS // points.shape[2])
    groups = [slice(start, start + size) for start in range(0, len(rows), size)]
    equations = np.concatenate(
        [
            _build_normal_equations_of_points(points[rows[group]], parameters[group])
            for group in groups
        ]
    )
    if known_radius is not None:
        radius, std = known_radius.radius, known_radius.effective_std
        row = np.zeros((len(parameters), PARAMETERS + 1))
        row[:, 4], row[:, 5] = 1 / std, (parameters[:, 4] - radius) / std
        equations += row[:, :, None] * row[:, None, :]
    return equations


def _build_normal_equations_of_points(points: FloatArray, parameters: FloatArray) -> FloatArray:
    """Return [J r]'[J r] (k, 6, 6) of the points (k, 3, n) in the frames of the parameters."""
    x, y, a, b, radius = parameters.T[:, :, None]
    length = np.sqrt(a * a + b * b + 1.0)
    from_axis_x, from_axis_y = points[:, 0] - x, points[:, 1] - y
    height = (a * from_axis_x + b * from_axis_y + points[:, 2]) / length**2
    from_axis_x -= a * height
    from_axis_y -= b * height
    distances = np.sqrt(from_axis_x**2 + from_axis_y**2 + (points[:, 2] - height) ** 2)
    columns = np.empty((len(parameters), PARAMETERS + 1, points.shape[2]))
    inverse = -1 / np.maximum(distances, TINY)
    np.multiply(from_axis_x, inverse, out=columns[:, 0])
    np.multiply(from_axis_y, inverse, out=columns[:, 1])
    np.multiply(columns[:, :2], height[:, None], out=columns[:, 2:4])
    columns[:, 4] = -1.0
    np.subtract(distances, radius, out=columns[:, 5])
    equations: FloatArray = columns @ columns.transpose(0, 2, 1)
    return equations
