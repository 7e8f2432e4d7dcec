"""How far a laser line's points may be trusted, judged from the image itself.

Two sources. Read and shot noise: the scatter of the pixels about the line, seen along it. And
what neither explains (speckle above all, which moves a column's centre by the same amount
however bright the line): the scatter of the found places from column to column.
"""

from dataclasses import dataclass

import numpy as np

from lsvision.geometry import FloatArray, IntArray
from lsvision.laser_line.line_image import Image
from lsvision.laser_line.stripe_windows import Windows

FOURTH_DIFFERENCE = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / np.sqrt(70.0)
"""Fourth difference, unit variance on white noise: blind to whatever runs smoothly."""
THIRD_DIFFERENCE = np.array([1.0, -3.0, 3.0, -1.0]) / np.sqrt(20.0)
FIFTH_DIFFERENCE = np.array([1.0, -5.0, 10.0, -10.0, 5.0, -1.0]) / np.sqrt(252.0)
"""Blind to the bend of a pipe also over tens of columns."""
INDEPENDENT_LAG = 3
"""Columns apart from which points found column by column err independently: the speckle of
neighbours is alike."""
MAX_SCATTER_RATIO = 2.5
"""Scatter over that between neighbours from which on errors run on beyond `INDEPENDENT_LAG`
columns: 1.0 in read noise, 1.6 to 1.9 in speckle, 2.6 to 4 in enlarged photographs."""
LONGER_LAGS, MIN_SCATTER_GROWTH = (6, 12), 1.25
"""Columns that are tried then, for as long as the scatter rises so much."""
MIN_LENGTH_RATIO = 20
"""Times as long as the differences the line must be: most of them then lie on one surface."""
SLOPE_SPAN = 6
"""Columns to each side over which a line's slope is taken."""
BINS = 12
COLUMNS = 250
PIXELS = 9
"""Columns, and rows of each window, that are looked at for the noise."""
MAD_TO_STD = 1.4826
QUANTISATION_VARIANCE = 1 / 12
"""DN^2; rounding to whole numbers, the least noise there is."""
MIN_SAMPLES = 40
"""Points below which the scatter says nothing."""


@dataclass(frozen=True)
class PixelNoise:
    """Noise of a pixel, by its value.

    Parameters
    ----------
    read_variance : float
        Units: DN^2.
    gain : float
        DN per electron.
    """

    read_variance: float
    gain: float

    def variances(self, values: FloatArray) -> FloatArray:
        """Variance of pixels of these values, at least that of rounding. Units: DN^2."""
        variances: FloatArray = self.read_variance + self.gain * np.maximum(values, 0.0)
        return np.maximum(variances, QUANTISATION_VARIANCE)


def estimate_pixel_noise(signal: Image, windows: Windows) -> PixelNoise:
    """Read noise and gain of an image, from the pixels around its laser line.

    Parameters
    ----------
    signal : (height, width) ndarray
        Units: DN.
    windows : Windows
        About the line.

    Returns
    -------
    PixelNoise
        Of unsaturated pixels.

    Notes
    -----
    Variance against mean, fitted through the medians of bins of equal size (photon transfer,
    EMVA 1288); each pixel's variance is its squared fourth difference along the line.
    """
    inside = np.flatnonzero((windows.columns >= 2) & (windows.columns < signal.shape[1] - 2))
    inside = inside[:: max(1, len(inside) // COLUMNS)]
    offsets = windows.offsets[:: max(1, len(windows.offsets) // PIXELS)]
    down = np.clip(windows.centre_rows[inside, None] + offsets, 0, signal.shape[0] - 1)
    at = windows.columns[inside, None]
    along = np.stack([signal[down, at + shift] for shift in range(-2, 3)]).astype(np.float64)
    level = along.mean(axis=0).ravel()
    scatter = np.abs(np.tensordot(FOURTH_DIFFERENCE, along, axes=1).ravel())
    # Whole bins only: the few brightest pixels beyond are left out.
    order = np.argsort(level)[: len(level) // BINS * BINS].reshape(BINS, -1)
    means = level[order].mean(axis=1)
    variances = np.maximum(
        (MAD_TO_STD * np.median(scatter[order], axis=1)) ** 2, QUANTISATION_VARIANCE
    )
    # Relative residuals: a bin's variance is known to a share of itself.
    design = np.column_stack([np.ones_like(means), np.maximum(means, 0.0)]) / variances[:, None]
    from scipy.optimize import nnls

    (read_variance, gain), _ = nnls(design, np.ones(len(means)))
    return PixelNoise(float(read_variance), float(gain))


def excess_variance(
    columns: IntArray, rows: FloatArray, std: FloatArray, lag: int | None = None
) -> FloatArray:
    """Variance of a line's places beyond what their predicted noise explains.

    Parameters
    ----------
    columns : (n,) ndarray of int
        Where the line was found.
    rows, std : (n,) ndarray
        Sub-pixel places and their predicted noise. Units: px.
    lag : int, optional
        Columns from which on errors are independent. By default 3, and more where the scatter
        is that of an enlarged or strongly compressed image, whose errors run along the line.

    Returns
    -------
    (n,) ndarray
        0 where there is none, or too short a line to tell. Units: px^2.

    Notes
    -----
    Speckle and roughness move the line across itself; down a column that is by
    sqrt(1 + slope^2) more, and so much larger is the variance on a flank.
    """
    steepness = 1 + line_slopes(columns, rows) ** 2
    width = int(columns.max()) + 1 if len(columns) else 0
    places, stretch = np.full((2, width), np.nan)
    places[columns], stretch[columns] = rows, np.sqrt(steepness)
    seen = _scatter(places, stretch, THIRD_DIFFERENCE, lag or INDEPENDENT_LAG)
    if lag is None and seen > MAX_SCATTER_RATIO * _scatter(places, stretch, THIRD_DIFFERENCE, 1):
        for longer in LONGER_LAGS:
            further = _scatter(places, stretch, FIFTH_DIFFERENCE, longer)
            if (
                len(columns) < MIN_LENGTH_RATIO * longer * (len(FIFTH_DIFFERENCE) - 1)
                or further < MIN_SCATTER_GROWTH * seen
            ):
                break
            seen = further
    explained = float(np.median(std**2 / steepness)) if len(std) else 0.0
    excess: FloatArray = steepness * max(seen**2 - explained, 0.0)
    return excess


def line_slopes(columns: IntArray, rows: FloatArray) -> FloatArray:
    """Slope of a line at each of its points, the gentler of those to its two sides.

    Beside a jump that is the line's own. (n,), 0 for a point alone. Units: 1.
    """
    width = int(columns.max()) + 1 if len(columns) else 0
    places = np.full(width + 2 * SLOPE_SPAN, np.nan)
    places[columns + SLOPE_SPAN] = rows
    ahead = np.abs(places[columns + 2 * SLOPE_SPAN] - rows)
    behind = np.abs(places[columns] - rows)
    slopes: FloatArray = np.nan_to_num(np.fmin(ahead, behind)) / SLOPE_SPAN
    return slopes


def _scatter(places: FloatArray, stretch: FloatArray, weights: FloatArray, lag: int) -> float:
    """One sigma of differences of unit variance, over the stretch in their middle; robust."""
    order = len(weights) - 1
    count = len(places) - lag * order
    if count <= 0:
        return 0.0
    differences = sum(weight * places[lag * k :][:count] for k, weight in enumerate(weights))
    scatter = np.abs(differences / stretch[lag * order // 2 :][:count])
    scatter = scatter[np.isfinite(scatter)]
    return MAD_TO_STD * float(np.median(scatter)) if len(scatter) >= MIN_SAMPLES else 0.0
