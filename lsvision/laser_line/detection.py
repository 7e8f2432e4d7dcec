"""Finding the laser line to a pixel, and telling when there is none.

Three things make ridges a laser line: they follow one another from column to column, they are
stripes (the filter's derivative crosses zero at them; it does not at the edge of a board), and
few others in the image are as strong. Measured: a line has stripes in 92-100 % of its columns
and 0.8-3.2 rivals as strong (3.2 among 30 streaks and 80 blobs); daylight photographs have
40-60 % and 8-13.
"""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from lsvision.errors import NoLaserLine
from lsvision.geometry import FloatArray
from lsvision.laser_line.candidates import LineCandidates, find_line_candidates
from lsvision.laser_line.derivative_of_gaussian import locate_by_derivative
from lsvision.laser_line.line_image import Direction, LineImage
from lsvision.laser_line.noise import PixelNoise, estimate_pixel_noise
from lsvision.laser_line.path_search import LinePath, PathSettings, shortest_line_path
from lsvision.laser_line.settings import LineSettings
from lsvision.laser_line.stripe_windows import Stripes, Windows, cut_windows

MAX_SIGMA_DOUBLINGS = 3
"""How often the filter may be widened: to 8 times its sigma."""
MAX_WIDTH_SIGMAS = 1.25
"""Sigmas of the filter beyond which a line asks for a wider one."""
MIN_STRIPE_FRACTION = 0.75
"""Share of a line's columns in which its ridge must be a stripe."""
MAX_RIVAL_RATIO = 4.5
"""Ridges half as strong or stronger, for each of the line's own."""
MIN_LENGTH_RATIO = 0.75
"""Share of the narrowest ridge's length that a wider one must have: a wide laser line leaves a
ridge in the narrow filter, too, along its edge."""
MIN_POINTS = 30
COARSE_HEIGHT_PX = 256
"""px; the image is shrunk to about this height to see which way the line runs."""
COARSE_CANDIDATES = 6
SECOND_LINE_MIN_SIGMAS = 4.0
"""Sigmas between a line and another one beside it."""


@dataclass(frozen=True, eq=False)
class DetectedLine:
    """A laser line, to a fraction of a pixel by the derivative filter.

    Parameters
    ----------
    windows : Windows
        Pixels around it.
    stripes : Stripes
        One for each window.
    variances : (n, w) ndarray
        Read and shot noise of the windows' pixels. Units: DN^2.
    sigma : float
        Of the filter that suits its width. Units: px.
    second_line_fraction : float
        Share of the image's columns in which a second, shorter line runs beside it.
    """

    windows: Windows
    stripes: Stripes
    variances: FloatArray
    sigma: float
    second_line_fraction: float


def find_direction(image: LineImage, settings: LineSettings) -> Direction:
    """Whether the line has one point in each column or in each row.

    Looks for a line both ways in the shrunk image and compares their lengths, each weighed by
    its share of the ridges as strong as itself.
    """
    shrink = max(1, round(min(image.signal.shape) / COARSE_HEIGHT_PX))
    height, width = (max(1, length // shrink) for length in image.signal.shape)
    small = cv2.resize(image.signal, (width, height), interpolation=cv2.INTER_AREA)
    restart = settings.path.restart_cost / shrink
    path = replace(
        settings.path, restart_cost=restart, max_missing_columns=1, candidates=COARSE_CANDIDATES
    )
    sigma = max(1.0, settings.sigma / shrink)
    least = settings.min_contrast * image.full_scale
    level, upright = (
        find_line_candidates(signal, sigma, least, path.candidates)
        for signal in (small, np.ascontiguousarray(small.T))
    )
    worth = _line_score(level, path)
    # No line is longer than there are columns with candidates.
    if worth >= len(np.unique(upright.columns)) ** 2:
        return "columns"
    return "columns" if worth >= _line_score(upright, path) else "rows"


def _line_score(candidates: LineCandidates, settings: PathSettings) -> float:
    """Length of the line squared, over its rivals. Units: px^2."""
    path = shortest_line_path(candidates, settings)
    return path.cost_reduction**2 / max(_rival_ratio(candidates, path), 1.0)


def find_line(image: LineImage, settings: LineSettings) -> DetectedLine:
    """Follow the laser line from left to right, with a filter as wide as it needs.

    Parameters
    ----------
    image : LineImage
        With the line from left to right.
    settings : LineSettings
        Of `extract_laser_line`.

    Returns
    -------
    DetectedLine
        Ordered by column.

    Raises
    ------
    NoLaserLine
        If no width of the filter finds one; says what comes nearest.
    """
    refusals: list[str] = []
    longest = 0
    for doubling in range(MAX_SIGMA_DOUBLINGS + 1):
        sigma = settings.sigma * 2**doubling
        if math.ceil(3 * sigma) * 4 > image.signal.shape[0]:
            break
        least = settings.min_contrast * image.full_scale
        candidates = find_line_candidates(image.signal, sigma, least, settings.path.candidates)
        path = shortest_line_path(candidates, settings.path)
        if len(path.indices) < MIN_POINTS:
            refusals.append(f"{len(path.indices)} columns hold a ridge that goes on in the next")
            continue
        line = _measured(image, candidates.select(path.indices), sigma, settings)
        longest = max(longest, len(path.indices))
        refusal = _rejection_reason(line, longest, _rival_ratio(candidates, path))
        wide = float(np.nanmedian(line.stripes.sigmas)) if line.stripes.found.any() else np.inf
        if not refusal and wide <= MAX_WIDTH_SIGMAS * sigma:
            return replace(
                line, second_line_fraction=_second_line(candidates, path, sigma, settings)
            )
        refusals.append(refusal or f"the ridge is {wide:.0f} px wide (one sigma), a band of light")
    height, width = image.signal.shape
    if not refusals:
        raise NoLaserLine(
            f"the image is {height} px across the laser line and needs "
            f"{4 * math.ceil(3 * settings.sigma)} px: take a taller part of it, or give a smaller "
            "sigma"
        )
    raise NoLaserLine(
        f"no laser line runs through the {width} x {height} px: {refusals[0]}; darken the room or "
        "give a laser_off frame, expose until the line stands out, set channel to the laser's "
        "colour, or min_contrast lower for a dim line"
    )


def pixel_noise(image: LineImage, windows: Windows, settings: LineSettings) -> PixelNoise:
    """Noise of the image's pixels as the settings give it, estimated where they do not."""
    given = settings.read_noise, settings.gain
    if given[0] is not None and given[1] is not None:
        return PixelNoise(given[0] ** 2, given[1])
    estimated = estimate_pixel_noise(image.signal, windows)
    return PixelNoise(
        estimated.read_variance if given[0] is None else given[0] ** 2,
        estimated.gain if given[1] is None else given[1],
    )


def _measured(
    image: LineImage, ridge: LineCandidates, sigma: float, settings: LineSettings
) -> DetectedLine:
    windows = cut_windows(image, image.signal, ridge.columns, ridge.rows, sigma)
    variances = pixel_noise(image, windows, settings).variances(windows.values)
    stripes = locate_by_derivative(windows, ridge.rows, variances, sigma)
    return DetectedLine(windows, stripes, variances, sigma, 0.0)


def _rival_ratio(candidates: LineCandidates, path: LinePath) -> float:
    """Candidates half as strong as the line's or stronger, for each of the line's own."""
    if not len(path.indices):
        return math.inf
    strong = candidates.scores > 0.5 * np.median(candidates.scores[path.indices])
    return float(strong.sum() / len(path.indices))


def _rejection_reason(line: DetectedLine, longest: int, rivals: float) -> str:
    """Why this is no laser line; empty if it is one."""
    share = float(line.stripes.found.mean())
    if share < MIN_STRIPE_FRACTION:
        return (
            f"only {share:.0%} of the {len(line.stripes.found)} columns of the longest ridge are "
            f"stripes and {MIN_STRIPE_FRACTION:.0%} are needed (edges and textures are none)"
        )
    if len(line.stripes.found) < MIN_LENGTH_RATIO * longest:
        return (
            f"the widened line has {len(line.stripes.found)} columns of the {longest} that a "
            f"narrower one has, and needs {MIN_LENGTH_RATIO:.0%}"
        )
    if rivals > MAX_RIVAL_RATIO:
        return (
            f"{rivals:.1f} ridges in the image are as strong for each of the "
            f"{len(line.stripes.found)} of the longest, {MAX_RIVAL_RATIO:g} at most in a line's "
            "image"
        )
    return ""


def _second_line(
    candidates: LineCandidates, path: LinePath, sigma: float, settings: LineSettings
) -> float:
    """Share of the columns in which another line could be followed beside the one chosen."""
    width = candidates.shape[1]
    line = np.full(width, np.inf)
    line[candidates.columns[path.indices]] = candidates.rows[path.indices]
    apart = np.abs(candidates.rows - line[candidates.columns]) > SECOND_LINE_MIN_SIGMAS * sigma
    strong = candidates.scores > 0.5 * np.median(candidates.scores[path.indices])
    others = candidates.select(apart & strong)
    if len(others) < settings.path.restart_cost:
        return 0.0
    return len(shortest_line_path(others, settings.path).indices) / width
