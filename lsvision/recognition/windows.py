"""Circles through many overlapping windows of ordered points at once, from running moments."""

from dataclasses import dataclass

import numpy as np

from lsvision.shapes import BoolArray, FloatArray, IntArray, Points


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
    flat_rms : (w,) ndarray
        The same from the best straight line. Units: mm.
    coverage : (w,) ndarray
        Angle of the chord seen from the centre. Units: rad.
    convex : (w,) bool ndarray
        The middle bulges towards the sensor.
    """

    centre: FloatArray
    radius: FloatArray
    rms: FloatArray
    flat_rms: FloatArray
    coverage: FloatArray
    convex: BoolArray


def lattice(sizes: IntArray, smallest: int, growth: float) -> tuple[IntArray, IntArray]:
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
        Half open. No window crosses from one component into the next.
    """
    starts, stops = [], []
    first = 0
    for size in sizes:
        length = float(smallest)
        while length < size:
            count = int(length)
            begin = np.append(np.arange(0, size - count, max(1, count // 4)), size - count)
            starts.append(first + begin)
            stops.append(first + begin + count)
            length *= growth
        starts.append(np.array([first]))
        stops.append(np.array([first + size]))
        first += int(size)
    return np.concatenate(starts), np.concatenate(stops)


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
    origin = points.mean(axis=0)
    x, y = (points - origin).T
    z = x * x + y * y
    columns = np.stack([x, y, z, x * x, x * y, y * y, x * z, y * z, z * z])
    running = np.zeros((len(columns), len(points) + 1))
    np.cumsum(columns, axis=1, out=running[:, 1:])
    moments = (running[:, stops] - running[:, starts]) / (stops - starts)
    mx, my, mz = moments[:3]
    sxx, sxy, syy = moments[3] - mx * mx, moments[4] - mx * my, moments[5] - my * my
    sxz, syz, szz = moments[6] - mx * mz, moments[7] - my * mz, moments[8] - mz * mz
    with np.errstate(divide="ignore", invalid="ignore"):
        det = sxx * syy - sxy * sxy
        cx = (sxz * syy - syz * sxy) / (2 * det)
        cy = (syz * sxx - sxz * sxy) / (2 * det)
        radius = np.sqrt(mz + cx * cx + cy * cy - 2 * (cx * mx + cy * my))
        rms = np.sqrt(np.maximum(szz - 2 * (cx * sxz + cy * syz), 0.0)) / (2 * radius)
        chord = points[stops - 1] - points[starts]
        half = np.hypot(chord[:, 0], chord[:, 1]) / (2 * radius)
    radius = np.where(np.isfinite(radius), radius, np.inf)
    coverage = 2 * np.arcsin(np.clip(np.nan_to_num(half), 0.0, 1.0))
    # Past 180 deg the chord shrinks again: the mean then lies beyond the centre.
    towards = my - cy
    middle = points[(starts + stops) // 2]
    centre = np.stack([cx, cy], axis=1) + origin
    past = ((middle - centre) * (points[starts] - centre)).sum(axis=1) < 0
    coverage = np.where(past & (coverage > 0), 2 * np.pi - coverage, coverage)
    rms = np.where(np.isfinite(rms), rms, np.inf)
    flat = (sxx + syy) / 2 - np.hypot((sxx - syy) / 2, sxy)
    flat_rms = np.sqrt(np.maximum(flat, 0.0))
    return WindowCircles(centre, radius, rms, flat_rms, coverage, towards > 0)
