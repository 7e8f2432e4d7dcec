"""Circles through many overlapping windows of ordered points at once, from running moments."""

from dataclasses import dataclass

import numpy as np

from lsvision.geometry import BoolArray, FloatArray, IntArray, Points
from lsvision.geometry.noisy_points import as_complex, as_vectors

WINDOW_GROWTH = 2
"""Ratio of successive lengths."""
SHIFTS_PER_WINDOW = 3
"""Windows of one length are no more than this part of it apart."""


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
        Root mean square distance of the points from the circle, to first order; 0 or NaN where
        the window is straight. Units: mm.
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


def multiscale_windows(sizes: IntArray, smallest: int) -> tuple[IntArray, IntArray]:
    """Windows of growing length, evenly spread, the same from either end of a component.

    Parameters
    ----------
    sizes : (c,) int ndarray
        Points of the components, which lie one behind the other.
    smallest : int
        Points of the shortest window.

    Returns
    -------
    starts, stops : (w,) int ndarray
        Half open. No window crosses from one component into the next; the last ones are the
        components themselves.
    """
    lengths, longest = [smallest], int(sizes.max())
    while lengths[-1] < longest:
        lengths.append(lengths[-1] * WINDOW_GROWTH)
    component, level = np.nonzero(np.array(lengths) < sizes[:, None])
    first = sizes.cumsum() - sizes
    # A row of windows: those of one length in one component, half of them from either end.
    length = np.array(lengths)[level]
    room, step = sizes[component] - length, length // SHIFTS_PER_WINDOW
    half = (room + step - 1) // (2 * step) + 1
    row = np.repeat(np.arange(len(half)), half)
    place = np.arange(len(row)) - (half.cumsum() - half)[row]
    away = place * room[row] // (2 * half - 1)[row]
    begin = first[component][row]
    starts = np.concatenate([begin + away, begin + room[row] - away, first])
    return starts, starts + np.concatenate([length[row], length[row], sizes])


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
    origin = (z[0] + z[-1]) / 2  # so that squares keep their digits
    z = z - origin
    running = np.zeros((4, len(z) + 1), dtype=complex)
    q = running[3, 1:].real = z.real**2 + z.imag**2
    running[0, 1:], running[1, 1:], running[2, 1:] = z, z * z, q * z
    running[3, 1:].imag = q * q
    np.cumsum(running, axis=1, out=running)
    moments = running.take(stops, axis=1)
    moments -= running.take(starts, axis=1)
    moments /= stops - starts
    mean, zz, qz, qq = moments
    # Covariances of z with its conjugate, with z, and of q = |z|^2 with z and with q.
    spread, slant = qq.real - (mean * mean.conj()).real, zz - mean * mean
    pull, square = qz - qq.real * mean, qq.imag - qq.real**2
    size = np.abs(slant)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        centre = (spread * pull - slant * pull.conj()) / (spread**2 - size**2)
        from_mean = centre - mean
        radius = np.sqrt(spread + (from_mean * from_mean.conj()).real)
        radius[~(radius < np.inf)] = np.inf
        rms = np.sqrt(np.maximum(square - 2 * (centre.conj() * pull).real, 0.0)) / (2 * radius)
        first, last = z[starts], z[stops - 1]
        coverage = 2 * np.arcsin(np.minimum(np.abs(last - first) / (2 * radius), 1.0))
        # Past 180 deg the chord lies beyond the centre.
        past = (from_mean * (2 * centre - first - last).conj()).real < 0
    coverage[past] = 2 * np.pi - coverage[past]
    line_rms = np.sqrt(np.maximum(spread - size, 0.0) / 2)
    return WindowCircles(
        as_vectors(centre + origin), radius, rms, line_rms, coverage, from_mean.imag < 0
    )
