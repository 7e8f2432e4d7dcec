"""Standard deviation of a laser line's points, estimated from the image itself.

Two sources: read and shot noise, from the scatter of pixel values along the line; and the excess
over it (mainly speckle, whose shift of a stripe does not depend on its brightness), from the
scatter of the located rows from column to column.
"""

from dataclasses import dataclass

import numpy as np

from lsvision.geometry import FloatArray, IntArray
from lsvision.laser_line.line_image import LineImage
from lsvision.laser_line.stripe_windows import Windows
from lsvision.statistics.robust import MAD_TO_STD, mad_std, median

FOURTH_DIFFERENCE = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / np.sqrt(70.0)
"""Fourth difference, normalised to unit variance on white noise; removes cubic trends."""
THIRD_DIFFERENCE = np.array([1.0, -3.0, 3.0, -1.0]) / np.sqrt(20.0)
"""Third difference, normalised in the same way."""
FIFTH_DIFFERENCE = np.array([1.0, -5.0, 10.0, -10.0, 5.0, -1.0]) / np.sqrt(252.0)
"""Fifth difference, normalised in the same way; removes a pipe's curve over tens of columns."""
INDEPENDENT_LAG_PX = 3
"""Distance in columns from which on the errors of points are independent; at shorter distances
speckle is correlated. Units: px."""
MAX_SCATTER_RATIO = 2.5
"""Ratio of the scatter at `INDEPENDENT_LAG_PX` to that of neighbours above which the correlation
extends over longer distances: 1.0 in read noise, 1.6 to 1.9 in speckle, 2.6 to 4 in enlarged
photographs."""
LONGER_LAGS_PX = (6, 12)
"""Distances in columns that are tried in this case. Units: px."""
COMPARED_LAGS_PX = (1, 2, 3, 6)
"""Distances at which scatters are compared to see whether errors are correlated. Units: px."""
MAX_CORRELATED_RATIO = 0.7
"""Ratio of the smallest to the largest scatter below which errors are correlated: 0.84 and more in
images of a camera with three sensors, 0 to 0.56 in JPEG files and interpolated mosaics."""
MIN_SCATTER_GROWTH = 1.25
"""Smallest ratio by which the scatter must grow for a longer distance to be used: white noise has
it in 2 % of lines of 600 columns, the shortest for which one is."""
MIN_LINE_TO_DIFFERENCE_RATIO = 20
"""Smallest ratio of a line's length to that of a difference, so that most differences lie on one
surface."""
SLOPE_SPAN_PX = 6
"""Distance in columns over which the slope of a line is computed, to each side. Units: px."""
BINS = 12
"""Number of bins of pixel values in the photon transfer curve. With 8 and 17 the predicted
variances are the same within 8 %."""
MAX_SAMPLE_COLUMNS, MAX_SAMPLE_PIXELS = 250, 9
"""Largest number of columns, and of pixels in each window, of which the photon transfer curve is
made, to save time. With 30 % fewer of either the predicted variances change by up to 20 %."""
MAX_SAMPLE_LEVEL_FRACTION = 0.9
"""Largest value of a pixel of that curve over the full scale: noise of brighter ones is clipped.
Without this limit the mean squared normalised error of a saturated pipe is 2.3 instead of 1.3."""
ROUNDING_VARIANCE = 1 / 12
"""Variance of rounding to whole numbers. Units: DN^2."""
MIN_SAMPLES = 40
"""Smallest number of differences from which a scatter is estimated: with so few, its relative
standard deviation is 0.24."""
MIN_BLOCK_SAMPLES = 16
"""Smallest number of differences of the means of blocks from which their scatter is estimated: of
168 columns."""


@dataclass(frozen=True)
class PixelNoise:
    """Noise of a pixel as a function of its value.

    Parameters
    ----------
    read_variance : float
        Variance of a dark pixel. Units: DN^2.
    gain : float
        Conversion gain. Units: DN per electron.
    rounding_variance : float
        Smallest variance of a pixel, that of its rounding. Units: DN^2.
    """

    read_variance: float
    gain: float
    rounding_variance: float

    def compute_variances(self, values: FloatArray) -> FloatArray:
        """Return the variance (DN^2) of pixels by their values (DN), at least that of rounding."""
        variances: FloatArray = self.read_variance + self.gain * np.maximum(values, 0.0)
        return np.maximum(variances, self.rounding_variance)


def estimate_pixel_noise(
    image: LineImage, windows: Windows, rounding_variance: float
) -> PixelNoise:
    """Estimate read noise and gain of an image from the pixels in windows around its laser line.

    Variance against mean, fitted through the medians of bins of equal size (photon transfer, EMVA
    1288); each pixel's variance is its squared fourth difference along the line. Neither
    read noise nor gain is negative. No variance is below `rounding_variance`, in DN^2.
    """
    height, width = image.signal.shape
    inside = np.flatnonzero((windows.columns >= 2) & (windows.columns < width - 2))
    inside = inside[:: max(1, len(inside) // MAX_SAMPLE_COLUMNS)]
    offsets = windows.offsets[:: max(1, len(windows.offsets) // MAX_SAMPLE_PIXELS)]
    rows = np.clip(windows.centre_rows[inside, None] + offsets, 0, height - 1)
    columns = np.broadcast_to(windows.columns[inside, None], rows.shape)
    at = rows.ravel(), columns.ravel() + np.arange(-2, 3)[:, None]
    along = image.read_signal(*at)
    level = along.mean(axis=0)
    # At full scale pixels have no noise, and just below it only one side of it.
    is_raw = image.raw_channel is image.signal and not image.colours
    raw = level if is_raw else image.raw_channel[at].mean(axis=0)
    below = np.flatnonzero(raw < MAX_SAMPLE_LEVEL_FRACTION * image.full_scale)
    if len(below) >= MIN_SAMPLES:
        along, level = along.take(below, axis=1), level[below]
    scatter = np.abs(FOURTH_DIFFERENCE @ along)
    # Sums of 8-bit pixels are whole numbers, which are sorted in a quarter of the time.
    whole = is_raw and image.signal.dtype == np.uint8
    keys = along.sum(axis=0).astype(np.int16) if whole else level
    # Bins of equal size: the few brightest pixels that do not fill a bin are omitted.
    order = np.argsort(keys, kind="stable")[: len(level) // BINS * BINS].reshape(BINS, -1)
    means = level[order].mean(axis=1)
    in_bins = np.sort(scatter[order], axis=1)
    middle = (order.shape[1] - 1) // 2, order.shape[1] // 2
    medians = in_bins[:, middle].mean(axis=1)
    variances = np.maximum((MAD_TO_STD * medians) ** 2, rounding_variance)
    # Relative residuals: the error of a bin's variance is proportional to it.
    design = np.column_stack([np.ones_like(means), np.maximum(means, 0.0)]) / variances[:, None]
    from scipy.optimize import nnls

    (read_variance, gain), _ = nnls(design, np.ones(len(means)))
    return PixelNoise(float(read_variance), float(gain), rounding_variance)


def estimate_excess_variance(
    columns: IntArray, rows: FloatArray, std: FloatArray, lag: int | None = None
) -> FloatArray:
    """Estimate the variance (n,) of a line's rows in excess of their predicted noise, in px^2.

    `rows` and their predicted standard deviations `std` are those in the `columns` in which the
    line was located, all (n,) in px. `lag` is the distance in columns from which errors are
    independent: by default 3, and more where the scatter is that of an enlarged or strongly
    compressed image, whose errors are correlated over many columns.

    The result is 0 where the predicted noise explains the scatter, or the line is too short.
    Speckle and roughness shift the line along its normal; the shift along a column is sqrt(1 +
    slope^2) times as large, and so is the standard deviation on a flank.
    """
    column_variance_ratio = 1 + measure_line_slopes(columns, rows) ** 2
    width = int(columns.max()) + 1 if len(columns) else 0
    line, scale = np.full((2, width), np.nan)
    line[columns], scale[columns] = rows, np.sqrt(column_variance_ratio)
    scatter = _measure_scatter(line, scale, THIRD_DIFFERENCE, lag or INDEPENDENT_LAG_PX)
    if lag is None and scatter > MAX_SCATTER_RATIO * _measure_scatter(
        line, scale, THIRD_DIFFERENCE, 1
    ):
        for longer in LONGER_LAGS_PX:
            longer_scatter = _measure_scatter(line, scale, FIFTH_DIFFERENCE, longer)
            if (
                len(columns) < MIN_LINE_TO_DIFFERENCE_RATIO * longer * (len(FIFTH_DIFFERENCE) - 1)
                or longer_scatter < MIN_SCATTER_GROWTH * scatter
            ):
                break
            scatter = longer_scatter
    explained = median(std**2 / column_variance_ratio) if len(std) else 0.0
    return column_variance_ratio * max(scatter**2 - explained, 0.0)


def estimate_block_excess_variance(
    columns: IntArray, rows: FloatArray, std: FloatArray, block: int, first: int
) -> FloatArray:
    """Estimate the variance (n,) of `estimate_excess_variance`, in px^2, by means over columns.

    The rounding of a JPEG image removes the noise of high frequencies and keeps that of low ones.
    Therefore the scatter of single columns underestimates the error of a fit, which is proportional
    to the scatter of block means times the square root of the columns in a block. A block
    has `block` columns; the first whole one begins with the column `first`.
    """
    column_variance_ratio = 1 + measure_line_slopes(columns, rows) ** 2
    index = columns + block - first
    width = (int(index.max()) // block + 1) * block if len(index) else 0
    line, scale = np.full((2, width), np.nan)
    line[index], scale[index] = rows, np.sqrt(column_variance_ratio)
    means, scales = (values.reshape(-1, block).mean(axis=1) for values in (line, scale))
    scatter = _measure_scatter(means, scales, FIFTH_DIFFERENCE, 1, MIN_BLOCK_SAMPLES)
    explained = median(std**2 / column_variance_ratio) if len(std) else 0.0
    return column_variance_ratio * max(block * scatter**2 - explained, 0.0)


def has_correlated_errors(columns: IntArray, rows: FloatArray) -> bool:
    """Return whether the errors of neighbouring columns of a line are correlated.

    They are where the scatter of its sub-pixel `rows` depends on the distance of the `columns`
    (n,): if columns were computed from their neighbours (a mosaic, the colours of a JPEG file), and
    in speckle. Not in read and shot noise, but for chance on lines of fewer than about 200 columns,
    and not if the line is too short to tell.
    """
    scatters = _measure_scatters(columns, rows)
    return min(scatters, default=0.0) < MAX_CORRELATED_RATIO * max(scatters, default=0.0)


def measure_roughness(columns: IntArray, rows: FloatArray) -> float:
    """Return the largest scatter of a line over the distances of its points. Units: px.

    `rows` (n,) are the sub-pixel rows in the `columns` in which the line was located. Where a line
    was located in two ways, the way with the smaller roughness is the better one.
    """
    return max(_measure_scatters(columns, rows), default=0.0)


def _measure_scatters(columns: IntArray, rows: FloatArray) -> list[float]:
    """Return the scatter (px) of a line at those `COMPARED_LAGS_PX` that it is long enough for."""
    line = np.full(int(columns.max()) + 1, np.nan)
    line[columns] = rows
    scale = np.ones_like(line)
    differences = [
        _compute_differences(line, scale, THIRD_DIFFERENCE, lag) for lag in COMPARED_LAGS_PX
    ]
    return [mad_std(of_lag) for of_lag in differences if len(of_lag) >= MIN_SAMPLES]


def measure_line_slopes(columns: IntArray, rows: FloatArray) -> FloatArray:
    """Return the absolute slope (n,) of a line at each point: the smaller one of the two sides.

    The smaller one is not affected by a jump beside the point. Rows per column; 0 for a point
    without neighbours at a distance of `SLOPE_SPAN_PX`.
    """
    width = int(columns.max()) + 1 if len(columns) else 0
    padded = np.full(width + 2 * SLOPE_SPAN_PX, np.nan)
    padded[columns + SLOPE_SPAN_PX] = rows
    ahead = np.abs(padded[columns + 2 * SLOPE_SPAN_PX] - rows)
    behind = np.abs(padded[columns] - rows)
    return np.nan_to_num(np.fmin(ahead, behind)) / SLOPE_SPAN_PX


def _measure_scatter(
    line: FloatArray,
    scale: FloatArray,
    weights: FloatArray,
    lag: int,
    min_samples: int = MIN_SAMPLES,
) -> float:
    """Return the robust std of a line along its normal, 0 from too few differences. Units: px.

    Parameters are those of `_compute_differences`.
    """
    differences = _compute_differences(line, scale, weights, lag)
    return mad_std(differences) if len(differences) >= min_samples else 0.0


def _compute_differences(
    line: FloatArray, scale: FloatArray, weights: FloatArray, lag: int
) -> FloatArray:
    """Return the differences (k,) of a line's points along its normal that are not NaN. Units: px.

    `line` holds the row in each column and `scale` its factor sqrt(1 + slope^2), NaN where lost;
    `weights` are those of a difference of unit variance, `lag` columns apart.
    """
    order = len(weights) - 1
    count = max(len(line) - lag * order, 0)
    along_v = sum(weight * line[lag * k :][:count] for k, weight in enumerate(weights))
    differences: FloatArray = along_v / scale[lag * order // 2 :][:count]
    return differences[np.isfinite(differences)]
