"""Smoothing (paper section 3.3.1), along arc length and on the residual to the ellipse.

The paper smooths y(x) by local quadratics over 30 % of the arc; over so wide a window a
quadratic in x is no ellipse, and even noise-free arcs come out 0.4 to 0.8 mm too large. The
residual to the screened ellipse is flat, so there the same step is without bias. Its robust
weights (Tukey's bisquare) are the one test for jumps inside an arc.
"""

import cmath
from dataclasses import dataclass

import numpy as np

from lsvision.ellipse.parameters import parameters_from_ellipse
from lsvision.ellipse.robust_gauss_newton import ellipse_residuals
from lsvision.geometry import BoolArray, Ellipse, FloatArray
from lsvision.geometry.noisy_points import ComplexArray, NoisyPoints
from lsvision.statistics.robust import mad_std

WINDOW_FRACTION = 0.3
"""Width of the local regression as a share of the arc (paper: 30 % of the points)."""
TUKEY_CONSTANT = 4.685
"""Tukey's constant: 95 % efficiency at the normal distribution."""
POSITIONS = 16
"""Positions at equal steps of arc length (paper section 3.3.2) at which the local quadratic is
evaluated: five in a window of 30 %, which has no detail that more would show."""
TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True, eq=False, slots=True)
class SmoothedArc:
    """An arc with its residual smoothed at equal steps of arc length.

    Parameters
    ----------
    ellipse : Ellipse
        The screened ellipse, to which the residual refers. Units: mm, rad.
    directions : (k,) complex ndarray
        Unit vectors w of the points c + E w of the ellipse, at equal steps.
    residuals : (k,) ndarray
        Smoothed residual there, positive outside. Units: mm.
    stds : (k,) ndarray
        Standard deviation of a single point there. Units: mm.
    inliers : (n,) bool ndarray
        The measured points that are no jumps.
    """

    ellipse: Ellipse
    directions: ComplexArray
    residuals: FloatArray
    stds: FloatArray
    inliers: BoolArray


def smooth_arc(points: NoisyPoints, ellipse: Ellipse) -> SmoothedArc:
    """Smooth the residual of a screened arc, and find the jumps inside it.

    Parameters
    ----------
    points : NoisyPoints
        Of the arc, n of them.
    ellipse : Ellipse
        The screened ellipse. Units: mm, rad.

    Returns
    -------
    SmoothedArc
    """
    compared = ellipse_residuals(points, parameters_from_ellipse(ellipse))
    # Angles from the middle of the arc, so that none jumps by 2 pi.
    middle = cmath.rect(1.0, cmath.phase(compared.w.sum()))
    angles = np.angle(compared.w * middle.conjugate())
    order = angles.argsort(kind="stable")
    angles, residuals = angles[order], compared.residuals[order]
    stds = np.sqrt(compared.variances[order])
    feet = points.z[order] - residuals * compared.normals[order]
    length = np.zeros(len(points))
    np.abs(feet[1:] - feet[:-1]).cumsum(out=length[1:])
    # Points may share a foot; arc length must rise all the same.
    length += (1e-9 * length[-1] + 1e-12) * np.arange(len(points))
    even = np.linspace(0.0, length[-1], POSITIONS)
    smooth, weights = smooth_residual(length, residuals, stds, even)
    inliers = np.empty(len(points), dtype=bool)
    inliers[order] = weights > 0
    directions = middle * np.exp(1j * np.interp(even, length, angles))
    return SmoothedArc(ellipse, directions, smooth, np.interp(even, length, stds), inliers)


def smooth_residual(
    length: FloatArray, residuals: FloatArray, stds: FloatArray, even: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Robust local quadratic regression of a residual over arc length.

    Parameters
    ----------
    length, residuals, stds : (n,) ndarray
        Arc length of each point, rising; orthogonal residual to the screened ellipse; its
        standard deviation. Units: mm.
    even : (k,) ndarray
        Arc lengths at which the regression is evaluated, from the first to the last. Units: mm.

    Returns
    -------
    smooth : (k,) ndarray
        Units: mm.
    weights : (n,) ndarray
        Robust weight of each point in [0, 1]; 0 is a jump.

    Notes
    -----
    Double-smoothing local regression (the paper's reference 20) fits lines twice; its second
    round is replaced by quadratics, as the paper's own text has them.
    """
    half = max(WINDOW_FRACTION * float(length[-1] - length[0]) / 2, 1e-12)
    # At the ends the window is one-sided; it keeps its width by reaching further in.
    missing = np.maximum(length[0] + half - even, even + half - length[-1])
    u = (length - even[:, None]) / (half + np.maximum(missing, 0.0))[:, None]
    tricube = np.maximum(1 - np.abs(u * u * u), 0.0)
    # The screened ellipse is near, and no jump has moved it: a regression whose first weights do
    # not come from the residual itself follows jumps, and takes clean neighbours for jumps.
    weights = _bisquare_weights(residuals / stds) / (stds * stds)
    smooth = _local_quadratics(u, tricube * tricube * tricube * weights, residuals)
    return smooth, _bisquare_weights((residuals - np.interp(length, even, smooth)) / stds)


def _bisquare_weights(normalised: FloatArray) -> FloatArray:
    """Tukey's weights of residuals over their standard deviations, (n,)."""
    # Never tighter than the noise model: clean points are no jumps.
    z = normalised * (1 / (TUKEY_CONSTANT * max(mad_std(normalised), 1.0)))
    weights: FloatArray = np.maximum(1 - z * z, 0.0) ** 2
    return weights


def _local_quadratics(u: FloatArray, weights: FloatArray, residuals: FloatArray) -> FloatArray:
    """Value at u = 0 of the weighted quadratic of each of k windows; u and weights (k, n)."""
    first = weights * u
    second = first * u
    third = second * u
    m0, m1, m2, m3 = (moment.sum(axis=1) for moment in (weights, first, second, third))
    r0, r1, r2 = weights @ residuals, first @ residuals, second @ residuals
    # A little ridge: a window with two points has a line, one without any the ellipse itself.
    ridge = 1e-9 * m0 + 1e-12 * m0.max() + TINY
    d0, d2, d4 = m0 + ridge, m2 + ridge, (third * u).sum(axis=1) + ridge
    # First row of the normal equations' inverse, by Cramer's rule.
    c0, c1, c2 = d2 * d4 - m3 * m3, m2 * m3 - m1 * d4, m1 * m3 - m2 * d2
    value: FloatArray = (c0 * r0 + c1 * r1 + c2 * r2) / (c0 * d0 + c1 * m1 + c2 * m2)
    return value
