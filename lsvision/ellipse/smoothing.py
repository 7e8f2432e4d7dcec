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
from lsvision.errors import FitFailed
from lsvision.geometry import BoolArray, Ellipse, FloatArray, Points
from lsvision.geometry.noisy_points import ComplexArray, NoisyPoints
from lsvision.statistics.robust import mad_std

WINDOW_FRACTION = 0.3
"""Width of the local regression as a share of the arc (paper: 30 % of the points)."""
ROBUST_ITERATIONS = 2
"""Local regressions, each with the robust weights of the one before, and the first with those of
the residual itself: the screened ellipse is near, and no jump has moved it. A first regression
without weights follows jumps: it misses one in twelve, and takes clean neighbours for jumps."""
TUKEY_CONSTANT = 4.685
"""Tukey's constant: 95 % efficiency at the normal distribution."""
STEP_MM = 0.5
"""Spacing of the positions at which the local quadratic is evaluated (paper section 3.3.2)."""
MIN_POSITIONS, MAX_POSITIONS = 8, 32
"""A window of 30 % has no detail that more positions would show."""
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
    count = min(max(round(length[-1] / STEP_MM) + 1, MIN_POSITIONS), MAX_POSITIONS)
    even = np.linspace(0.0, length[-1], count)
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
    windows = _kernel_powers(u, tricube * tricube * tricube / (stds * stds))
    weights = _bisquare_weights(residuals / stds)
    for _ in range(ROBUST_ITERATIONS):
        smooth = _local_quadratic(windows, weights, residuals)
        weights = _bisquare_weights((residuals - np.interp(length, even, smooth)) / stds)
    return smooth, weights


def _bisquare_weights(normalised: FloatArray) -> FloatArray:
    """Tukey's weights of residuals over their standard deviations, (n,)."""
    # Never tighter than the noise model: clean points are no jumps.
    z = normalised * (1 / (TUKEY_CONSTANT * max(mad_std(normalised), 1.0)))
    weights: FloatArray = np.maximum(1 - z * z, 0.0) ** 2
    return weights


def _kernel_powers(u: FloatArray, kernel: FloatArray) -> FloatArray:
    """Kernel times u^0 to u^4: (5 k, n)."""
    powers = np.empty((5, *u.shape))
    powers[0] = kernel
    for i in range(1, 5):
        np.multiply(powers[i - 1], u, out=powers[i])
    return powers.reshape(-1, u.shape[1])


def _local_quadratic(windows: FloatArray, weights: FloatArray, residuals: FloatArray) -> FloatArray:
    """Value at u = 0 of the weighted quadratic of each window."""
    count = len(windows) // 5
    m0, m1, m2, m3, m4 = (windows @ weights).reshape(5, count)
    r0, r1, r2 = (windows[: 3 * count] @ (weights * residuals)).reshape(3, count)
    # A little ridge: a window with two points has a line, one without any the ellipse itself.
    ridge = 1e-9 * m0 + 1e-12 * m0.max() + TINY
    d0, d2, d4 = m0 + ridge, m2 + ridge, m4 + ridge
    # First row of the normal equations' inverse, by Cramer's rule.
    c0, c1, c2 = d2 * d4 - m3 * m3, m2 * m3 - m1 * d4, m1 * m3 - m2 * d2
    value: FloatArray = (c0 * r0 + c1 * r1 + c2 * r2) / (c0 * d0 + c1 * m1 + c2 * m2)
    return value


def smooth_profile_paper(points: Points, window_fraction: float = 0.3) -> Points:
    """Smooth y(x) by local quadratics, as the paper's section 3.3.1 says; for comparison only.

    Parameters
    ----------
    points : (n, 2) ndarray
        An arc, ordered by x. Units: mm.
    window_fraction : float
        Share of the points in each window.

    Returns
    -------
    (n, 2) ndarray
        Same x, smoothed y. Units: mm. Biased: radius 0.4 to 0.8 mm too large on clean arcs.
    """
    if not np.ptp(points[:, 0]) > 0:
        raise FitFailed("the arc has no width in x: y(x) cannot be smoothed; leave it out")
    count = len(points)
    window = min(count, max(3, round(window_fraction * count)))
    smooth = points.copy()
    for i in range(count):
        first = min(max(0, i - window // 2), count - window)
        x, y = points[first : first + window].T
        smooth[i, 1] = np.polynomial.Polynomial.fit(x, y, 2)(points[i, 0])
    return smooth
