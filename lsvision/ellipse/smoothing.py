"""Smoothing (paper section 3.3.1) of the residuals from the ellipse along arc length.

The paper smooths y(x) by local quadratics over 30 % of the arc. Over so wide a window a
quadratic in x does not fit an ellipse: even radii of noise-free arcs are 0.4 to 0.8 mm too large.
The residual from the screened ellipse is nearly zero, so that smoothing it has no such bias. The
robust weights (Tukey's bisquare) also detect jumps inside an arc.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import comb
from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from lsvision.ellipse.parameters import parameters_from_ellipse
from lsvision.ellipse.robust_gauss_newton import ellipse_residuals
from lsvision.geometry import BoolArray, Ellipse, FloatArray, IntArray
from lsvision.geometry.arrays import TINY, as_column
from lsvision.geometry.noisy_points import ComplexArray, NoisyPoints
from lsvision.statistics.robust import upper_mad_std

Number = TypeVar("Number", np.float64, np.complex128)
WINDOW_FRACTION = 0.3
"""Width of the local regression as a fraction of the arc (paper: 30 % of the points)."""
TUKEY_CONSTANT = 4.685
"""Tukey's constant: 95 % efficiency at the normal distribution."""
POSITIONS = 16
"""Number of positions at equal steps of arc length (paper section 3.3.2) at which the local
quadratic is evaluated: five per window of 30 %, since a quadratic has no finer detail."""
RIDGE = 1e-9
"""Ridge of the regression relative to its weights, larger than rounding errors: a window with two
points has no quadratic."""


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


def smooth_arcs(points: Sequence[NoisyPoints], ellipses: Sequence[Ellipse]) -> list[SmoothedArc]:
    """Smooth the residuals of the points of k arcs from their screened ellipses, and find jumps."""
    if not points:
        return []
    sizes = [len(each) for each in points]
    stacked, _ = NoisyPoints.stack(points)
    parameters = np.array([parameters_from_ellipse(ellipse) for ellipse in ellipses])
    evaluated = ellipse_residuals(stacked, parameters)
    # Angles from the middle of each arc, so that they have no jump of 2 pi.
    middles = [row[:size].sum() for row, size in zip(evaluated.w, sizes, strict=True)]
    middle = as_column([each / max(abs(each), TINY) for each in middles])
    rotated = evaluated.w * middle.conjugate()
    angles = np.arctan2(rotated.imag, rotated.real)
    order = _order_along_rows(angles, sizes)
    angles, residuals = angles.take(order), evaluated.residuals.take(order)
    stds = np.sqrt(evaluated.variances.take(order))
    feet = stacked.z.take(order) - residuals * evaluated.normals.take(order)
    length = _relative_length(feet, sizes)
    smooth, weights = smooth_residuals(length, residuals, stds, sizes)
    inliers = np.empty(length.shape, dtype=bool)
    inliers.put(order, weights > 0)
    # One interpolation of angles and standard deviations, as real and imaginary part.
    at_even = interpolate_rows(Windows.of(POSITIONS).positions, length, angles + 1j * stds)
    directions = middle * np.exp(1j * at_even.real)
    stds = at_even.imag
    return [
        SmoothedArc(ellipse, directions[i], smooth[i], stds[i], inliers[i, : sizes[i]])
        for i, ellipse in enumerate(ellipses)
    ]


def _order_along_rows(angles: FloatArray, sizes: list[int]) -> IntArray:
    """Return flat indices (k, n) that sort the points of each row; the last one repeats."""
    if len(sizes) > 1:
        angles = angles.copy()
        for row, size in zip(angles, sizes, strict=True):
            row[size:] = np.inf
        order = angles.argsort(axis=1, kind="stable")
        for i, size in enumerate(sizes):
            order[i, size:] = order[i, size - 1]
            order[i] += i * order.shape[1]
        return order
    return angles.argsort(axis=1, kind="stable")


def _relative_length(feet: ComplexArray, sizes: list[int]) -> FloatArray:
    """Return the ascending arc length of points (k, n) from 0 to 1, 1 for repeated points."""
    length: FloatArray = np.zeros(feet.shape)
    np.abs(feet[:, 1:] - feet[:, :-1]).cumsum(axis=1, out=length[:, 1:])
    for row, size in zip(length, sizes, strict=True):
        row[:size] *= 1 / max(float(row[size - 1]), TINY)
        row[size - 1 :] = 1.0
    return length


def interpolate_rows(
    x: FloatArray, knots: FloatArray, values: npt.NDArray[Number]
) -> npt.NDArray[Number]:
    """Return `np.interp` of each of k rows; x and knots are between 0 and 1.

    Each of x, knots and values is one row for all, or k rows. The rows are placed one behind the
    other, so that one call interpolates all.
    """
    count = max(x.size // x.shape[-1], knots.size // knots.shape[-1])
    if count > 1:
        shift = 2.0 * np.arange(count)[:, None]
        x, knots = x + shift, knots + shift
    return np.interp(x.ravel(), knots.ravel(), values.ravel()).reshape(count, -1)


class Windows(NamedTuple):
    """Windows of local regressions at p equal steps of a relative arc length from 0 to 1.

    Parameters
    ----------
    positions : (p,) ndarray
        Relative arc lengths.
    scale, offset : (p, 1) ndarray
        Coordinate in the window, from -1 to 1: ``u = scale * length - offset``.
    moments : (p, 9, 8) ndarray
        Linear map of the weighted sums of c^0 ... c^4, with c = length - 1/2, and of the residual
        times c^0, c^1, c^2 to those of powers of u: the elements (0, 0), (1, 1), (2, 2), (0, 1),
        (0, 2), (1, 2) of the matrix of the normal equations, and its right-hand side.
    """

    positions: FloatArray
    scale: FloatArray
    offset: FloatArray
    moments: FloatArray

    @staticmethod
    @cache
    def of(count: int) -> "Windows":
        """Return the windows at so many positions."""
        positions = np.linspace(0.0, 1.0, count)
        half = WINDOW_FRACTION / 2
        # At the ends the window is one-sided; it is extended inwards to keep its width.
        scale = 1 / (half + np.maximum(np.maximum(half - positions, positions + half - 1), 0.0))
        shift, powers = scale * (0.5 - positions), np.zeros((count, 8, 8))
        for i in range(5):
            for j in range(i + 1):
                powers[:, i, j] = comb(i, j) * scale**j * shift ** (i - j)
        powers[:, 5:, 5:] = powers[:, :3, :3]
        moments = powers[:, [0, 2, 4, 1, 2, 3, 5, 6, 7]]
        # Ridge regression: a window with two points gets a line.
        moments[:, :3] += RIDGE * powers[:, :1]
        return Windows(positions, scale[:, None], (scale * positions)[:, None], moments)


def smooth_residuals(
    length: FloatArray,
    residuals: FloatArray,
    stds: FloatArray,
    sizes: list[int],
    positions: int = POSITIONS,
) -> tuple[FloatArray, FloatArray]:
    """Return the smoothed residuals of k arcs, and robust weights; 0 is a jump.

    One pass of robust local quadratic regression; the paper's reference 20 fits local lines in two
    passes.

    Parameters
    ----------
    length : (k, n) ndarray
        Ascending arc length of the points relative to that of the arc: from 0 to 1.
    residuals, stds : (k, n) ndarray
        Residuals and their standard deviations. Units: mm.
    sizes : list of int
        Number of points of each arc; the others repeat its last one.
    positions : int
        Number of equal steps of arc length, both ends included.

    Returns
    -------
    smooth : (k, p) ndarray
        Smoothed residuals. Units: mm.
    weights : (k, n) ndarray
        Weights of the points by their distance from the smoothed residuals.
    """
    # The first weights come from the residuals from the screened ellipse, which no jump has
    # shifted: an unweighted regression would follow jumps and reject their valid neighbours.
    weights = _bisquare_weights(residuals / stds, sizes)
    weights /= stds * stds
    if len(sizes) > 1:
        for row, size in zip(weights, sizes, strict=True):
            row[size:] = 0.0
    windows = Windows.of(positions)
    smooth = _local_quadratics(length, weights, residuals, windows)
    rest = residuals - interpolate_rows(length, windows.positions, smooth)
    return smooth, _bisquare_weights(rest / stds, sizes)


def _bisquare_weights(normalised: FloatArray, sizes: list[int]) -> FloatArray:
    """Return Tukey's weights of residuals over their standard deviations, (k, n)."""
    stds = [upper_mad_std(row[:size]) for row, size in zip(normalised, sizes, strict=True)]
    # The scale is at least that of the noise model, so that points within the noise are kept.
    weights: FloatArray = normalised * as_column(
        [1 / (TUKEY_CONSTANT * max(std, 1.0)) for std in stds]
    )
    weights *= weights
    np.subtract(1.0, weights, out=weights)
    np.maximum(weights, 0.0, out=weights)
    weights *= weights
    return weights


def _local_quadratics(
    length: FloatArray, weights: FloatArray, residuals: FloatArray, windows: Windows
) -> FloatArray:
    """Return the values (k, p) of weighted quadratics in the middle of p windows."""
    sums = _tricube_kernel(length, windows) @ _weighted_powers(length, weights, residuals)
    # Matrices of the positions times those of the sums of all arcs: (p, 9, 8) @ (p, 8, k).
    moments = windows.moments @ sums.transpose(1, 2, 0)
    m00, m11, m22, m01, m02, m12, r0, r1, r2 = moments.transpose(1, 0, 2)
    # First row of the normal equations' inverse, by Cramer's rule; 0 for an empty window.
    c0, c1, c2 = m11 * m22 - m12 * m12, m02 * m12 - m01 * m22, m01 * m12 - m02 * m11
    determinant = c0 * m00 + c1 * m01 + c2 * m02
    values: FloatArray = ((c0 * r0 + c1 * r1 + c2 * r2) / (determinant + TINY)).T
    return values


def _tricube_kernel(length: FloatArray, windows: Windows) -> FloatArray:
    """Return (1 - |u|^3)^3 within each window, (k, p, n)."""
    u = length[:, None, :] * windows.scale
    u -= windows.offset
    np.abs(u, out=u)
    kernel = u * u
    kernel *= u
    np.subtract(1.0, kernel, out=kernel)
    np.maximum(kernel, 0.0, out=kernel)
    np.multiply(kernel, kernel, out=u)
    kernel *= u
    return kernel


def _weighted_powers(length: FloatArray, weights: FloatArray, residuals: FloatArray) -> FloatArray:
    """Return weights times c^0 ... c^4, and times residual times c^0 ... c^2, (k, n, 8)."""
    powers = np.empty((8, *length.shape))
    c = length - 0.5
    powers[0] = weights
    for i in range(4):
        np.multiply(powers[i], c, out=powers[i + 1])
    np.multiply(powers[:3], residuals, out=powers[5:])
    return powers.transpose(1, 2, 0)
