"""Candidates for a laser line in each column: local maxima of a matched filter."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from lsvision.geometry import FloatArray, IntArray
from lsvision.laser_line.image_array import Image
from lsvision.statistics.robust import MAD_TO_STD, mad_std

KERNEL_HALF_WIDTH_SIGMAS = 3.0
"""Half width of the matched filter in its sigmas: the stripe has 0.3 % of its light beyond."""
RESPONSE_PER_DN = 32
"""Response of the integer filter to a stripe of 1 DN (digital number, grey level) in an 8-bit
image. The positive weights of a kernel sum up to 1.3 at most: no response is above 1.3 * 255 of
these units, a third of the range of int16."""
DETECTION_SIGMAS = 4.5
"""Height of a candidate in standard deviations of the filtered image; noise exceeds it in about
three of 10^6 pixels."""
NOISE_SAMPLE_STEP = 7
"""Step between the rows and columns from which the noise is estimated; prime, so that no regular
pattern falls on them alone."""
PART_PIXELS = 1 << 18
"""Number of pixels that are compared with the threshold at a time: their mask of 256 KB stays in
the processor's cache."""


@dataclass(frozen=True, eq=False)
class LineCandidates:
    """Candidates for points of a line, ordered by column, then row.

    Parameters
    ----------
    columns : (n,) ndarray of int
        Column of each candidate. Units: px.
    rows : (n,) ndarray
        Vertex of the parabola through the maximum and its two neighbours. Units: px.
    scores : (n,) ndarray
        Height of the Gaussian stripe, of the filter's sigma, with the same response. Units: DN.
    threshold : float
        Smallest score of a candidate. Units: DN.
    shape : tuple of int
        ``(height, width)`` of the image. Units: px.
    """

    columns: IntArray
    rows: FloatArray
    scores: FloatArray
    threshold: float
    shape: tuple[int, int]

    def __len__(self) -> int:
        return len(self.columns)

    def select(self, which: np.ndarray) -> "LineCandidates":
        """Return the candidates of an index array or a mask, in its order."""
        return LineCandidates(
            self.columns[which], self.rows[which], self.scores[which], self.threshold, self.shape
        )


def build_matched_kernel(sigma: float) -> FloatArray:
    """Return a zero-mean Gaussian kernel whose response to its own stripe of height 1 is 1.

    `sigma` is the standard deviation of stripe and kernel. Units: px.
    """
    half_width = math.ceil(KERNEL_HALF_WIDTH_SIGMAS * sigma)
    stripe = np.exp(-0.5 * (np.arange(-half_width, half_width + 1) / sigma) ** 2)
    kernel = stripe - stripe.mean()
    normalised: FloatArray = kernel / (kernel @ stripe)
    return normalised


def find_line_candidates(
    signal: Image, sigma: float, min_score: float, per_column: int
) -> LineCandidates:
    """Find the local maxima of the matched-filtered image in each column.

    `signal` (height, width) is uint8, uint16, int16 or float32, in DN; `sigma` is that of the
    matched filter, in px. The noise of the image may raise the smallest score `min_score` of a
    candidate, in DN. Of each column the `per_column` candidates with the highest scores are
    returned.
    """
    response, unit = _apply_matched_filter(signal, sigma)
    sample = response[::NOISE_SAMPLE_STEP, ::NOISE_SAMPLE_STEP]
    threshold = max(min_score * unit, DETECTION_SIGMAS * _estimate_noise_std(sample))
    columns, rows = _find_maxima(response, threshold, max(1, round(sigma)))
    scores = response[rows, columns].astype(np.float64) / unit
    kept = _select_highest_of_each_column(columns, scores, per_column)
    columns, rows, scores = columns[kept], rows[kept], scores[kept]
    shape = (signal.shape[0], signal.shape[1])
    peaks = _locate_subpixel_peaks(response, columns, rows)
    return LineCandidates(columns, peaks, scores, threshold / unit, shape)


def _estimate_noise_std(sample: Image) -> float:
    """Return the robust standard deviation of responses about zero; whole numbers are counted.

    Counting takes a quarter of the time of partitioning, and yields the same median.
    """
    if sample.dtype.kind != "i":
        return mad_std(sample)
    up_to = np.bincount(np.abs(sample.ravel())).cumsum()
    middle = (sample.size - 1) // 2, sample.size // 2
    return MAD_TO_STD * float(np.searchsorted(up_to, middle, side="right").mean())


def _find_maxima(response: Image, threshold: float, radius: int) -> tuple[IntArray, IntArray]:
    """Return columns and rows of the maxima above a threshold down each column.

    No array of the image's size is created beside the response. With two or three of them the
    memory allocator returns the memory to the system after each call, and requesting it again takes
    as much time as half of an extraction.
    """
    height, width = response.shape
    values = response.ravel()
    # Whole numbers are compared with a whole number: ten times as fast, and the same.
    limit = math.floor(threshold) if response.dtype.kind == "i" else threshold
    parts = range(0, len(values), PART_PIXELS)
    peaks = np.concatenate([np.flatnonzero(values[k : k + PART_PIXELS] > limit) + k for k in parts])
    heights = values.take(peaks)
    for step in range(1, radius + 1):
        for shift in (-step * width, step * width):
            neighbours = peaks + shift
            # Beyond the border the pixel at the border; `peaks` are ordered.
            start, stop = np.searchsorted(neighbours, (0, len(values)))
            neighbours[:start] %= width
            neighbours[stop:] = neighbours[stop:] % width + (height - 1) * width
            kept = np.flatnonzero(heights >= values.take(neighbours))
            peaks, heights = peaks.take(kept), heights.take(kept)
    rows = peaks // width
    by_column = np.sort((peaks - rows * width) * height + rows, kind="stable")
    columns = by_column // height
    return columns, by_column - columns * height


def _select_highest_of_each_column(
    columns: IntArray, scores: FloatArray, max_count: int
) -> IntArray | slice:
    """Return the indices of the highest-scoring candidates of each column, in ascending order."""
    crowded = np.bincount(columns, minlength=1) > max_count
    if not crowded.any():
        return slice(None)
    kept = ~crowded[columns]
    others = np.flatnonzero(~kept)
    order = others[np.lexsort((-scores[others], columns[others]))]
    rank = np.arange(len(others)) - np.searchsorted(columns[others], columns[others])
    kept[order[rank < max_count]] = True
    return np.flatnonzero(kept)


def _apply_matched_filter(signal: Image, sigma: float) -> tuple[Image, float]:
    """Return the response of the matched filter, and its value for a stripe of 1 DN.

    The response is int16 for an 8-bit image, which takes half the memory, otherwise float32.
    """
    kernel, identity = build_matched_kernel(sigma).astype(np.float32), np.ones(1, np.float32)
    if signal.dtype == np.uint8:
        return cv2.sepFilter2D(
            signal, cv2.CV_16S, identity, kernel * RESPONSE_PER_DN
        ), RESPONSE_PER_DN
    return cv2.sepFilter2D(signal, cv2.CV_32F, identity, kernel), 1.0


def _locate_subpixel_peaks(response: Image, columns: IntArray, rows: IntArray) -> FloatArray:
    """Return the rows (n,) of the vertices of the parabolas through maxima and their neighbours.

    At the border of the image, and in a plateau, the row of the maximum itself or half a pixel from
    it.
    """
    above, below = np.maximum(rows - 1, 0), np.minimum(rows + 1, len(response) - 1)
    before, at, after = (response[row, columns].astype(np.float64) for row in (above, rows, below))
    curvature = 2 * at - before - after
    curved = curvature > 0
    shift = np.where(curved, 0.5 * (after - before) / np.where(curved, curvature, 1.0), 0.0)
    peaks: FloatArray = rows + np.clip(shift, -0.5, 0.5)
    return peaks
