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
INDEPENDENT = 3
"""Columns apart from which points found column by column err independently: the speckle of
neighbours is alike."""
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
    columns: IntArray, rows: FloatArray, std: FloatArray, lag: int = INDEPENDENT
) -> float:
    """Variance of a line's places beyond what their predicted noise explains.

    Parameters
    ----------
    columns : (n,) ndarray of int
        Where the line was found.
    rows, std : (n,) ndarray
        Sub-pixel places and their predicted noise. Units: px.
    lag : int
        Columns from which on errors are independent.

    Returns
    -------
    float
        0 where there is none, or too short a line to tell. Units: px^2.
    """
    width = int(columns.max()) + 1 if len(columns) else 0
    places = np.full(width, np.nan)
    places[columns] = rows
    if width <= 3 * lag:
        return 0.0
    terms = [places[lag * k : width - lag * (3 - k)] for k in range(4)]
    differences = sum(weight * term for weight, term in zip(THIRD, terms, strict=True))
    scatter = np.abs(np.asarray(differences))
    scatter = scatter[np.isfinite(scatter)]
    if len(scatter) < NEEDED:
        return 0.0
    seen = (MAD * float(np.median(scatter))) ** 2
    return max(seen - float(np.median(std**2)), 0.0)
