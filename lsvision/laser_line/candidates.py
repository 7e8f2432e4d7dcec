"""Where in each column a laser line might be: local maxima of a matched filter."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from lsvision.geometry import FloatArray, IntArray
from lsvision.laser_line.line_image import Image

FIXED_POINT = 32
"""Steps of the integer filter in one DN of an 8-bit image; twice the response fits 16 bit."""
DETECTION_SIGMAS = 4.5
"""Noise sigmas of the filtered image below which a maximum is noise: about one in 10^6."""
NOISE_SAMPLE = 7
"""Every so many-th row and column is looked at for the noise; a prime, to miss patterns."""


@dataclass(frozen=True, eq=False)
class LineCandidates:
    """Local maxima, ordered by column, then row.

    Parameters
    ----------
    columns : (n,) ndarray of int
        Units: px.
    rows : (n,) ndarray
        Top of the parabola through the maximum and its neighbours. Units: px.
    scores : (n,) ndarray
        Height of a Gaussian stripe, of the filter's sigma, that answers alike. Units: DN.
    threshold : float
        Score below which maxima were left out. Units: DN.
    shape : tuple of int
        ``(height, width)`` of the image.
    """

    columns: IntArray
    rows: FloatArray
    scores: FloatArray
    threshold: float
    shape: tuple[int, int]

    def __len__(self) -> int:
        return len(self.columns)

    def select(self, which: np.ndarray) -> "LineCandidates":
        """Those that an index or mask names, in order."""
        return LineCandidates(
            self.columns[which], self.rows[which], self.scores[which], self.threshold, self.shape
        )


def matched_kernel(sigma: float) -> FloatArray:
    """Gaussian without its mean; answers 1 to a stripe of height 1 and the same sigma."""
    reach = math.ceil(3 * sigma)
    stripe = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    kernel = stripe - stripe.mean()
    unit: FloatArray = kernel / (kernel @ stripe)
    return unit


def find_line_candidates(
    signal: Image, sigma: float, least_score: float, per_column: int
) -> LineCandidates:
    """Local maxima down each column of the matched-filtered image.

    Parameters
    ----------
    signal : (height, width) ndarray
        uint8, int16 or float32. Units: DN.
    sigma : float
        Of the filter. Units: px.
    least_score : float
        Lower ones are left out; as are those within the image's own noise. Units: DN.
    per_column : int
        Strongest kept in each column.

    Returns
    -------
    LineCandidates
        Maybe none.
    """
    response, unit = _filtered(signal, sigma)
    sample = np.abs(response[::NOISE_SAMPLE, ::NOISE_SAMPLE])
    noise = 1.4826 * float(np.median(sample))
    threshold = max(least_score * unit, DETECTION_SIGMAS * noise)
    reach = 2 * max(1, round(sigma)) + 1
    highest = cv2.dilate(response, np.ones((reach, 1), np.uint8))
    peak = cv2.compare(response, highest, cv2.CMP_EQ)
    peak &= cv2.compare(response, threshold, cv2.CMP_GT)
    rows, columns = _nonzero(peak)
    scores = response[rows, columns].astype(np.float64) / unit
    order = np.lexsort((-scores, columns))
    rank = np.arange(len(order)) - np.searchsorted(columns[order], columns[order])
    kept = order[rank < per_column]
    kept = kept[np.lexsort((rows[kept], columns[kept]))]
    shape = (signal.shape[0], signal.shape[1])
    tops = _subpixel_peaks(response, columns[kept], rows[kept])
    return LineCandidates(columns[kept], tops, scores[kept], threshold / unit, shape)


def _filtered(signal: Image, sigma: float) -> tuple[Image, float]:
    """Filter response and its numbers in one DN; integers where they hold it, for speed."""
    kernel = matched_kernel(sigma).astype(np.float32)[:, None]
    if signal.dtype == np.uint8:
        along = np.ones(1, np.float32)
        return cv2.sepFilter2D(signal, cv2.CV_16S, along, kernel * FIXED_POINT), FIXED_POINT
    return cv2.sepFilter2D(signal, cv2.CV_32F, np.ones(1, np.float32), kernel), 1.0


def _subpixel_peaks(response: Image, columns: IntArray, rows: IntArray) -> FloatArray:
    above, below = np.maximum(rows - 1, 0), np.minimum(rows + 1, len(response) - 1)
    before, at, after = (response[row, columns].astype(np.float64) for row in (above, rows, below))
    bend = 2 * at - before - after
    shift = np.where(bend > 0, 0.5 * (after - before) / np.where(bend > 0, bend, 1.0), 0.0)
    tops: FloatArray = rows + np.clip(shift, -0.5, 0.5)
    return tops


def _nonzero(mask: Image) -> tuple[IntArray, IntArray]:
    """Rows and columns of what is not 0; rows without any, which are most, cost nothing."""
    full = np.flatnonzero(mask.any(axis=1))
    rows, columns = np.nonzero(mask[full])
    return full[rows], columns
