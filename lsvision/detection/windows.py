"""Circles through many overlapping windows of ordered points at once, from running moments."""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.shapes import BoolArray, FloatArray, IntArray, Points
from lsvision.shapes.noisy_points import as_complex, as_vectors


@dataclass(frozen=True, eq=False, slots=True)
class WindowCircles:
    """Circle of each window, w of them.

    Parameters
    ----------
    centre : (w, 2) ndarray
        Units: mm.
    radius : (w,) ndarray
        Infinite where the window is straight. Units: mm.
    rms : (w,) ndarray
        Root mean square distance of the points from the circle, to first order. Units: mm.
    line_rms : (w,) ndarray
        The same from the best straight line. Units: mm.
    coverage : (w,) ndarray
        Angle of the chord seen from the centre. Units: rad.
    convex : (w,) bool ndarray
        The middle bulges towards the sensor.
    """

    centre: FloatArray
    radius: FloatArray
    rms: FloatArray
    line_rms: FloatArray
    coverage: FloatArray
    convex: BoolArray


def multiscale_windows(sizes: IntArray, smallest: int, growth: float) -> tuple[IntArray, IntArray]:
    """Windows of geometrically growing length, each shifted by a quarter of itself.

    Parameters
    ----------
    sizes : (c,) int ndarray
        Points of the components, which lie one behind the other.
    smallest : int
        Length of the shortest window.
    growth : float
        Ratio of successive lengths.

    Returns
    -------
    starts, stops : (w,) int ndarray
        Half open. No window crosses from one component into the next; the last ones are the
        components themselves.
    """
    levels = math.ceil(max(math.log(sizes.max() / smallest, growth), 0.0))
    lengths = (smallest * growth ** np.arange(levels)).astype(int)
    component, level = np.nonzero(lengths < sizes[:, None])
    first = sizes.cumsum() - sizes
    # A row of windows: those of one length in one component, the last of them at its end.
    length = lengths[level]
    step, room = np.maximum(length // 4, 1), sizes[component] - length
    windows = -(-room // step) + 1
    row = np.repeat(np.arange(len(windows)), windows)
    place = np.arange(len(row)) - (windows.cumsum() - windows)[row]
    starts = first[component][row] + np.minimum(place * step[row], room[row])
    stops = starts + length[row]
    return np.concatenate([starts, first]), np.concatenate([stops, first + sizes])


def fit_window_circles(points: Points, starts: IntArray, stops: IntArray) -> WindowCircles:
    """Kasa's circle of each window: linear least squares in x^2 + y^2.

    Parameters
    ----------
    points : (n, 2) ndarray
        Ordered. Units: mm.
    starts, stops : (w,) int ndarray
        Half-open windows of at least 3 points.

    Returns
    -------
    WindowCircles
        Biased small on short noisy arcs: to choose windows by, never a result.
    """
    z = as_complex(points)
    origin = complex(z.sum()) / len(z)
    z = z - origin
    q = z.real**2 + z.imag**2
    running = np.zeros((4, len(z) + 1), dtype=complex)
    running[:, 1:] = z, z * z, q * z, q + 1j * (q * q)
    np.cumsum(running, axis=1, out=running)
    moments = running.take(stops, axis=1)
    moments -= running.take(starts, axis=1)
    moments /= stops - starts
    mean, zz, qz, qq = moments
    # Covariances of z with its conjugate, with z, and of q = |z|^2 with z and with q.
    spread, slant = qq.real - np.abs(mean) ** 2, zz - mean * mean
    pull, square = qz - qq.real * mean, qq.imag - qq.real**2
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        centre = (spread * pull - slant * pull.conj()) / (spread**2 - np.abs(slant) ** 2)
        inner = (centre * (centre - 2 * mean).conj()).real
        radius = np.sqrt(qq.real + inner)
        radius[~np.isfinite(radius)] = np.inf
        misfit = square - 2 * (centre.conj() * pull).real
        rms = np.sqrt(np.maximum(misfit, 0.0)) / (2 * radius)
        rms[~np.isfinite(rms)] = np.inf
        first, last, middle = z[starts], z[stops - 1], z[(starts + stops) // 2]
        coverage = 2 * np.arcsin(np.minimum(np.abs(last - first) / (2 * radius), 1.0))
        # Past 180 deg the chord shrinks again: the middle then lies beyond the centre.
        past = ((middle - centre) * (first - centre).conj()).real < 0
    coverage[past] = 2 * np.pi - coverage[past]
    flat_rms = np.sqrt(np.maximum(spread - np.abs(slant), 0.0) / 2)
    convex = (mean - centre).imag > 0
    return WindowCircles(as_vectors(centre + origin), radius, rms, flat_rms, coverage, convex)
