"""Circle fits of many overlapping windows of ordered points at once, from running moments."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.geometry.noisy_points import ComplexArray

WINDOW_GROWTH = 2
"""Ratio of successive window lengths."""
SHIFTS_PER_WINDOW = 3
"""Ratio of a window's length to the largest shift between successive windows of that length."""
MAX_CACHED_SIZES = 512
"""Number of sizes of components whose windows are kept: 10 MB for sizes of 2000 points."""


class Windows(NamedTuple):
    """Spans [start, stop) of w windows of points, and the row of points in which each lies."""

    rows: IntArray
    starts: IntArray
    stops: IntArray


@dataclass(frozen=True, eq=False, slots=True)
class WindowCircles:
    """Circles of w windows, with complex centres x + iy. Units: mm.

    `rms` is the root mean square distance from the circle, to first order, and `line_rms` that from
    the best line. `radius` is infinite for a straight window, and its `rms` then 0 or NaN. A
    `convex` window is curved towards the sensor.
    """

    centre: ComplexArray
    radius: FloatArray
    rms: FloatArray
    line_rms: FloatArray
    convex: BoolArray


def multiscale_windows(sizes: Sequence[int], smallest: int) -> tuple[IntArray, IntArray]:
    """Return starts and stops of windows of increasing length, symmetric within each component.

    `sizes` are the numbers of points of successive components. No window extends over
    two components; the last window of each is the component itself.
    """
    spans, first = [np.zeros((2, 0), dtype=int)], 0
    for size in sizes:
        spans.append(first + _component_windows(size, smallest))
        first += size
    starts, stops = np.concatenate(spans, axis=1)
    return starts, stops


@lru_cache(maxsize=MAX_CACHED_SIZES)
def _component_windows(size: int, smallest: int) -> IntArray:
    """Return starts and stops (2, w) of the windows of a component of `size` points."""
    starts, stops, length = list[int](), list[int](), smallest
    while length < size:
        room = size - length
        # With an odd number of steps rounding has no ties, which would break the symmetry.
        steps = -(-room // (length // SHIFTS_PER_WINDOW)) | 1
        offsets = [(2 * k * room + steps) // (2 * steps) for k in range(steps + 1)]
        starts += offsets
        stops += [start + length for start in offsets]
        length *= WINDOW_GROWTH
    windows = np.array([[*starts, 0], [*stops, size]])
    windows.setflags(write=False)
    return windows


def fit_window_circles(points: ComplexArray, windows: Windows) -> WindowCircles:
    """Fit Kasa's circle to each window: linear least squares in x^2 + y^2.

    `points` are rows (p, n) of points x + iy in mm, one for each profile. The radius of short noisy
    arcs is biased to small values: the circles only select windows.
    """
    origins = (points[:, :1] + points[:, -1:]) / 2  # near, so that the squares keep their precision
    z = points - origins
    q = z.real**2 + z.imag**2
    # Cumulated z, z^2, q z and q + i q^2: their differences are the moments of the windows.
    running = np.zeros((4, len(z), z.shape[1] + 1), dtype=complex)
    products = running[..., 1:]
    products[0], products[1], products[2] = z, z * z, q * z
    products[3].real, products[3].imag = q, q * q
    products.cumsum(axis=-1, out=products)
    rows, starts, stops = windows
    running, first = running.reshape(4, -1), rows * running.shape[-1]
    moments = running.take(first + stops, axis=1)
    moments -= running.take(first + starts, axis=1)
    moments /= np.maximum(stops - starts, 1)
    mean, zz, qz, qq = moments
    # Second central moments E|z|^2 and E z^2; covariances of q = |z|^2 with z and with q.
    variance, pseudo_variance = qq.real - (mean * mean.conj()).real, zz - mean * mean
    cov_qz, var_q = qz - qq.real * mean, qq.imag - qq.real**2
    modulus = np.abs(pseudo_variance)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        centre = variance * cov_qz - pseudo_variance * cov_qz.conj()
        centre /= variance**2 - modulus**2
        from_mean = centre - mean
        radius = np.sqrt(variance + (from_mean * from_mean.conj()).real)
        radius = np.fmin(radius, np.inf)  # NaN becomes inf
        rms = np.sqrt(np.maximum(var_q - 2 * (centre.conj() * cov_qz).real, 0.0)) / (2 * radius)
    line_rms = np.sqrt(np.maximum(variance - modulus, 0.0) / 2)
    centre += origins.take(rows)
    return WindowCircles(centre, radius, rms, line_rms, from_mean.imag < 0)


def arc_coverage(points: ComplexArray, windows: Windows, centres: ComplexArray) -> FloatArray:
    """Return the angle that each window's arc covers, across the top of its circle. Units: rad.

    `points` are rows (p, n) of points, `centres` (w,) those of the circles, x + iy in mm.
    """
    rows, starts, stops = windows
    ends = points.take(np.array([starts, stops - 1]) + rows * points.shape[1]) - centres
    first, last = np.arctan2(ends.real, ends.imag)
    coverage: FloatArray = np.abs(first - last)
    return coverage
