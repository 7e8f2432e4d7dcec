"""Correction of the shift of a thin laser line towards the centres of the pixels.

Pixels sample a line. One with a sigma below about 0.6 px has light at spatial frequencies that the
pixels cannot represent: the zero crossing of the filter is shifted towards the nearest centre of a
pixel, and the measured width depends on the position between two centres as well, by
-A sin(2 pi v) and B cos(2 pi v). Neither is noise: along a line that is nearly level in the image
the shift has one sign in many columns. A and B follow from the width.

Poisson's formula yields A for pixels that sample a Gaussian section at their centres: for a section
of the measured sigma w, the filter is solved for F(m) = sum h(k - m) = 0, with h(x) =
x exp(-x^2 / 2 p^2) near the zero crossing and 1 / p^2 = 1 / w^2 + 1 / s^2. The sum over whole k
adds to the integral the Fourier transform of h at the frequencies 1 and -1, a sine of the amplitude
2 sqrt(2 pi) p^3 2 pi exp(-2 pi^2 p^2). Over F' = -sqrt(2 pi) p^3 / w^2 this is A =
4 pi w^2 exp(-2 pi^2 p^2). Pixels integrate the light over their area, which lowers A by a third at
the same measured width; therefore it is computed from sections that are integrated.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from lsvision.geometry import BoolArray, FloatArray
from lsvision.laser_line.noise import measure_line_slopes
from lsvision.laser_line.stripe_windows import HALF_WIDTH_SIGMAS, Stripes, Windows
from lsvision.laser_line.subpixel import locate_by_derivative

MIN_AMPLITUDE_PX = 3e-4
"""A below which nothing is corrected, that of a line of 0.74 px and a filter of 2 px. Units: px."""
MIN_FILTER_SIGMA_PX = 0.7
"""Smallest sigma of a filter that is corrected: of a narrower one A increases with the width of the
line, too, because the pixels sample the filter too coarsely. Units: px."""
TABULATED_SECTION_SIGMAS = (0.1, 1.0, 46)
"""Smallest and largest sigma of the light, and number of values, for which A and B are tabulated; a
pixel widens them to 0.24 and 1.04 px."""
TABULATED_POSITIONS = 16
"""Number of positions between two pixels from which A and B are computed."""
MAX_CORRECTED_AMPLITUDE_PX = 0.1
"""Largest A that is corrected, that of a width of 0.38 px. Near the centre of a pixel the
correction increases noise by 1 / (1 - 2 pi A), and from A = 0.16 on one measured row has several
true ones. Units: px."""
AMPLITUDE_STD_FRACTION = 0.3
"""Relative standard deviation of A: pixels that are sensitive in half of their height, or at their
centres only, have an A that is 1.6 times as large at the same measured width."""
RIDGE_FACTOR = 0.95
"""Ratio of A of Steger's ridge, on a level line, to that of the derivative of Gaussian."""
ITERATIONS = 5
"""Newton steps of position and width; more move 99 % of the points by less than 0.003 px."""
MEDIAN_COLUMNS = 61
"""Number of neighbouring columns whose median width yields A. With 7 the noise of the widths makes
A of faint lines four times too large: it increases exponentially as the width decreases."""


def correct_pixel_sampling(windows: Windows, stripes: Stripes, sigma: float) -> Stripes:
    """Correct stripes located by the derivative of Gaussian for the sampling by the pixels.

    Parameters
    ----------
    windows : Windows
        n windows around the line.
    stripes : Stripes
        Result of `locate_by_derivative` for them.
    sigma : float
        Sigma of its filter. Units: px.

    Returns
    -------
    Stripes
        With corrected `pixels`, where the line is thin and not saturated. `std` contains the
        increased noise, the uncertainty of the correction, and what is left of a shift above
        `MAX_CORRECTED_AMPLITUDE_PX`.
    """
    which = _are_thin(windows, stripes, sigma)
    return _correct(stripes, which, sigma, 1.0) if which.any() else stripes


def correct_ridge_sampling(windows: Windows, ridge: Stripes, sigma: float) -> Stripes:
    """Correct stripes located by Steger's method; as `correct_pixel_sampling`.

    The smoothing along the line averages the shift over the positions between two pixels: on a line
    of slope m it is smaller by exp(-2 (pi m sigma)^2).
    """
    which = _are_thin(windows, ridge, sigma)
    if not which.any():
        return ridge
    slopes = measure_line_slopes(windows.columns[which], ridge.pixels[which, 1])
    factor = RIDGE_FACTOR * np.exp(-2 * (math.pi * slopes * sigma) ** 2)
    return _correct(ridge, which, sigma, factor)


def _are_thin(windows: Windows, stripes: Stripes, sigma: float) -> BoolArray:
    """Return the unsaturated stripes (n,) of a line that is thin in half a window; else none."""
    which: BoolArray = stripes.found & ~windows.saturated.any(axis=1)
    if sigma < MIN_FILTER_SIGMA_PX:
        return np.zeros_like(which)
    table = _tabulate_sampling(sigma)
    amplitude = table.interpolate(stripes.widths[which] ** 2, table.amplitude)
    thin = np.count_nonzero(amplitude > MIN_AMPLITUDE_PX)
    return which & (thin > min(MEDIAN_COLUMNS, len(amplitude)) // 2)


def _correct(
    stripes: Stripes, which: BoolArray, sigma: float, factor: FloatArray | float
) -> Stripes:
    """Return the stripes with those of a mask (n,) corrected; `factor` (k,) is that on A."""
    table = _tabulate_sampling(sigma)
    measured, variance = stripes.pixels[which, 1], stripes.widths[which] ** 2
    row, amplitude = _solve_position(measured, variance, table, factor)
    corrected = np.minimum(amplitude, MAX_CORRECTED_AMPLITUDE_PX)
    gain = 1 / (1 - 2 * math.pi * corrected * np.maximum(np.cos(2 * math.pi * row), 0.0))
    error = (amplitude - corrected) + AMPLITUDE_STD_FRACTION * corrected * gain
    pixels, std = stripes.pixels.copy(), stripes.std.copy()
    pixels[which, 1] = row
    std[which] = np.hypot(gain * std[which], error / math.sqrt(2))  # rms of a sine
    return replace(stripes, pixels=pixels, std=std)


@dataclass(frozen=True, eq=False)
class _Sampling:
    """Effects of sampling on sections of k widths, ascending.

    Parameters
    ----------
    variance : (k,) ndarray
        Mean square of the measured width over the positions between two pixels. Units: px^2.
    amplitude : (k,) ndarray
        A, amplitude of the shift. Units: px.
    modulations : (2, k) ndarray
        B, amplitude of the squared width, and that of its second harmonic. Units: px^2.
    """

    variance: FloatArray
    amplitude: FloatArray
    modulations: FloatArray

    def interpolate(self, variance: FloatArray, values: FloatArray) -> FloatArray:
        """Return one of the effects (k,) at variances (n,) in px^2; 0 for wide sections."""
        interpolated: FloatArray = np.interp(variance, self.variance, values, right=0.0)
        return interpolated


def _solve_position(
    measured: FloatArray, variance: FloatArray, table: _Sampling, factor: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """Return the rows v (k,) with v - A sin(2 pi v) as measured, and A (k,); both in px."""
    from scipy.ndimage import median_filter

    row, mean = measured, median_filter(variance, MEDIAN_COLUMNS, mode="nearest")
    for _ in range(ITERATIONS):
        phase = 2 * math.pi * row
        first, second = (table.interpolate(mean, wave) for wave in table.modulations)
        unmodulated = variance - first * np.cos(phase) - second * np.cos(2 * phase)
        mean = median_filter(unmodulated, MEDIAN_COLUMNS, mode="nearest")
        amplitude = factor * table.interpolate(mean, table.amplitude)
        limited = np.minimum(amplitude, MAX_CORRECTED_AMPLITUDE_PX)
        residual = row - limited * np.sin(phase) - measured
        row = row - residual / (1 - 2 * math.pi * limited * np.cos(phase))
    return row, amplitude


@lru_cache
def _tabulate_sampling(sigma: float) -> _Sampling:
    """Return the effects of sampling on a derivative of Gaussian of sigma px."""
    from scipy.special import erf

    light = np.linspace(*TABULATED_SECTION_SIGMAS)
    positions = (np.arange(TABULATED_POSITIONS) + 0.5) / TABULATED_POSITIONS - 0.5
    half_width = math.ceil(HALF_WIDTH_SIGMAS * sigma)
    offsets = np.arange(-half_width, half_width + 1)
    edges = np.arange(-half_width, half_width + 2) - 0.5 - positions[:, None]
    values = np.diff(erf(edges / (math.sqrt(2) * light[:, None, None]))).reshape(-1, len(offsets))
    start = np.tile(positions, len(light))
    rows = np.zeros(len(start), dtype=np.int64)
    saturated = np.zeros(values.shape, dtype=bool)
    windows = Windows(np.arange(len(start)), rows, offsets, values, saturated)
    stripes = locate_by_derivative(windows, start, np.ones_like(values), sigma)
    shift = (stripes.pixels[:, 1] - start).reshape(len(light), -1)
    variance = (stripes.widths**2).reshape(len(light), -1)
    phase = 2 * math.pi * positions
    waves = np.stack([np.cos(phase), np.cos(2 * phase)])
    count = len(positions)
    return _Sampling(
        variance.mean(axis=1), -2 / count * shift @ np.sin(phase), 2 / count * waves @ variance.T
    )
