"""Smoothing (paper section 3.3.1) of the residuals from the screened ellipse along arc length.

The paper smooths y(x) by local quadratics over 30 % of the arc. In so wide a window a quadratic in
x does not fit an ellipse: even the radii of noise-free arcs are 0.4 to 0.8 mm too large. Here the
residuals from the screened ellipse are smoothed; they are nearly zero, so that there is no such
bias. The robust weights (Tukey's bisquare) also detect jumps inside an arc.

Several arcs are smoothed together, as rows of n points; a shorter arc is padded with its last
point, with weight 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from lsvision.ellipse.parameters import parameters_from_ellipse
from lsvision.ellipse.robust_gauss_newton import compute_arc_lengths, ellipse_residuals, row_medians
from lsvision.geometry import BoolArray, Ellipse, FloatArray, IntArray
from lsvision.geometry.arrays import TINY, as_column
from lsvision.geometry.noisy_points import ComplexArray, NoisyPoints
from lsvision.statistics.robust import MAD_TO_STD

WINDOW_FRACTION = 0.3
"""Width of the local regression as a fraction of the arc (paper: 30 % of the points)."""
TUKEY_CONSTANT = 4.685
"""Tukey's constant, for an efficiency of 95 % with normally distributed residuals."""
POSITION_COUNT = 16
"""Number of positions at equal steps of arc length (paper section 3.3.2) at which the local
quadratic is evaluated: five per window of 30 %, since a quadratic has no finer details."""
EVEN_FRACTIONS = np.linspace(0, 1, POSITION_COUNT)
"""Arc lengths of these positions, as fractions of the arc's length."""
RIDGE = 1e-9
"""Ridge of the regression relative to its weights, and smallest step relative to the arc's length,
since several points may have the same foot point. It is larger than rounding errors."""


@dataclass(frozen=True, eq=False, slots=True)
class SmoothedArc:
    """Smoothed residuals of an arc at k equal steps of arc length.

    Parameters
    ----------
    ellipse : Ellipse
        Screened ellipse, from which the residuals are measured. Units: mm, rad.
    directions : (k,) complex ndarray
        Unit vectors w of the points c + E w of the ellipse, see `lsvision.ellipse.parameters`.
    residuals : (k,) ndarray
        Smoothed residuals, positive outside. Units: mm.
    stds : (k,) ndarray
        Standard deviations of the residual of a single point. Units: mm.
    inliers : (n,) bool ndarray
        Mask of the measured points that are not jumps.
    """

    ellipse: Ellipse
    directions: ComplexArray
    residuals: FloatArray
    stds: FloatArray
    inliers: BoolArray


def smooth_arcs(points: Sequence[NoisyPoints], ellipses: Sequence[Ellipse]) -> list[SmoothedArc]:
    """Smooth the residuals of the points of arcs from their screened ellipses, and detect jumps.

    Parameters
    ----------
    points : sequence of NoisyPoints
        Inliers of each arc, at least one, in any order. Units: mm.
    ellipses : sequence of Ellipse
        Screened ellipse of each arc. Units: mm, rad.

    Returns
    -------
    list of SmoothedArc
        One for each arc, with the mask of inliers in the order of its points.
    """
    if not points:
        return []
    sizes = [len(arc_points) for arc_points in points]
    stacked, valid = NoisyPoints.stack(points)
    parameters = np.array([parameters_from_ellipse(ellipse) for ellipse in ellipses])
    evaluated = ellipse_residuals(stacked, parameters)
    # Angles relative to the mean direction of each arc, so that they have no step of 2 pi. Points
    # all around an ellipse may have no mean direction.
    sums = [complex(row[:size].sum()) or 1.0 for row, size in zip(evaluated.w, sizes, strict=True)]
    mean_w = as_column([total / abs(total) for total in sums])
    angles = np.angle(evaluated.w * mean_w.conjugate())
    order = _sort_rows(angles, sizes)
    angles, residuals = angles.take(order), evaluated.residuals.take(order)
    stds = np.sqrt(evaluated.variances.take(order))
    lengths = compute_arc_lengths(stacked.z.take(order), residuals, evaluated.normals.take(order))
    # Strictly ascending up to the last point; padding has the length of that one.
    counts = np.minimum(np.arange(float(lengths.shape[1])), as_column(sizes) - 1)
    lengths += (RIDGE * lengths[:, -1:] + TINY) * counts
    even = EVEN_FRACTIONS * lengths[:, -1:]
    smooth, weights = smooth_residuals(lengths, residuals, stds, even, valid)
    inliers = np.empty(weights.shape, dtype=bool)
    inliers.put(order, weights > 0)
    directions = mean_w * np.exp(1j * _interpolate_rows(even, lengths, angles))
    stds = _interpolate_rows(even, lengths, stds)
    return [
        SmoothedArc(ellipse, directions[i], smooth[i], stds[i], inliers[i, : sizes[i]])
        for i, ellipse in enumerate(ellipses)
    ]


def _sort_rows(angles: FloatArray, sizes: list[int]) -> IntArray:
    """Return indices (k, n) into the flattened angles that sort each row; the last one is repeated.

    `sizes` are the numbers of valid angles in each row.
    """
    order = np.empty(angles.shape, dtype=int)
    for i, (row, size) in enumerate(zip(angles, sizes, strict=True)):
        order[i, :size] = row[:size].argsort(kind="stable")
        order[i, size:] = order[i, size - 1]
        order[i] += i * len(row)
    return order


def _interpolate_rows(x: FloatArray, knots: FloatArray, values: FloatArray) -> FloatArray:
    """Return the values (k, n) at knots (k, n), linearly interpolated at x (k, p)."""
    return np.array([np.interp(*row) for row in zip(x, knots, values, strict=True)])


def smooth_residuals(
    length: FloatArray,
    residuals: FloatArray,
    stds: FloatArray,
    even: FloatArray,
    valid: BoolArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Smooth residuals by one pass of robust local quadratic regression.

    The paper's reference 20 fits local lines in two passes.

    Parameters
    ----------
    length : (k, n) ndarray
        Ascending arc length of the points. Units: mm.
    residuals, stds : (k, n) ndarray
        Residuals and their standard deviations. Units: mm.
    even : (k, p) ndarray
        Arc lengths at which the residuals are smoothed. Units: mm.
    valid : (k, n) bool ndarray, optional
        False for padding. None: all points are valid.

    Returns
    -------
    smooth : (k, p) ndarray
        Smoothed residuals. Units: mm.
    weights : (k, n) ndarray
        Robust weights, from 0 (a jump) to 1.
    """
    first, last = length[:, :1], length[:, -1:]
    half = WINDOW_FRACTION * (last - first) / 2 + TINY
    # At the ends of the arc the window is one-sided, and extended inwards to the same width.
    widths = np.maximum(half, np.maximum(first - even, even - last) + 2 * half)
    u = length[:, None] - even[..., None]
    u /= widths[..., None]
    cube = np.abs(u)
    cube *= u * u
    tricube = np.maximum(1 - cube, 0.0)
    # The first weights come from the residuals from the screened ellipse, which do not depend on
    # jumps. An unweighted regression would follow the jumps, and reject their valid neighbours.
    weights = _compute_bisquare_weights(residuals / stds, valid) / (stds * stds)
    if valid is not None:
        weights *= valid
    smooth = _fit_local_quadratics(u, tricube * tricube * tricube * weights[:, None], residuals)
    smoothed = _interpolate_rows(length, even, smooth)
    return smooth, _compute_bisquare_weights((residuals - smoothed) / stds, valid)


def _compute_bisquare_weights(normalised: FloatArray, valid: BoolArray | None) -> FloatArray:
    """Return Tukey's weights (k, n) of residuals divided by their standard deviations."""
    medians = row_medians(np.abs(normalised), valid)
    # The scale is at least that of the noise model, so that points within the noise are inliers.
    limits = [TUKEY_CONSTANT * max(MAD_TO_STD * median, 1.0) for median in medians]
    z = normalised / as_column(limits)
    weights: FloatArray = np.maximum(1 - z * z, 0.0) ** 2
    return weights


def _fit_local_quadratics(u: FloatArray, weights: FloatArray, residuals: FloatArray) -> FloatArray:
    """Return the values (k, p) at u = 0 of the weighted quadratics of p windows of k arcs.

    `u` and `weights` are (k, p, n), `residuals` (k, n).
    """
    powers = np.empty((5, *u.shape))
    powers[0] = weights
    for lower, higher in pairwise(powers):
        np.multiply(lower, u, out=higher)
    # Products with ones are faster than sums.
    m0, m1, m2, m3, m4 = powers @ np.ones(u.shape[-1])
    r0, r1, r2 = (powers[:3] @ residuals[..., None])[..., 0]
    # Because of the ridge, a window with two points has a line, and an empty one the value 0.
    ridge = RIDGE * (m0 + RIDGE * m0.max(axis=1, keepdims=True)) + TINY
    d0, d2, d4 = m0 + ridge, m2 + ridge, m4 + ridge
    # First row of the normal equations' inverse, by Cramer's rule.
    c0, c1, c2 = d2 * d4 - m3 * m3, m2 * m3 - m1 * d4, m1 * m3 - m2 * d2
    value: FloatArray = (c0 * r0 + c1 * r1 + c2 * r2) / (c0 * d0 + c1 * m1 + c2 * m2)
    return value
