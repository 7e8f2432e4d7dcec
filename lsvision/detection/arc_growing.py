"""How an arc grows from its seed, on an ellipse that is fitted anew after each step outwards."""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.ellipse.robust_gauss_newton import (
    EllipseResiduals,
    ellipse_residuals,
    gauss_newton_step,
    refine_ellipse,
)
from lsvision.shapes import BoolArray, FloatArray, IntArray
from lsvision.shapes.noisy_points import NoisyPoints
from lsvision.statistics.robust import MAD_TO_STD, upper_median

MAX_FLATTENING = 0.45
"""Of (a - b) / (a + b), a tilt of 68 deg: beyond, an arc winds itself round a corner."""
MIN_NORMAL_Y = -0.5
"""Smallest y of an outward normal that a sensor with a fan of +/- 30 deg can still light."""


@dataclass(frozen=True, kw_only=True, slots=True)
class IdentificationSettings:
    """Rough identification, section 3.2.1.

    Parameters
    ----------
    sensor_error_sigmas : float
        The paper's sensor error, as a multiple of the point's standard deviation along the
        ellipse's normal.
    window_fraction : float
        Share of the arc by which it may grow at each end in one step (the paper's 10 % are of
        the whole profile).
    max_outlier_run : int
        More than so many points in a row beyond the sensor error interrupt an arc.
    max_gap_fraction : float
        An interruption shorter than this share of the arc is bridged where good points follow.
    extrapolation_inflation : float
        Extrapolation counts so many times, as if neighbours said the same.
    max_extrapolation_fraction : float
        What the ellipse does not know further out widens the sensor error by no more than this
        share of the points' own variance.
    join_max_gap_fraction : float
        Across an interruption shorter than this share of the arc, the other part is tried
        together with it.
    join_min_points : int
        So many points beyond an interruption are tried together with the arc.
    join_max_lost_fraction : float
        The arc may lose no larger share of its own points by that.
    max_iterations : int
        Fits and steps at the most.
    min_points : int
        On the ellipse, or the growth breaks down.
    max_size_ratio : float
        Ratio of the ellipse's size to the candidate's, or its inverse, at the most.
    """

    sensor_error_sigmas: float = 4.0
    window_fraction: float = 0.5
    max_outlier_run: int = 3
    max_gap_fraction: float = 0.25
    extrapolation_inflation: float = 4.0
    max_extrapolation_fraction: float = 0.5
    join_max_gap_fraction: float = 0.5
    join_min_points: int = 6
    join_max_lost_fraction: float = 0.1
    max_iterations: int = 20
    min_points: int = 8
    max_size_ratio: float = 3.0


@dataclass(frozen=True, eq=False, slots=True)
class ArcNeighbourhood:
    """Points around an arc, and how much more they may scatter than their covariances say.

    Parameters
    ----------
    points : NoisyPoints
        In order along the line.
    max_noise_factor : float
        See `PreparedProfile`.
    radius : float
        Of the candidate. Units: mm.
    """

    points: NoisyPoints
    max_noise_factor: float
    radius: float

    def span(self, start: int, stop: int) -> "ArcNeighbourhood":
        """The points [start, stop)."""
        return ArcNeighbourhood(self.points[start:stop], self.max_noise_factor, self.radius)

    def expanded_span(self, inside: IntArray, fraction: float) -> tuple[int, int]:
        """The span of the points inside, wider by a share of itself at either end."""
        start, stop = int(inside[0]), int(inside[-1]) + 1
        step = max(4, int(fraction * (stop - start)))
        return max(0, start - step), min(len(self.points), stop + step)

    def distance(self, i: int, j: int) -> float:
        """Between two points. Units: mm."""
        return float(abs(self.points.z[i] - self.points.z[j]))

    def refine(
        self, inside: IntArray, parameters: FloatArray, steps: int
    ) -> tuple[FloatArray, FloatArray]:
        """Ellipse of the points inside, and its covariance: see `refine_ellipse`."""
        return refine_ellipse(self.points[inside], parameters, steps)


def grow_arc(
    around: ArcNeighbourhood,
    inside: IntArray,
    parameters: FloatArray,
    settings: IdentificationSettings,
) -> tuple[IntArray, FloatArray] | None:
    """Walk outwards from a seed until the line leaves the ellipse.

    Parameters
    ----------
    around : ArcNeighbourhood
        The points that may belong to the arc, in order.
    inside : (k,) int ndarray
        Those of the seed.
    parameters : (5,) ndarray
        Of the seed's ellipse; see `lsvision.ellipse.parameters`. Units: mm.
    settings : IdentificationSettings
        Sensor error and steps.

    Returns
    -------
    inside : (m,) int ndarray
        The points on the ellipse.
    parameters : (5,) ndarray
        Of the ellipse. None in place of both where the growth breaks down.
    """
    joined, seen = False, set[tuple[int, int]]()
    parameters, unsure = around.refine(inside, parameters, 2)
    for _ in range(settings.max_iterations):
        if not _is_plausible(parameters, around.radius, settings.max_size_ratio):
            return None
        low, high = around.expanded_span(inside, settings.window_fraction)
        near = around.span(low, high)
        compared = ellipse_residuals(near.points, parameters)
        on_ellipse, possible = _ellipse_inliers(
            compared, unsure, inside - low, near.max_noise_factor, settings
        )
        inside = low + _connected_inliers(on_ellipse, inside - low, settings)
        if len(inside) < settings.min_points:
            return None
        # Settled, or going to and fro between two spans.
        ends = (int(inside[0]), int(inside[-1]))
        if ends not in seen:
            seen.add(ends)
            parameters, unsure = gauss_newton_step(compared[inside - low], parameters)
            continue
        if joined:
            break
        joined = True
        both = _join_across_gap(near, parameters, inside - low, possible, settings)
        if both is None:
            break
        inside = low + both[0]
        parameters, unsure = around.refine(inside, both[1], 1)
    return inside, parameters


def _join_across_gap(
    near: ArcNeighbourhood,
    parameters: FloatArray,
    inside: IntArray,
    possible: BoolArray,
    settings: IdentificationSettings,
) -> tuple[IntArray, FloatArray] | None:
    """What lies beyond an interruption, where one ellipse holds it and the points inside.

    Jumps in a row cut an arc in two, and the ellipse of the one part, tilted by its noise, may
    miss the other: so they are tried together. A few points prove nothing, jumps least of all.
    """
    run = _connected_inliers(possible, inside, settings)
    widest = settings.join_max_gap_fraction * near.distance(inside[0], inside[-1])
    parts = [
        part
        for part, end in (
            (run[run < inside[0]][::-1], inside[0]),
            (run[run > inside[-1]], inside[-1]),
        )
        if len(part) >= settings.join_min_points and near.distance(end, part[0]) <= widest
    ]
    if not parts:
        return None
    together = np.sort(np.concatenate([inside, *parts]))
    parameters, unsure = near.refine(together, parameters, 8)
    if not _is_plausible(parameters, near.radius, settings.max_size_ratio):
        return None
    compared = ellipse_residuals(near.points, parameters)
    on_ellipse, _ = _ellipse_inliers(compared, unsure, together, near.max_noise_factor, settings)
    both = _connected_inliers(on_ellipse, inside, settings)
    lost = len(inside) - np.isin(inside, both).sum()
    if len(both) <= len(inside) or lost > settings.join_max_lost_fraction * len(inside):
        return None
    return both, parameters


def _is_plausible(parameters: FloatArray, radius: float, largest_change: float) -> bool:
    """An ellipse, not quite another size than the circle it began with, and no needle."""
    _, _, size, p, q = parameters.tolist()
    if not radius / largest_change < size < radius * largest_change:
        return False
    return bool(math.hypot(p, q) < MAX_FLATTENING * size)


def _ellipse_inliers(
    compared: EllipseResiduals,
    unsure: FloatArray,
    inside: IntArray,
    largest_misfit: float,
    settings: IdentificationSettings,
) -> tuple[BoolArray, BoolArray]:
    """Within the sensor error, widened by what the ellipse does not know further out.

    The first goes so far out carefully, the second as far as the ellipse is unsure.
    """
    variances, squares = compared.inflated_variances, compared.residuals * compared.residuals
    scatter = MAD_TO_STD * math.sqrt(upper_median((squares / variances)[inside]))
    limit = settings.sensor_error_sigmas * min(max(scatter, 1.0), largest_misfit)
    extrapolated = settings.extrapolation_inflation * compared.prediction_variances(unsure)
    careful = np.minimum(extrapolated, settings.max_extrapolation_fraction * variances)
    lit = compared.normals.imag > MIN_NORMAL_Y
    squares /= limit**2
    return lit & (squares < variances + careful), lit & (squares < variances + extrapolated)


def _connected_inliers(
    good: BoolArray, inside: IntArray, settings: IdentificationSettings
) -> IntArray:
    """The good points around the middle of those inside, over interruptions that some follow."""
    members = good.nonzero()[0]
    if len(members) == 0:
        return members
    middle = (int(inside[0]) + int(inside[-1]) + 1) // 2
    cuts = (members[1:] - members[:-1] > settings.max_outlier_run).nonzero()[0] + 1
    if len(cuts) == 0:
        return members
    bounds = [0, *cuts.tolist(), len(members)]
    firsts = [int(members[i]) for i in bounds[:-1]]
    stops = [int(members[i - 1]) + 1 for i in bounds[1:]]
    away = [max(f - middle, middle + 1 - s, 0) for f, s in zip(firsts, stops, strict=True)]
    first = last = away.index(min(away))
    bridge = settings.max_gap_fraction * (stops[first] - firsts[first])

    def bridged(gap: int, run: int) -> bool:
        return gap <= bridge and stops[run] - firsts[run] > max(gap, 5)

    while first > 0 and bridged(firsts[first] - stops[first - 1], first - 1):
        first -= 1
    while last + 1 < len(firsts) and bridged(firsts[last + 1] - stops[last], last + 1):
        last += 1
    return members[bounds[first] : bounds[last + 1]]
