"""Slope, curvature and fading of a run of a laser line, and the edges of its brightness."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.statistics.robust import mad_std

POLYNOMIAL_COLUMNS = 11
"""Columns of a local polynomial: several times the blur, a fraction of a pipe. With 9 and 15
columns the errors of corrected lines are the same within 4 %. Units: px."""
MAX_STEP_PX = 8.0
"""Largest step between neighbouring columns of one surface. Units: px."""
ROW_DEGREE = 3
"""Degree of the local polynomial of a line's rows: the curvature changes along a flank. With
degree 2 the random errors are the same, with degree 4 they are 4 % larger, 27 % at full scale."""
FADE_DEGREE = 2
"""Degree of the local polynomial of the logarithm of its light, which is noisier."""
MIN_EDGE_FADE = 0.1
"""Relative change of light from column to column that may be an edge: the end of a line, paint, a
shadow. The light of a matt pipe fades by less except beside its end. Units: 1 / px."""
MIN_EDGE_SIGMAS = 4.0
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

    def is_far_from_edges(self, distance: int) -> BoolArray:
        """Return whether neither an edge nor an end is within a distance in columns (n,)."""
        near = np.convolve(self.edge, np.ones(2 * distance + 1))[distance:][: len(self.edge)]
        far: BoolArray = near < 0.5
        far[:distance] = far[max(len(far) - distance, 0) :] = False
        return far


def find_continuous_runs(rows: FloatArray) -> list[IntArray]:
    """Return the indices of each run without lost points and jumps, at least a window long."""
    valid = np.flatnonzero(np.isfinite(rows))
    breaks = (np.diff(valid) > 1) | (np.abs(np.diff(rows[valid])) > MAX_STEP_PX)
    runs = np.split(valid, np.flatnonzero(breaks) + 1)
    return [run for run in runs if len(run) >= POLYNOMIAL_COLUMNS]


def compute_line_shape(rows: FloatArray, light: FloatArray, relative_std: FloatArray) -> LineShape:
    """Compute the shape of a run of a line that has at least `POLYNOMIAL_COLUMNS` points.

    For neighbouring columns (n,) the sub-pixel rows in px, the `light` (sum of the column's pixels,
    in any unit), and its standard deviation relative to it, up to a common factor.
    """
    log_light = np.log(light)
    steps = np.diff(log_light)
    padded = np.concatenate([steps[:1], steps, steps[-1:]])
    before, after = padded[:-1], padded[1:]
    local_fade = (before + after) / 2
    factor = mad_std(np.diff(steps) / relative_std[1:-1])
    noise = factor / np.sqrt(6) * relative_std  # 6: the variance of a second difference
    fade_std = noise / np.sqrt(2)
    fade_std[[0, -1]] *= 2  # an end has one step, not the mean of two
    abrupt = np.abs(local_fade) > np.maximum(MIN_EDGE_FADE, MIN_EDGE_SIGMAS * fade_std)
    edge, pieces = _find_smooth_runs(~abrupt)
    slope = _compute_derivative(rows, pieces, ROW_DEGREE, 1)[0]
    curvature = _compute_derivative(rows, pieces, ROW_DEGREE, 2)[0]
    fade, gain = _compute_derivative(log_light, pieces, FADE_DEGREE, 1)
    fade_std = np.where(edge, fade_std, gain * noise)
    fade[edge] = _compute_fade_at_edges(before[edge], after[edge])
    edge_std = EDGE_STD_FRACTION * np.maximum(np.abs(before), np.abs(after))
    edge_std[[0, -1]] /= EDGE_STD_FRACTION  # an end has a neighbour on one side only
    fade_std[edge] = np.hypot(fade_std[edge], edge_std[edge])
    return LineShape(*_extrapolate_at_edges(slope, curvature, edge), fade, fade_std, edge)


def _compute_fade_at_edges(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return the relative change of light (n,) from those to the columns before and after.

    It is their geometric mean, 0 if they differ in sign: across the end of a line the logarithm of
    the light bends so much that the arithmetic mean is five times too large 1.5 px from the end.
    """
    return np.sign(before) * np.sqrt(np.maximum(before * after, 0.0))


def _find_smooth_runs(smooth: BoolArray) -> tuple[BoolArray, IntArray]:
    """Return the points (n,) outside of smooth runs of at least a window, and the runs' spans.

    The spans (k, 2) are the first and the last index of each run.
    """
    padded = np.zeros(len(smooth) + 2, dtype=bool)
    padded[1:-1] = smooth
    changes = np.flatnonzero(padded[1:] != padded[:-1])
    spans = changes.reshape(-1, 2) - np.array([0, 1])
    spans = spans[spans[:, 1] - spans[:, 0] >= POLYNOMIAL_COLUMNS - 1]
    steps = np.zeros(len(smooth) + 1, np.int8)
    steps[spans[:, 0]] = 1
    steps[spans[:, 1] + 1] = -1
    return steps[:-1].cumsum() == 0, spans


def _compute_derivative(
    values: FloatArray, spans: IntArray, degree: int, order: int
) -> tuple[FloatArray, FloatArray]:
    """Return the 1st or 2nd derivative (n,) of local polynomials, and its std for stds of 1.

    Both hold in the runs with the given `spans` (k, 2) only, from first to last index.
    """
    filters, gains = _build_derivative_filters(degree, order)
    half = POLYNOMIAL_COLUMNS // 2
    window = np.arange(POLYNOMIAL_COLUMNS)
    derivative, std = np.full(len(values), np.nan), np.full(len(values), gains[half])
    derivative[half:-half] = np.correlate(values, filters[half], mode="valid")
    first_windows, last_windows = spans[:, :1], spans[:, 1:] - (POLYNOMIAL_COLUMNS - 1)
    for first, at in ((first_windows, window[:half]), (last_windows, window[half + 1 :])):
        derivative[first + at] = values[first + window] @ filters[at].T
        std[first + at] = gains[at]
    return derivative, std


@lru_cache
def _build_derivative_filters(degree: int, order: int) -> tuple[FloatArray, FloatArray]:
    """Return the filters (window, window) of a derivative at each position, and their norms."""
    half = POLYNOMIAL_COLUMNS // 2
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
