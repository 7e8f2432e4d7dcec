"""Slope, curvature and fading of a run of a laser line, and the edges of its brightness."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.statistics.robust import mad_std

WINDOW = 11
"""Columns of a local polynomial: several times the blur, a fraction of a pipe. Units: px."""
DEGREE = 3
"""Degree of the local polynomial of a line's rows: the curvature changes along a flank."""
FADE_DEGREE = 2
"""Degree of the local polynomial of the logarithm of its light, which is noisier."""
EDGE_FADE = 0.1
"""Relative change of light from column to column that may be an edge: the end of a line, paint, a
shadow. The light of a matt pipe fades by less except beside its end. Units: 1 / px."""
EDGE_SIGMAS = 4.0
"""Smallest change of light at an edge in its standard deviations."""
EDGE_STD_FRACTION = 0.5
"""Standard deviation of `LineShape.fade` at an edge, relative to the larger of the changes of light
from the column before and to the column after: these differ by about their own size."""


@dataclass(frozen=True, eq=False)
class LineShape:
    """Derivatives of n neighbouring points of a line by the column.

    Parameters
    ----------
    slope, curvature : (n,) ndarray
        First and second derivative of the row. Units: 1, 1 / px.
    fade : (n,) ndarray
        Relative change of light per column; at an edge computed from the two neighbouring columns.
        Units: 1 / px.
    fade_std : (n,) ndarray
        Standard deviation of `fade`. Units: 1 / px.
    edge : (n,) ndarray of bool
        Whether the light changes abruptly, or the smooth points beside it are fewer than a window.
    """

    slope: FloatArray
    curvature: FloatArray
    fade: FloatArray
    fade_std: FloatArray
    edge: BoolArray

    def far_from_edges(self, distance: int) -> BoolArray:
        """Return whether neither an edge nor an end is within a distance in columns (n,)."""
        near = np.convolve(self.edge, np.ones(2 * distance + 1))[distance:][: len(self.edge)]
        far: BoolArray = near < 0.5
        far[:distance] = far[max(len(far) - distance, 0) :] = False
        return far


def compute_line_shape(rows: FloatArray, light: FloatArray, relative_std: FloatArray) -> LineShape:
    """Compute the shape of a run of a line that has at least `WINDOW` points.

    For neighbouring columns (n,) the sub-pixel rows in px, the `light` (sum of the column's pixels,
    in any unit), and its standard deviation relative to it, up to a common factor.
    """
    log_light = np.log(light)
    steps = np.diff(log_light)
    before, after = np.append(steps[0], steps), np.append(steps, steps[-1])
    local_fade = (before + after) / 2
    factor = mad_std(np.diff(steps) / relative_std[1:-1])
    noise = factor / np.sqrt(6) * relative_std  # 6: the variance of a second difference
    fade_std = noise / np.sqrt(2)
    fade_std[[0, -1]] *= 2  # an end has one step, not the mean of two
    abrupt = np.abs(local_fade) > np.maximum(EDGE_FADE, EDGE_SIGMAS * fade_std)
    slope, curvature, fade = np.full((3, len(rows)), np.nan)
    for piece in _smooth_runs(~abrupt):
        slope[piece] = _derivative(rows[piece], DEGREE, 1)[0]
        curvature[piece] = _derivative(rows[piece], DEGREE, 2)[0]
        fade[piece], gain = _derivative(log_light[piece], FADE_DEGREE, 1)
        fade_std[piece] = gain * noise[piece]
    edge = np.isnan(slope)
    fade[edge] = _fade_at_edges(before[edge], after[edge])
    edge_std = EDGE_STD_FRACTION * np.maximum(np.abs(before), np.abs(after))
    edge_std[[0, -1]] /= EDGE_STD_FRACTION  # an end has a neighbour on one side only
    fade_std[edge] = np.hypot(fade_std[edge], edge_std[edge])
    return LineShape(*_extrapolate_at_edges(slope, curvature, edge), fade, fade_std, edge)


def _fade_at_edges(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return the relative change of light (n,) from those to the columns before and after.

    It is their geometric mean, 0 if they differ in sign: across the end of a line the logarithm of
    the light bends so much that the arithmetic mean is five times too large 1.5 px from the end.
    """
    return np.sign(before) * np.sqrt(np.maximum(before * after, 0.0))


def _smooth_runs(smooth: BoolArray) -> list[IntArray]:
    """Return the indices of each run of smooth points that is at least as long as a window."""
    indices = np.flatnonzero(smooth)
    pieces = np.split(indices, np.flatnonzero(np.diff(indices) > 1) + 1)
    return [piece for piece in pieces if len(piece) >= WINDOW]


def _derivative(values: FloatArray, degree: int, order: int) -> tuple[FloatArray, FloatArray]:
    """Return the 1st or 2nd derivative (n,) of local polynomials, and its std for stds of 1."""
    filters, gains = _filters(degree, order)
    half, last = WINDOW // 2, len(values) - WINDOW
    inner = np.correlate(values, filters[half], mode="valid")
    derivative = np.concatenate(
        [filters[:half] @ values[:WINDOW], inner, filters[half + 1 :] @ values[last:]]
    )
    return derivative, np.concatenate(
        [gains[:half], np.full(last + 1, gains[half]), gains[half + 1 :]]
    )


@lru_cache
def _filters(degree: int, order: int) -> tuple[FloatArray, FloatArray]:
    """Return the filters (window, window) of a derivative at each position, and their norms."""
    half = WINDOW // 2
    powers = np.arange(degree + 1)
    x = np.arange(-half, half + 1)[:, None] / half
    factors = powers if order == 1 else powers * (powers - 1)
    monomials = factors * x ** np.maximum(powers - order, 0) / half**order
    filters: FloatArray = monomials @ np.linalg.pinv(x**powers)
    return filters, np.linalg.norm(filters, axis=1)


def _extrapolate_at_edges(
    slope: FloatArray, curvature: FloatArray, edge: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return slope and curvature; at edges those of the parabola at the nearest smooth point.

    Zeros if no point is smooth.
    """
    smooth, at = np.flatnonzero(~edge), np.flatnonzero(edge)
    if not len(smooth):
        return np.zeros_like(slope), np.zeros_like(slope)
    after = np.clip(np.searchsorted(smooth, at), 1, len(smooth) - 1)
    before, after = smooth[after - 1], smooth[after]
    nearest = np.where(at - before < after - at, before, after)
    slope[at] = slope[nearest] + curvature[nearest] * (at - nearest)
    curvature[at] = curvature[nearest]
    return slope, curvature
