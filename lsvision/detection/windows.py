"""Circle fits of many overlapping windows of ordered points at once, from running moments."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import BoolArray, FloatArray, IntArray, Points
from lsvision.geometry.noisy_points import as_complex, as_vectors

WINDOW_GROWTH = 2
"""Ratio of successive window lengths."""
SHIFTS_PER_WINDOW = 3
"""Ratio of a window's length to the largest shift between successive windows of that length."""


@dataclass(frozen=True, eq=False, slots=True)
class WindowCircles:
    """Circles of w windows. Units: mm.

    `rms` is the root mean square distance from the circle, to first order, and `line_rms` that from
    the best line. `radius` is infinite for a straight window, and its `rms` then 0 or NaN. A
    `convex` window is curved towards the sensor.
    """

    centre: FloatArray
    radius: FloatArray
    rms: FloatArray
    line_rms: FloatArray
    convex: BoolArray


def multiscale_windows(sizes: Sequence[int], smallest: int) -> tuple[IntArray, IntArray]:
    """Return starts and stops of windows of increasing length, symmetric within each component.

    `sizes` are the numbers of points of successive components. No window extends over
    two components; the last window of each is the component itself.
    """
    starts, stops, first = [], [], 0
    for size in sizes:
        length = smallest
        while length < size:
            room = size - length
            # With an odd number of steps rounding has no ties, which would break the symmetry.
            steps = -(-room // (length // SHIFTS_PER_WINDOW)) | 1
            row = [first + (2 * k * room + steps) // (2 * steps) for k in range(steps + 1)]
            starts += row
            stops += [start + length for start in row]
            length *= WINDOW_GROWTH
        starts.append(first)
        first += size
        stops.append(first)
    return np.array(starts), np.array(stops)


def fit_window_circles(points: Points, starts: IntArray, stops: IntArray) -> WindowCircles:
    """Fit Kasa's circle to each window [start, stop): linear least squares in x^2 + y^2.

    The radius of short noisy arcs is biased to small values: the circles only select windows.
    """
    z = as_complex(points)
    origin = (z[0] + z[-1]) / 2  # near the points, so that the squares keep their precision
    z = z - origin
    q = z.real**2 + z.imag**2
    running = np.zeros((4, len(z) + 1), dtype=complex)
    products = running[:, 1:]
    products[0], products[1], products[2] = z, z * z, q * z
    products[3].real, products[3].imag = q, q * q
    products.cumsum(axis=1, out=products)
    moments = running.take(stops, axis=1)
    moments -= running.take(starts, axis=1)
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
        radius[~(radius < np.inf)] = np.inf
        rms = np.sqrt(np.maximum(var_q - 2 * (centre.conj() * cov_qz).real, 0.0)) / (2 * radius)
    line_rms = np.sqrt(np.maximum(variance - modulus, 0.0) / 2)
    return WindowCircles(as_vectors(centre + origin), radius, rms, line_rms, from_mean.imag < 0)


def arc_coverage(
    points: Points, starts: IntArray, stops: IntArray, centres: FloatArray
) -> FloatArray:
    """Return the angle that each window's arc covers, across the top of its circle. Units: rad."""
    z, from_top = as_complex(points), -1j
    first, last = ((z[i] - as_complex(centres)) * from_top for i in (starts, stops - 1))
    coverage: FloatArray = np.abs(np.angle(first) - np.angle(last))
    return coverage
