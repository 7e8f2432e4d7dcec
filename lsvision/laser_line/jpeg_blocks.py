"""Blocks of a JPEG image, recognised by the pixels around a laser line, and their rounding errors.

JPEG transforms each block of 8 x 8 px to 64 frequencies (DCT) and rounds each coefficient to a
multiple of its quantisation step. In a decoded image, whatever file it was saved in since, the
coefficients of the blocks at their original positions (the grid) are still multiples of these
steps, up to the rounding of pixels to whole numbers, and many of high frequency are zero; for a
shifted grid neither is the case.
An image that was scaled or turned by another angle than 90 deg after it was decoded has no such
grid.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from lsvision.geometry import FloatArray, IntArray
from lsvision.geometry.arrays import TINY
from lsvision.laser_line.image_array import Image
from lsvision.laser_line.stripe_windows import Windows
from lsvision.statistics.robust import median

BLOCK_PX = 8
"""Width and height of a JPEG image's blocks. Units: px."""
PATCH_PX = 2 * BLOCK_PX - 1
"""Width and height of a patch, which contains a block at each of the 64 grids. Units: px."""
PATCHES = 16
"""Patches along the line by which the grids are compared."""
HIGH_FREQUENCY = 6
"""Frequency along rows or columns from which on most coefficients of a JPEG image are zero."""
MAX_COEFFICIENT_DN = 2.0
"""Size at which coefficients are clipped in a grid's score. Units: DN."""
MAX_SCORE_RATIO, MAX_DISTINCT_SCORE_RATIO = 0.92, 0.6
"""Ratio of the best grid's score to the median score of the grids with the same rows, or the same
columns. From the first value on, the image was never compressed; below the second one, few
multiples are sufficient evidence (along a horizontal or vertical line all blocks are alike).
Measured: 0.28 to 0.9 in JPEG images of a quality of 60 to 95, mostly below 0.7; otherwise 0.93 and
more with noise, 0.86 and more without."""
MIN_EVIDENCE, MIN_DISTINCT_EVIDENCE = 16.0, 4.0
"""Logarithm of the likelihood ratio from which on an image is a JPEG image: in general, and with a
score ratio below `MAX_DISTINCT_SCORE_RATIO`. Measured: 27 to 950 in most JPEG images, 4 to 13 for a
line along the rows of pixels, up to 13 in images that were never compressed, whose score ratio is
larger."""
MIN_STEP_EVIDENCE = 1.0
"""Logarithm of the likelihood ratio of one frequency, from which on its step is known; the steps of
the others follow from `STANDARD_STEPS`."""
MIN_LEVELS = 16
"""Smallest number of grey levels around the line of an image that is compared with multiples: sums
of few levels are multiples by chance."""
MAX_BLOCKS = 64
"""Blocks along the line by which the steps are estimated."""
MIN_VALUES = 3
"""Smallest number of coefficients that are not zero from which a step is estimated."""
ROUNDING_STD = 0.35
"""Standard deviation of a decoded coefficient about its multiple: 0.29 by the rounding of pixels,
0.45 in the luminance of a colour image. Units: DN."""
OUTLIER_FRACTION = 0.15
"""Fraction of the coefficients that are no multiples: pixels of their blocks were clipped."""
MAX_JPEG_LEVEL_DN = 255
"""Largest pixel, and largest step, of a JPEG image. Units: DN."""
STANDARD_STEPS = np.array(
    [
        [16, 11, 12, 15, 21, 32, 50, 66],
        [11, 12, 13, 18, 24, 46, 62, 73],
        [12, 13, 16, 23, 38, 56, 73, 75],
        [15, 18, 23, 29, 53, 75, 83, 80],
        [21, 24, 38, 53, 68, 95, 103, 94],
        [32, 46, 56, 75, 95, 104, 117, 96],
        [50, 62, 73, 83, 103, 117, 120, 102],
        [66, 73, 75, 80, 94, 96, 102, 99],
    ],
    dtype=np.float64,
)
"""Steps of the luminance, in the ratios that most encoders use (ITU-T T.81, table K.1), the mean of
rows and columns."""


COSINES: FloatArray = cv2.dct(np.eye(BLOCK_PX), flags=cv2.DCT_ROWS).T
"""Discrete cosine transform of 8 pixels (frequency, pixel), an orthogonal matrix."""
SHIFTED_COSINES: Image = np.array(
    [np.pad(COSINES, ((0, 0), (shift, PATCH_PX - BLOCK_PX - shift))) for shift in range(BLOCK_PX)],
    dtype=np.float32,
)
"""Transforms (shift, frequency, pixel) of each 8 neighbours among 15 pixels."""


@dataclass(frozen=True, eq=False)
class JpegBlocks:
    """Blocks of a JPEG image, and the error of their coefficients.

    Parameters
    ----------
    row, column : int
        First row and column of the first whole block. Units: px.
    steps : (8, 8) ndarray
        Quantisation step of each frequency, down the columns and along the rows. Units: DN.
    zero_variances : (8, 8) ndarray
        Mean square of the coefficients that were rounded to zero. Units: DN^2.
    """

    row: int
    column: int
    steps: FloatArray
    zero_variances: FloatArray

    def compute_row_variances(self, signal: Image, windows: Windows, sigma: float) -> FloatArray:
        """Return the variance of independent pixel errors with the same effect as the rounding.

        One for all pixels of each of n windows, (n,), in DN^2. The effect is the standard deviation
        of the line that the derivative of Gaussian of `sigma` px locates in the `signal` of the
        laser.
        """
        tops = _find_block_start(windows.centre_rows, self.row)
        lefts = _find_block_start(windows.columns, self.column)
        # Row and column of a window's central pixel in its block.
        rows, columns = windows.centre_rows - tops, windows.columns - lefts
        max_step = math.ceil(windows.offsets[-1] / BLOCK_PX)
        variances = np.zeros(len(tops))
        for step in range(-max_step, max_step + 1):
            gains = _compute_filter_gains(windows.offsets, sigma, step)
            of_blocks, index = self._find_coefficient_variances(
                signal, tops + step * BLOCK_PX, lefts
            )
            by_column = of_blocks @ COSINES**2
            variances += (gains[rows] * by_column[index, :, columns]).sum(axis=1)
        return variances

    def _find_coefficient_variances(
        self, signal: Image, tops: IntArray, lefts: IntArray
    ) -> tuple[FloatArray, IntArray]:
        """Return the error variances (m, 8, 8) of m blocks, and the index (n,) of each window's.

        Beyond the border of the image the nearest whole block is used.
        """
        height, width = signal.shape
        last_top = _find_block_start(np.array(height - BLOCK_PX), self.row)
        last_left = _find_block_start(np.array(width - BLOCK_PX), self.column)
        tops = np.clip(tops, self.row, last_top)
        lefts = np.clip(lefts, self.column, last_left)
        first_pixels, index = np.unique(tops * width + lefts, return_inverse=True)
        zero = np.abs(_transform_blocks(signal, first_pixels)) < self.steps / 2
        return np.where(zero, self.zero_variances, self.steps**2 / 12), index


def _find_block_start(pixels: IntArray, start: int) -> IntArray:
    """Return the first row (or column) of the blocks that contain rows, one of which is `start`."""
    return (pixels - start) // BLOCK_PX * BLOCK_PX + start


def find_jpeg_blocks(signal: Image, windows: Windows) -> JpegBlocks | None:
    """Find the blocks of an image that was a JPEG image, whatever file it comes from.

    They are found by the pixels in windows around the line of its signal (height, width), in DN.
    None for an image that was never a JPEG image, was one of so high a quality that the rounding is
    negligible, or has more than 8 bit.
    """
    if np.abs(windows.values).max() > MAX_JPEG_LEVEL_DN:
        return None
    row, column, score_ratio = _find_grid(signal, windows)
    if score_ratio >= MAX_SCORE_RATIO or len(np.unique(windows.values[::BLOCK_PX])) < MIN_LEVELS:
        return None
    coefficients = _transform_blocks_along_line(signal, windows, row, column)
    steps, evidence = _estimate_steps(coefficients)
    distinct = score_ratio < MAX_DISTINCT_SCORE_RATIO
    known = evidence > MIN_STEP_EVIDENCE
    if evidence.sum() < (MIN_DISTINCT_EVIDENCE if distinct else MIN_EVIDENCE) or not known.any():
        return None
    scale = median((steps / STANDARD_STEPS)[known])
    steps = np.where(known, steps, np.maximum(scale * STANDARD_STEPS, 1.0))
    return JpegBlocks(row, column, steps, _estimate_zero_variances(coefficients, steps))


def _find_grid(signal: Image, windows: Windows) -> tuple[int, int, float]:
    """Return row and column of the best grid, and the ratio of its score to those beside it."""
    scores = _score_grids(signal, windows)
    row, column = divmod(int(scores.argmin()), BLOCK_PX)
    beside = min(median(scores[row]), median(scores[:, column]))
    return row, column, float(scores[row, column]) / max(beside, TINY)


def _score_grids(signal: Image, windows: Windows) -> FloatArray:
    """Return the sum of the sizes of coefficients of high frequency for each grid (row, column)."""
    height, width = signal.shape
    rows, columns = windows.centre_rows, windows.columns
    inside = (rows >= BLOCK_PX - 1) & (rows <= height - BLOCK_PX)
    inside &= (columns >= BLOCK_PX - 1) & (columns <= width - BLOCK_PX)
    chosen = np.flatnonzero(inside)
    if not len(chosen):
        return np.ones((BLOCK_PX, BLOCK_PX))
    chosen = chosen[np.linspace(0, len(chosen) - 1, PATCHES).astype(np.int64)]
    tops, lefts = rows[chosen] - (BLOCK_PX - 1), columns[chosen] - (BLOCK_PX - 1)
    patches = _cut_squares(signal, tops * width + lefts, PATCH_PX).astype(np.float32)
    every = SHIFTED_COSINES.reshape(-1, PATCH_PX)
    high = SHIFTED_COSINES[:, HIGH_FREQUENCY:].reshape(-1, PATCH_PX)
    low = SHIFTED_COSINES[:, :HIGH_FREQUENCY].reshape(-1, PATCH_PX)
    sizes = _sum_sizes_by_shift(high @ patches @ every.T) + _sum_sizes_by_shift(
        low @ patches @ high.T
    )
    shifts = np.arange(BLOCK_PX)
    grid_rows = (tops[:, None] + shifts) % BLOCK_PX
    grid_columns = (lefts[:, None] + shifts) % BLOCK_PX
    grids = grid_rows[:, :, None] * BLOCK_PX + grid_columns[:, None, :]
    scores = np.bincount(grids.ravel(), sizes.ravel(), BLOCK_PX * BLOCK_PX).astype(np.float64)
    return scores.reshape(BLOCK_PX, BLOCK_PX)


def _sum_sizes_by_shift(coefficients: Image) -> Image:
    """Return the sums (n, 8, 8) of sizes by the shifts of rows and columns, clipped."""
    sizes = np.minimum(np.abs(coefficients), MAX_COEFFICIENT_DN)
    count, rows, columns = sizes.shape
    by_row = sizes.reshape(count, BLOCK_PX, rows // BLOCK_PX, columns).sum(axis=2)
    sums: Image = by_row.reshape(count, BLOCK_PX, BLOCK_PX, columns // BLOCK_PX).sum(axis=3)
    return sums


def _cut_squares(signal: Image, first_pixels: IntArray, size: int) -> Image:
    """Return squares (n, size, size) of an image by the index of their first pixels."""
    steps = np.arange(size)
    within = steps[:, None] * signal.shape[1] + steps
    squares: Image = signal.ravel().take(first_pixels[:, None, None] + within)
    return squares


def _transform_blocks(signal: Image, first_pixels: IntArray) -> FloatArray:
    """Return the cosine transform (n, 8, 8) of blocks by the index of their first pixels."""
    return COSINES @ _cut_squares(signal, first_pixels, BLOCK_PX) @ COSINES.T


def _transform_blocks_along_line(
    signal: Image, windows: Windows, row: int, column: int
) -> FloatArray:
    """Return the coefficients (n, 8, 8) of the blocks that contain the line."""
    height, width = signal.shape
    tops = _find_block_start(windows.centre_rows, row)
    lefts = _find_block_start(windows.columns, column)
    whole = (tops >= 0) & (tops <= height - BLOCK_PX) & (lefts >= 0) & (lefts <= width - BLOCK_PX)
    first_pixels = np.unique(tops[whole] * width + lefts[whole])
    return _transform_blocks(signal, first_pixels[:: max(1, len(first_pixels) // MAX_BLOCKS)])


def _estimate_steps(coefficients: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the step of each frequency, and the evidence of it, both (8, 8).

    Frequencies 0 and 4 are left out in combination: their coefficients are sums and differences of
    whole numbers, and so multiples of a step in any image of few grey levels.
    """
    ordered = np.sort(coefficients, axis=0)
    steps, evidence = np.ones((BLOCK_PX, BLOCK_PX)), np.zeros((BLOCK_PX, BLOCK_PX))
    for i, j in np.ndindex(BLOCK_PX, BLOCK_PX):
        if i % 4 or j % 4:
            steps[i, j], evidence[i, j] = _estimate_step(ordered[:, i, j])
    return steps, evidence


def _estimate_step(ordered: FloatArray) -> tuple[float, float]:
    """Return the step of which ordered coefficients (n,) are multiples, and the evidence of it.

    The evidence is the logarithm of the likelihood ratio to numbers that are multiples of nothing,
    less that of the number of steps tried. Each multiple counts once: equal blocks would make any
    image one of multiples.
    """
    values = ordered[np.abs(ordered) > 3 * ROUNDING_STD]
    if len(values) < MIN_VALUES:
        return 1.0, 0.0
    # Apart from those of clipped blocks, the smallest coefficient is one step or more.
    outliers = int(OUTLIER_FRACTION * len(values))
    smallest = float(np.partition(np.abs(values), outliers)[outliers])
    tried = np.arange(2.0, min(smallest + 2, MAX_JPEG_LEVEL_DN + 1))
    if not len(tried):
        return 1.0, 0.0
    multiples = np.rint(values / tried[:, None])
    residuals = (values - multiples * tried[:, None]) / ROUNDING_STD
    density = (1 - OUTLIER_FRACTION) / (ROUNDING_STD * np.sqrt(2 * np.pi))
    ratios = np.log(density * tried[:, None] * np.exp(-0.5 * residuals**2) + OUTLIER_FRACTION)
    first = np.ones(multiples.shape, dtype=bool)
    first[:, 1:] = multiples[:, 1:] != multiples[:, :-1]
    starts = np.flatnonzero(first)
    means = np.add.reduceat(ratios.ravel(), starts) / np.diff(starts, append=first.size)
    means[multiples.ravel()[starts] == 0] = 0.0
    evidence = np.bincount(starts // len(values), means, len(tried))
    best = int(evidence.argmax())
    return float(tried[best]), max(float(evidence[best]) - float(np.log(len(tried) + 1)), 0.0)


def _estimate_zero_variances(coefficients: FloatArray, steps: FloatArray) -> FloatArray:
    """Return the mean square (8, 8) of the coefficients that were rounded to zero.

    They are taken to have a Laplace distribution; the fraction that was not rounded to zero gives
    its scale b: exp(-a / b), a half step being a.
    """
    count = len(coefficients)
    limit = steps / 2
    beyond = (np.abs(coefficients) > limit).mean(axis=0)
    beyond = np.clip(beyond, 1 / (count + 1), count / (count + 1))
    scale = -limit / np.log(beyond)
    tail = beyond * (limit**2 + 2 * limit * scale + 2 * scale**2)
    variances: FloatArray = (2 * scale**2 - tail) / (1 - beyond)
    return np.minimum(variances, limit**2 / 3)


def _compute_filter_gains(offsets: IntArray, sigma: float, step: int) -> FloatArray:
    """Return the squared gains (row, frequency) of the derivative filter for the rows of a block.

    The row is that of the central pixel in its own block; the gains are those for the block that
    lies `step` blocks below. The squares of the filter's weights sum up to 1.
    """
    weights = offsets * np.exp(-0.5 * (offsets / sigma) ** 2)
    weights = weights / np.linalg.norm(weights)
    rows = np.arange(BLOCK_PX)[:, None] + offsets - step * BLOCK_PX
    inside = (rows >= 0) & (rows < BLOCK_PX)
    gains: FloatArray = (COSINES[:, np.clip(rows, 0, BLOCK_PX - 1)] * (inside * weights)).sum(
        axis=2
    )
    return gains.T**2
