"""Smoothing (paper section 3.3.1), along arc length and on the residual to the ellipse.

The paper smooths y(x) by local quadratics over 30 % of the arc; over so wide a window a
quadratic in x is no ellipse, and even noise-free arcs come out 0.4 to 0.8 mm too large. The
residual to the screened ellipse is flat, so there the same step is without bias. Robust weights
(bisquare) let single jumps and lost lines fall out, which is what the paper wants
of it.
"""

from dataclasses import dataclass

import numpy as np

from lsvision.errors import FitFailed
from lsvision.shapes import FloatArray, Points
from lsvision.statistics.robust import mad_std

NODES = 32
"""Places where the local quadratic is evaluated: a window of 30 % has no finer detail."""
NODE_POSITIONS = np.linspace(0, 1, NODES)
TINY = float(np.finfo(float).tiny)
TUKEY_CONSTANT = 4.685
"""Tukey's constant: 95 % efficiency at the normal distribution."""


@dataclass(frozen=True, kw_only=True, slots=True)
class SmoothingSettings:
    """Smoothing, section 3.3.1.

    Parameters
    ----------
    window_fraction : float
        Width of the local regression as a share of the arc.
    robust_iterations : int
        Robust reweightings.
    """

    window_fraction: float = 0.3
    robust_iterations: int = 1


@dataclass(frozen=True, eq=False, slots=True)
class SmoothedArc:
    """A smoothed residual and how much each point had to say in it.

    Parameters
    ----------
    length : (k,) ndarray
        Arc length of the nodes. Units: mm.
    residual : (k,) ndarray
        Smoothed residual to the screened ellipse at the nodes. Units: mm.
    weights : (n,) ndarray
        Robust weight of each point in [0, 1]; 0 is a jump.
    """

    length: FloatArray
    residual: FloatArray
    weights: FloatArray


def smooth_residual(
    length: FloatArray,
    residual: FloatArray,
    stds: FloatArray,
    settings: SmoothingSettings = SmoothingSettings(),
) -> SmoothedArc:
    """Local quadratic regression of a residual over arc length.

    Parameters
    ----------
    length : (n,) ndarray
        Arc length of each point, rising. Units: mm.
    residual : (n,) ndarray
        Orthogonal residual to the screened ellipse. Units: mm.
    stds : (n,) ndarray
        Standard deviation of each residual. Units: mm.
    settings : SmoothingSettings
        Window and rounds.

    Returns
    -------
    SmoothedArc

    Notes
    -----
    Double-smoothing local regression (the paper's reference 20) fits lines twice; its second
    round is replaced by quadratics, as the paper's own text has them.
    """
    span = float(length[-1] - length[0])
    nodes = length[0] + span * NODE_POSITIONS
    half = max(settings.window_fraction * span / 2, 1e-12)
    # At the ends the window is one-sided; it keeps its width by reaching further in.
    reach = np.maximum(half, half + np.maximum(length[0] + half - nodes, nodes + half - length[-1]))
    u = length - nodes[:, None]
    u /= reach[:, None]
    tricube = np.abs(u * u * u)
    np.maximum(np.subtract(1, tricube, out=tricube), 0.0, out=tricube)
    windows = _powers(u, tricube * tricube * tricube / (stds * stds))
    weights = np.ones(len(length))
    smooth = np.zeros(NODES)
    for _ in range(1 + settings.robust_iterations):
        smooth = _local_quadratic(windows, weights, residual)
        z = (residual - np.interp(length, nodes, smooth)) / stds
        # Never tighter than the noise model: clean points are no jumps.
        scale = max(mad_std(z), 1.0)
        z *= 1 / (TUKEY_CONSTANT * scale)
        weights = np.maximum(1 - z * z, 0.0) ** 2
    return SmoothedArc(nodes, smooth, weights)


def _powers(u: FloatArray, kernel: FloatArray) -> FloatArray:
    """Kernel times u^0 to u^4: (5 nodes, points)."""
    powers = np.empty((5, *u.shape))
    powers[0] = kernel
    for i in range(1, 5):
        np.multiply(powers[i - 1], u, out=powers[i])
    return powers.reshape(-1, u.shape[1])


def _local_quadratic(windows: FloatArray, weights: FloatArray, residual: FloatArray) -> FloatArray:
    """Value at u = 0 of the weighted quadratic of each window."""
    m0, m1, m2, m3, m4 = (windows @ weights).reshape(5, NODES)
    r0, r1, r2 = (windows[: 3 * NODES] @ (weights * residual)).reshape(3, NODES)
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
