"""How far a laser line's points may be trusted, judged from the image itself.

Two sources. Read and shot noise: the scatter of the pixels about the line, seen along it. And
what neither explains (speckle above all, which moves a column's centre by the same amount
however bright the line): the scatter of the found places from column to column.
"""

from dataclasses import dataclass

import numpy as np

from lsvision.sensor.line_image import Image
from lsvision.sensor.stripe_windows import Windows
from lsvision.shapes import FloatArray, IntArray

FOURTH = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / np.sqrt(70.0)
"""Fourth difference, unit variance on white noise: blind to whatever runs smoothly."""
THIRD = np.array([1.0, -3.0, 3.0, -1.0]) / np.sqrt(20.0)
FIFTH = np.array([1.0, -5.0, 10.0, -10.0, 5.0, -1.0]) / np.sqrt(252.0)
"""Blind to the bend of a pipe also over tens of columns."""
INDEPENDENT = 3
"""Columns apart from which points found column by column err independently: the speckle of
neighbours is alike."""
SMOOTH = 2.5
"""Scatter over that between neighbours from which on errors run on beyond `INDEPENDENT` columns:
1.0 in read noise, 1.6 to 1.9 in speckle, 2.6 to 4 in enlarged photographs."""
LONGER, RISING = (6, 12), 1.25
"""Columns that are tried then, for as long as the scatter rises so much."""
WHOLE = 20
"""Times as long as the differences the line must be: most of them then lie on one surface."""
SLOPE_SPAN = 6
"""Columns to each side over which a line's slope is taken."""
BINS = 12
COLUMNS = 250
PIXELS = 9
"""Columns, and rows of each window, that are looked at for the noise."""
MAD = 1.4826
QUANTUM = 1 / 12
"""DN^2; rounding to whole numbers, the least noise there is."""
NEEDED = 40
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
        return np.maximum(variances, QUANTUM)


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
    down = np.clip(windows.middles[inside, None] + offsets, 0, signal.shape[0] - 1)
    at = windows.columns[inside, None]
    along = np.stack([signal[down, at + shift] for shift in range(-2, 3)]).astype(np.float64)
    level = along.mean(axis=0).ravel()
    scatter = np.abs(np.tensordot(FOURTH, along, axes=1).ravel())
    # Whole bins only: the few brightest pixels beyond are left out.
    order = np.argsort(level)[: len(level) // BINS * BINS].reshape(BINS, -1)
    means = level[order].mean(axis=1)
    variances = np.maximum((MAD * np.median(scatter[order], axis=1)) ** 2, QUANTUM)
    # Relative residuals: a bin's variance is known to a share of itself.
    design = np.column_stack([np.ones_like(means), np.maximum(means, 0.0)]) / variances[:, None]
    from scipy.optimize import nnls

    (read_variance, gain), _ = nnls(design, np.ones(len(means)))
    return PixelNoise(float(read_variance), float(gain))


def unexplained_variance(
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
    steepness = 1 + slopes_of(columns, rows) ** 2
    width = int(columns.max()) + 1 if len(columns) else 0
    places, stretch = np.full((2, width), np.nan)
    places[columns], stretch[columns] = rows, np.sqrt(steepness)
    seen = _scatter(places, stretch, THIRD, lag or INDEPENDENT)
    if lag is None and seen > SMOOTH * _scatter(places, stretch, THIRD, 1):
        for longer in LONGER:
            further = _scatter(places, stretch, FIFTH, longer)
            if len(columns) < WHOLE * longer * (len(FIFTH) - 1) or further < RISING * seen:
                break
            seen = further
    explained = float(np.median(std**2 / steepness)) if len(std) else 0.0
    excess: FloatArray = steepness * max(seen**2 - explained, 0.0)
    return excess


def slopes_of(columns: IntArray, rows: FloatArray) -> FloatArray:
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
    return MAD * float(np.median(scatter)) if len(scatter) >= NEEDED else 0.0
