"""Circle fits to many overlapping windows of ordered points at once, from cumulated moments."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.geometry.noisy_points import ComplexArray

WINDOW_GROWTH = 2
"""Ratio of successive window lengths. With 3, 7 of 1345 pipes are lost."""
SHIFTS_PER_WINDOW = 3
"""Ratio of a window's length to the largest shift between successive windows of that length. With 2
or 4 the same pipes are found, but for one."""
MAX_CACHED_SIZES = 512
"""Number of component sizes whose windows are cached: 10 MB for sizes of 2000 points."""


class Windows(NamedTuple):
    """Spans [start, stop) of w windows, and the row of points to which each window belongs."""

    rows: IntArray
    starts: IntArray
    stops: IntArray


@dataclass(frozen=True, eq=False, slots=True)
class WindowCircles:
    """Circles fitted to w windows.

    Parameters
    ----------
    centre : (w,) complex ndarray
        Centre x + iy. Units: mm.
    radius : (w,) ndarray
        Radius; infinite for a straight window. Units: mm.
    rms : (w,) ndarray
        Root mean square distance from the circle, to first order; 0 or NaN for a straight window.
        Units: mm.
    line_rms : (w,) ndarray
        Root mean square distance from the best straight line. Units: mm.
    convex : (w,) bool ndarray
        Whether the window is curved as a cylinder is: with its centre beyond it, as seen from the
        sensor.
    """

    centre: ComplexArray
    radius: FloatArray
    rms: FloatArray
    line_rms: FloatArray
    convex: BoolArray


def build_multiscale_windows(sizes: Sequence[int], smallest: int) -> IntArray:
    """Return starts and stops (2, w) of windows of increasing length in successive components.

    `sizes` are the numbers of points of one or more components, `smallest` is that of the shortest
    window. No window contains points of two components; the last window of a component is the
    component itself. The windows of a component are symmetric about its middle.
    """
    firsts = accumulate(sizes[:-1], initial=0)
    spans = [
        first + _build_component_windows(size, smallest)
        for first, size in zip(firsts, sizes, strict=True)
    ]
    return np.concatenate(spans, axis=1)


@lru_cache(maxsize=MAX_CACHED_SIZES)
def _build_component_windows(size: int, smallest: int) -> IntArray:
    """Return starts and stops (2, w) of the windows of a component of `size` points."""
    starts, stops, length = list[int](), list[int](), smallest
    while length < size:
        last = size - length
        # With an odd number of steps there are no ties in rounding, which would break the symmetry.
        steps = math.ceil(last / (length // SHIFTS_PER_WINDOW)) | 1
        offsets = [round(k * last / steps) for k in range(steps + 1)]
        starts += offsets
        stops += [start + length for start in offsets]
        length *= WINDOW_GROWTH
    windows = np.array([[*starts, 0], [*stops, size]])
    windows.setflags(write=False)
    return windows


def fit_window_circles(points: ComplexArray, windows: Windows) -> WindowCircles:
    """Fit a circle to each window by Kasa's method: linear least squares in x^2 + y^2.

    The radius of short noisy arcs is biased to small values, so that the circles serve only to
    select windows.

    Parameters
    ----------
    points : (p, n) complex ndarray
        Points x + iy, one row for each profile. Units: mm.
    windows : Windows
        Windows of these rows.

    Returns
    -------
    WindowCircles
        Circle of each window.
    """
    # An origin near the points, so that the squares are precise.
    origins = (points[:, :1] + points[:, -1:]) / 2
    z = points - origins
    q = z.real**2 + z.imag**2
    # Cumulated z, z^2, q z and q + i q^2: their differences are the moments of the windows.
    cumulated = np.zeros((4, len(z), z.shape[1] + 1), dtype=complex)
    products = cumulated[..., 1:]
    products[0], products[1], products[2] = z, z * z, q * z
    products[3].real, products[3].imag = q, q * q
    products.cumsum(axis=-1, out=products)
    rows, starts, stops = windows
    cumulated, first = cumulated.reshape(4, -1), rows * cumulated.shape[-1]
    moments = cumulated.take(first + stops, axis=1)
    moments -= cumulated.take(first + starts, axis=1)
    moments /= np.maximum(stops - starts, 1)
    mean, zz, qz, qq = moments
    # Second central moments E|z|^2 and E z^2; covariances of q = |z|^2 with z and with q. The
    # normal equation for the centre c is variance c + pseudo_variance conj(c) = cov_qz.
    variance, pseudo_variance = qq.real - (mean * mean.conj()).real, zz - mean * mean
    cov_qz, var_q = qz - qq.real * mean, qq.imag - qq.real**2
    modulus = np.abs(pseudo_variance)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        centre = variance * cov_qz - pseudo_variance * cov_qz.conj()
        centre /= variance**2 - modulus**2
        from_mean = centre - mean
        # radius^2 = E |z - centre|^2.
        radius = np.sqrt(variance + (from_mean * from_mean.conj()).real)
        radius = np.fmin(radius, np.inf)  # NaN becomes inf
        # The algebraic residual |z - centre|^2 - radius^2 is 2 radius times the distance; at the
        # minimum its variance is that of q minus the part that 2 Re(conj(centre) z) explains.
        rms = np.sqrt(np.maximum(var_q - 2 * (centre.conj() * cov_qz).real, 0.0)) / (2 * radius)
    # The smaller eigenvalue of the covariance of x and y: the variance perpendicular to the line.
    line_rms = np.sqrt(np.maximum(variance - modulus, 0.0) / 2)
    centre += origins.take(rows)
    return WindowCircles(centre, radius, rms, line_rms, from_mean.imag < 0)


def measure_arc_coverage(
    points: ComplexArray, windows: Windows, centres: ComplexArray
) -> FloatArray:
    """Return the angle (w,) between the first and the last point of each window. Units: rad.

    `points` are rows (p, n) of points, `centres` (w,) the centres of the circles, x + iy in mm. The
    angle is that across the top of the circle, the side towards the sensor.
    """
    rows, starts, stops = windows
    ends = points.take(np.array([starts, stops - 1]) + rows * points.shape[1]) - centres
    first, last = np.arctan2(ends.real, ends.imag)  # angles from +Y, without a step at the top
    coverage: FloatArray = np.abs(first - last)
    return coverage
