"""Smoothing (paper section 3.3.1) of the residuals from the ellipse along arc length.

The paper smooths y(x) by local quadratics over 30 % of the arc. Over so wide a window a
quadratic in x does not fit an ellipse: even radii of noise-free arcs are 0.4 to 0.8 mm too large.
The residual from the screened ellipse is nearly zero, so that smoothing it has no such bias. The
robust weights (Tukey's bisquare) also detect jumps inside an arc.
"""

import cmath
from dataclasses import dataclass

import numpy as np

from lsvision.ellipse.parameters import parameters_from_ellipse
from lsvision.ellipse.robust_gauss_newton import ellipse_residuals
from lsvision.geometry import BoolArray, Ellipse, FloatArray
from lsvision.geometry.arrays import TINY
from lsvision.geometry.noisy_points import ComplexArray, NoisyPoints
from lsvision.statistics.robust import upper_mad_std

WINDOW_FRACTION = 0.3
"""Width of the local regression as a fraction of the arc (paper: 30 % of the points)."""
TUKEY_CONSTANT = 4.685
"""Tukey's constant: 95 % efficiency at the normal distribution."""
POSITIONS = 16
"""Number of positions at equal steps of arc length (paper section 3.3.2) at which the local
quadratic is evaluated: five per window of 30 %, since a quadratic has no finer detail."""
RIDGE = 1e-9
"""Ridge of the regression relative to its weights, and smallest step relative to the arc's length,
since points may share a foot point. Larger than rounding errors."""


@dataclass(frozen=True, eq=False, slots=True)
class SmoothedArc:
    """Residuals at k equal steps of arc length, from the screened `ellipse` (mm, rad).

    Parameters
    ----------
    directions : (k,) complex ndarray
        Unit vectors w of the points c + E w of the ellipse.
    residuals, stds : (k,) ndarray
        Smoothed residuals, positive outside; standard deviation of a single point. Units: mm.
    inliers : (n,) bool ndarray
        Mask of the measured points that are not jumps.
    """

    ellipse: Ellipse
    directions: ComplexArray
    residuals: FloatArray
    stds: FloatArray
    inliers: BoolArray


def smooth_arc(points: NoisyPoints, ellipse: Ellipse) -> SmoothedArc:
    """Smooth the residuals of n points from their screened ellipse, and find jumps."""
    evaluated = ellipse_residuals(points, parameters_from_ellipse(ellipse))
    # Angles relative to the middle of the arc, so that they have no jump of 2 pi.
    middle = cmath.rect(1.0, cmath.phase(evaluated.w.sum()))
    rotated = evaluated.w * middle.conjugate()
    angles = np.arctan2(rotated.imag, rotated.real)
    order = angles.argsort(kind="stable")
    angles, residuals = angles[order], evaluated.residuals[order]
    stds = np.sqrt(evaluated.variances[order])
    feet = points.z[order] - residuals * evaluated.normals[order]
    length = np.zeros(len(points))
    np.abs(feet[1:] - feet[:-1]).cumsum(out=length[1:])
    length += (RIDGE * length[-1] + TINY) * np.arange(len(points))
    even = np.arange(POSITIONS) * (length[-1] / (POSITIONS - 1))
    smooth, weights = smooth_residual(length, residuals, stds, even)
    inliers = np.empty(len(points), dtype=bool)
    inliers[order] = weights > 0
    directions = middle * np.exp(1j * np.interp(even, length, angles))
    return SmoothedArc(ellipse, directions, smooth, np.interp(even, length, stds), inliers)


def smooth_residual(
    length: FloatArray, residuals: FloatArray, stds: FloatArray, even: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return residuals smoothed at k arc lengths `even`, and robust weights (n,); 0 is a jump.

    One pass of robust local quadratic regression; the paper's reference 20 fits local lines in two
    passes.
    `length` is the ascending arc length of the n points. Units: mm.
    """
    half = WINDOW_FRACTION * float(length[-1] - length[0]) / 2 + TINY
    # At the ends the window is one-sided; it is extended inwards to keep its width.
    missing = np.maximum(length[0] + half - even, even + half - length[-1])
    u = (length - even[:, None]) / (half + np.maximum(missing, 0.0))[:, None]
    tricube = np.maximum(1 - np.abs(u * u * u), 0.0)
    # The first weights come from the residuals from the screened ellipse, which no jump has
    # shifted: an unweighted regression would follow jumps and reject their valid neighbours.
    weights = _bisquare_weights(residuals / stds) / (stds * stds)
    smooth = _local_quadratics(u, tricube * tricube * tricube * weights, residuals)
    return smooth, _bisquare_weights((residuals - np.interp(length, even, smooth)) / stds)


def _bisquare_weights(normalised: FloatArray) -> FloatArray:
    """Return Tukey's weights of residuals over their standard deviations, (n,)."""
    # The scale is at least that of the noise model, so that points within the noise are kept.
    z = normalised * (1 / (TUKEY_CONSTANT * max(upper_mad_std(normalised), 1.0)))
    weights: FloatArray = np.maximum(1 - z * z, 0.0) ** 2
    return weights


def _local_quadratics(u: FloatArray, weights: FloatArray, residuals: FloatArray) -> FloatArray:
    """Return the value at u = 0 of the weighted quadratic of k windows; u and weights (k, n)."""
    first = weights * u
    second = first * u
    third = second * u
    m0, m1, m2, m3 = (moment.sum(axis=1) for moment in (weights, first, second, third))
    r0, r1, r2 = weights @ residuals, first @ residuals, second @ residuals
    # Ridge regression: a window with two points gets a line, an empty one the ellipse itself.
    ridge = RIDGE * (m0 + RIDGE * m0.max()) + TINY
    d0, d2, d4 = m0 + ridge, m2 + ridge, (third * u).sum(axis=1) + ridge
    # First row of the normal equations' inverse, by Cramer's rule.
    c0, c1, c2 = d2 * d4 - m3 * m3, m2 * m3 - m1 * d4, m1 * m3 - m2 * d2
    value: FloatArray = (c0 * r0 + c1 * r1 + c2 * r2) / (c0 * d0 + c1 * m1 + c2 * m2)
    return value
