"""Detection of the laser line in an image, or of its absence.

Ridges are a laser line if they are connected from column to column, are stripes (the derivative
of the filter response crosses zero at them, which it does not at the edge of a board), and the
image has few other ridges that are as strong. Measured: a line has stripes in 92-100 % of its
columns, and the image has 0.8-3.2 strong ridges for each column of the line (3.2 among 30 streaks
and 80 blobs); for the longest ridge of daylight photographs these are 40-60 % and 8-13.
"""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from lsvision.errors import NoLaserLine
from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.laser_line.candidates import (
    KERNEL_HALF_WIDTH_SIGMAS,
    LineCandidates,
    find_line_candidates,
)
from lsvision.laser_line.image_array import Image
from lsvision.laser_line.jpeg_blocks import JpegBlocks, find_jpeg_blocks
from lsvision.laser_line.line_image import Direction, LineImage
from lsvision.laser_line.noise import ROUNDING_VARIANCE, PixelNoise, estimate_pixel_noise
from lsvision.laser_line.path_search import LinePath, PathSettings, find_shortest_line_path
from lsvision.laser_line.settings import LineSettings
from lsvision.laser_line.stripe_windows import Stripes, Windows, cut_windows
from lsvision.laser_line.subpixel import locate_by_derivative
from lsvision.statistics.robust import median

MAX_SIGMA_DOUBLINGS = 3
"""Largest number of times that the sigma of the filter is doubled: to 8 times its value."""
MAX_WIDTH_SIGMAS = 1.32
"""Width of a line over sigma of the filter above which the sigma is doubled, to at most 1.5 times
the width, up to which the filter is precise."""
MIN_STRIPE_FRACTION = 0.75
"""Smallest fraction of a line's columns in which its ridge is a stripe."""
MAX_STRONG_RIDGE_RATIO = 4.5
"""Largest number of strong ridges in the image (`MIN_STRONG_SCORE_RATIO`) over those of the line;
measured values are at the top of this module."""
MIN_LENGTH_RATIO = 0.75
"""Smallest ratio of a line's length to the longest ridge that narrower filters found: these also
find ridges along the edges of a wide laser line."""
MIN_LINE_COLUMNS = 30
"""Smallest number of columns of a line. With the default costs of `PathSettings` no shorter segment
than 32 columns is found; the limit counts where these costs are lower."""
COARSE_SIDE_PX = 256
"""Length to which the shorter side of an image is about shrunk to find the direction of its line.
Units: px."""
COARSE_CANDIDATES = 6
"""Largest number of candidates in each column of the shrunk image: half of those in the image, for
the direction alone."""
MIN_STRONG_SCORE_RATIO = 0.5
"""Score over the median score of the line, above which a ridge counts as strong."""
MIN_SECOND_LINE_SIGMAS = 4.0
"""Smallest distance of a second line from the first, in sigmas of the filter: nearer maxima belong
to the same stripe."""
MIN_HEIGHT_KERNELS = 2
"""Smallest height of an image, in widths of the matched filter: half of the image is background."""


@dataclass(frozen=True, eq=False)
class DetectedLine:
    """A laser line, located to a fraction of a pixel by the derivative of Gaussian.

    Parameters
    ----------
    windows : Windows
        Windows around the line, one for each of n columns, ordered by column.
    stripes : Stripes
        Stripes, one for each window; NaN where it has none.
    variances : (n, w) ndarray
        Read and shot noise of the windows' pixels, with the errors of the rounding if `blocks` are
        given. Units: DN^2.
    sigma : float
        Standard deviation of the filter that suits its width. Units: px.
    second_line_fraction : float
        Fraction of the image's columns in which a second, shorter line runs beside it.
    blocks : JpegBlocks, optional
        Blocks of an image that was a JPEG image.
    """

    windows: Windows
    stripes: Stripes
    variances: FloatArray
    sigma: float
    second_line_fraction: float
    blocks: JpegBlocks | None = None

    def select(self, which: BoolArray) -> "DetectedLine":
        """Return the columns of a mask (n,)."""
        return replace(
            self,
            windows=self.windows.select(which),
            stripes=self.stripes.select(which),
            variances=self.variances[which],
        )

    def replace_columns(self, other: "DetectedLine", which: BoolArray) -> "DetectedLine":
        """Return the line with the columns of a mask (n,) from another line of the same columns.

        `sigma` and `second_line_fraction` are those of the other line.
        """
        return replace(
            other,
            blocks=self.blocks,
            windows=self.windows.replace_columns(other.windows, which),
            stripes=self.stripes.replace_at(np.flatnonzero(which), other.stripes.select(which)),
            variances=np.where(which[:, None], other.variances, self.variances),
        )


def find_direction(image: LineImage, settings: LineSettings) -> Direction:
    """Decide whether the line has one point in each column or one in each row.

    A line is searched in both directions of the shrunk image, which is in its original orientation.
    The direction with the larger score is chosen: squared length of the line over its ratio of
    strong ridges (`_compute_strong_ridge_ratio`).
    """
    if settings.sigma > max(image.signal.shape):
        raise _build_no_line_error(
            image, [], settings
        )  # such a filter would be computed for minutes
    shrink = max(1, round(min(image.signal.shape) / COARSE_SIDE_PX))
    small = _shrink(image.signal, shrink)
    # The cost of a restart is about the number of columns of the shortest segment.
    path = replace(
        settings.path,
        restart_cost=settings.path.restart_cost / shrink,
        max_missing_columns=1,
        candidates=COARSE_CANDIDATES,
    )
    sigma = max(1.0, settings.sigma / shrink)
    min_score = settings.min_contrast * image.full_scale
    by_column = find_line_candidates(small, sigma, min_score, path.candidates)
    score = _score_line(by_column, path)
    # An upright line is not longer than the image is high, nor than the number of rows with
    # candidates.
    if score >= len(small) ** 2:
        return "columns"
    by_row = find_line_candidates(cv2.transpose(small), sigma, min_score, path.candidates)
    if score >= len(np.unique(by_row.columns)) ** 2:
        return "columns"
    return "columns" if score >= _score_line(by_row, path) else "rows"


def _shrink(image: Image, factor: int) -> Image:
    """Return an image downsampled by a whole number; OpenCV is fastest at halving."""
    while factor > 1:
        step = 2 if factor % 2 == 0 else factor
        height, width = (max(1, length // step) for length in image.shape)
        image = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
        factor //= step
    return image


def _score_line(candidates: LineCandidates, settings: PathSettings) -> float:
    """Return the squared length of the line (px^2) over its ratio of strong ridges, if above 1."""
    path = find_shortest_line_path(candidates, settings)
    return path.cost_reduction**2 / max(_compute_strong_ridge_ratio(candidates, path), 1.0)


def find_line(image: LineImage, settings: LineSettings) -> DetectedLine:
    """Find the laser line from left to right, with a filter that is widened to the line's width.

    Raises
    ------
    NoLaserLine
        If no width of the filter yields a line; the reason is that of the narrowest filter.
    """
    reasons: list[str] = []
    longest, min_score = 0, settings.min_contrast * image.full_scale
    for doubling in range(MAX_SIGMA_DOUBLINGS + 1):
        sigma = settings.sigma * 2**doubling
        if _compute_min_height(sigma) > image.signal.shape[0]:
            break
        candidates = find_line_candidates(image.signal, sigma, min_score, settings.path.candidates)
        path = find_shortest_line_path(candidates, settings.path)
        if len(path.indices) < MIN_LINE_COLUMNS:
            reasons.append(
                f"{len(path.indices)} columns contain a ridge that continues in the next, and "
                f"{MIN_LINE_COLUMNS} are needed"
            )
            continue
        ridge = candidates.select(path.indices)
        line = locate_line(image, ridge.columns, ridge.rows, sigma, settings)
        longest = max(longest, len(path.indices))
        reason = _find_rejection_reason(
            line, longest, _compute_strong_ridge_ratio(candidates, path)
        )
        widths = line.stripes.widths
        width = median(widths[~np.isnan(widths)]) if line.stripes.found.any() else np.inf
        if reason is None and width <= MAX_WIDTH_SIGMAS * sigma:
            second = _find_second_line_fraction(candidates, path, sigma, settings)
            return replace(add_rounding_errors(image, line), second_line_fraction=second)
        reasons.append(reason or f"the ridge is {width:.0f} px wide (one sigma), a band of light")
    raise _build_no_line_error(image, reasons, settings)


def _compute_min_height(sigma: float) -> int:
    """Return the smallest height of an image for a matched filter of sigma px. Units: px."""
    return MIN_HEIGHT_KERNELS * 2 * math.ceil(KERNEL_HALF_WIDTH_SIGMAS * sigma)


def _build_no_line_error(
    image: LineImage, reasons: list[str], settings: LineSettings
) -> NoLaserLine:
    """Return the error for an image in which no filter found a line, with the first reason."""
    rows, columns = image.signal.shape
    if not reasons:
        needed = _compute_min_height(settings.sigma)
        return NoLaserLine(
            f"the image is {rows} px across the laser line and needs {needed} px for a filter "
            f"of sigma {settings.sigma:g} px: use a larger region of the camera image, or a "
            "smaller sigma"
        )
    return NoLaserLine(
        f"no laser line runs through the {columns} x {rows} px: {reasons[0]}",
        "darken the room or give a laser_off frame, expose longer until the line is bright, set "
        "channel to the laser's colour, or lower min_contrast for a dim line",
    )


def choose_pixel_noise(image: LineImage, windows: Windows, settings: LineSettings) -> PixelNoise:
    """Return the noise of the pixels from the settings; values that they lack are estimated.

    The estimate is that from the windows around a line from left to right.
    """
    read_noise, gain = settings.read_noise, settings.gain
    rounding_variance = ROUNDING_VARIANCE * image.value_step**2
    if read_noise is not None and gain is not None:
        return PixelNoise(read_noise**2, gain, rounding_variance)
    estimated = estimate_pixel_noise(image, windows, rounding_variance)
    return PixelNoise(
        estimated.read_variance if read_noise is None else read_noise**2,
        estimated.gain if gain is None else gain,
        rounding_variance,
    )


def locate_line(
    image: LineImage, columns: IntArray, rows: FloatArray, sigma: float, settings: LineSettings
) -> DetectedLine:
    """Locate a line from left to right in windows around its coarse positions, in px.

    `columns` and `rows` (n,) have one for each column, `sigma` is that of the filter. Of the result
    `second_line_fraction` is 0 and `blocks` None.
    """
    windows = cut_windows(image, image.signal, columns, rows, sigma)
    variances = choose_pixel_noise(image, windows, settings).compute_variances(windows.values)
    stripes = locate_by_derivative(windows, rows, variances, sigma)
    return DetectedLine(windows, stripes, variances, sigma, 0.0)


def add_rounding_errors(image: LineImage, line: DetectedLine) -> DetectedLine:
    """Add the errors of a JPEG image's coefficients to the noise of a line's pixels and its stds.

    The line, from left to right, is located in the image's signal; it is returned as given where
    the image never was a JPEG image.
    """
    signal, windows, step = image.signal, line.windows, image.value_step
    if step < 1:  # a float image: scaled to 8-bit grey levels, the unit of a JPEG file's steps
        signal, windows = signal / step, replace(windows, values=windows.values / step)
    blocks = find_jpeg_blocks(signal, windows)
    if blocks is None:
        return line
    added = step**2 * blocks.compute_row_variances(signal, windows, line.sigma)
    variances = line.variances + added[:, None]
    found = line.stripes.found
    start = np.where(found, line.stripes.pixels[:, 1], line.windows.centre_rows)
    std = locate_by_derivative(line.windows, start, variances, line.sigma).std
    stripes = replace(line.stripes, std=np.where(found & np.isfinite(std), std, line.stripes.std))
    return replace(line, variances=variances, stripes=stripes, blocks=blocks)


def _compute_strong_ridge_ratio(candidates: LineCandidates, path: LinePath) -> float:
    """Return the number of strong candidates in the image over that of the line's candidates.

    Infinite if there is no line.
    """
    if not len(path.indices):
        return math.inf
    strong = candidates.scores > MIN_STRONG_SCORE_RATIO * median(candidates.scores[path.indices])
    return float(strong.sum() / len(path.indices))


def _find_rejection_reason(
    line: DetectedLine, longest: int, strong_ridge_ratio: float
) -> str | None:
    """Return why a ridge is not a laser line, or None if it is one."""
    stripe_fraction = float(line.stripes.found.mean())
    if stripe_fraction < MIN_STRIPE_FRACTION:
        return (
            f"only {stripe_fraction:.0%} of the {len(line.stripes.found)} columns of the longest "
            f"ridge are stripes and {MIN_STRIPE_FRACTION:.0%} are needed (edges and textures are "
            "no stripes)"
        )
    if len(line.stripes.found) < MIN_LENGTH_RATIO * longest:
        return (
            f"a wider filter finds a line in {len(line.stripes.found)} of the {longest} columns in "
            f"which a narrower one does, and {MIN_LENGTH_RATIO:.0%} are needed"
        )
    if strong_ridge_ratio > MAX_STRONG_RIDGE_RATIO:
        return (
            f"the image has {strong_ridge_ratio:.1f} strong ridges for each of the "
            f"{len(line.stripes.found)} columns of the longest one, an image with a laser line at "
            f"most {MAX_STRONG_RIDGE_RATIO:g}"
        )
    return None


def _find_second_line_fraction(
    candidates: LineCandidates, path: LinePath, sigma: float, settings: LineSettings
) -> float:
    """Return the fraction of columns in which a second line is found beside the first."""
    width = candidates.shape[1]
    line_rows = np.full(width, np.inf)
    line_rows[candidates.columns[path.indices]] = candidates.rows[path.indices]
    apart = np.abs(candidates.rows - line_rows[candidates.columns]) > MIN_SECOND_LINE_SIGMAS * sigma
    strong = candidates.scores > MIN_STRONG_SCORE_RATIO * median(candidates.scores[path.indices])
    others = candidates.select(apart & strong)
    # So few candidates do not outweigh the cost of a segment.
    if len(others) * settings.path.empty_column_cost < settings.path.restart_cost:
        return 0.0
    return len(find_shortest_line_path(others, settings.path).indices) / width
