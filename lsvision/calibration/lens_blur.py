"""Blur of an image by lens and pixel, from the edges between a board's squares.

The laser line is not suitable: its width is that of laser sheet, blur and surface together. A
printed edge has no width of its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from lsvision.calibration.bundle_adjustment_problem import LaserView
from lsvision.calibration.target import Target, TargetView, find_target
from lsvision.errors import CalibrationFailed, LsvisionError
from lsvision.geometry import FloatArray, Points
from lsvision.laser_line.image_array import convert_to_grey
from lsvision.results.number_format import format_value
from lsvision.results.quantities import Record
from lsvision.results.result import Result
from lsvision.statistics.robust import mad_std

ALONG_FRACTION = 0.3
"""Half length of the window along an edge, as a fraction of the edge's length."""
ACROSS_FRACTIONS = (0.25, 0.09)
"""Half widths of the window perpendicular to an edge, as fractions of its length: wide, and narrow
(not reaching the marker in a ChArUco square) where the wide one contains more than the edge."""
MAX_HALF_WIDTH_PX = 8.0
"""Largest half width of the window perpendicular to an edge. Units: px."""
MIN_EDGE_LENGTH_PX = 12.0
"""Smallest length of an edge, corner to corner. Units: px."""
MIN_CONTRAST = 20.0
"""Smallest contrast of the two sides of an edge. Units: DN of 255."""
SATURATION_LEVEL = 250.0
"""Brightness above which a side may be saturated, which sharpens its edge. Units: DN of 255."""
MAX_RELATIVE_RMS = 0.06
"""Largest rms residual of the pixels about a blurred edge, as a fraction of its contrast."""
MIN_EDGES = 20
"""Smallest number of edges in all images."""
MAX_EDGES_PER_IMAGE = 40
"""Largest number of edges in each image."""
MIN_SIGMA_PX = 0.1
"""Smallest sigma; that of a pixel alone is 0.29 px, and sharpening may reduce it. Units: px."""
MAX_SIGMA_FRACTION = 0.4
"""Largest sigma as a fraction of the window's half width: beyond it the brightness is not constant
at the sides of the window."""
SIDE_FRACTION, MIN_SIDE_PIXELS = 0.6, 5
"""Distance from the edge, as a fraction of the window's half width, beyond which pixels give the
brightness of a side, and the smallest number of them."""


@dataclass(frozen=True, eq=False, repr=False)
class LensBlur(Result):
    """Blur of an image perpendicular to edges of one direction.

    Parameters
    ----------
    sigma : float
        Standard deviation of the Gaussian point spread of lens and pixel; median of the edges.
        Units: px.
    std : float
        Standard uncertainty of `sigma`, from the scatter of the edges. Units: px.
    edges : int
        Number of edges.
    """

    sigma: float
    std: float
    edges: int

    def to_dict(self) -> Record:
        """Return the blur with its standard uncertainty, ready for JSON.

        Returns
        -------
        dict
            ``sigma_px``, ``std_px``, ``edges``.

        Examples
        --------
        >>> LensBlur(0.7, 0.02, 40).to_dict()
        {'sigma_px': 0.7, 'std_px': 0.02, 'edges': 40}
        """
        return {"sigma_px": self.sigma, "std_px": self.std, "edges": self.edges}

    def _summarise(self) -> str:
        return f"{format_value(self.sigma, self.std)} px from {self.edges} edges"

    def _list_cells(self) -> list[tuple[str, ...]]:
        row = (format_value(self.sigma, self.std), str(self.edges))
        return [("blur px", "edges"), row]


def measure_lens_blur(
    images: Sequence[npt.ArrayLike], target: Target, along: Literal["u", "v"] = "u"
) -> LensBlur:
    """Measure the blur along one image axis, from images of a board of squares.

    Parameters
    ----------
    images : sequence of images
        Images of the board, evenly lit and not overexposed, at the position of the laser line and
        with the same focus; images without the board are skipped.
    target : Target
        `Chessboard` or `ChArUco`; a circle grid has no straight edges.
    along : {"u", "v"}
        Image axis; "u" for a laser line that runs from left to right, because blur along the
        line biases its position (`correct_line_blur`).

    Returns
    -------
    LensBlur
        Blur, whose `sigma` is ``line_blur_px`` of `LightSection`.

    Raises
    ------
    TypeError, ValueError
        If an item is not an image, or `along` is another string.
    CalibrationFailed
        If fewer than `MIN_EDGES` edges can be measured.

    Notes
    -----
    Between neighbouring corners whose edge is within 45 deg of the normal to `along`, the pixels
    are fitted by low + contrast * Phi((d - d0 - k t) / sigma), with the normal distribution
    function Phi, the distance d from the chord and the position t along it. Sigma includes the
    pixel's own width (1 / sqrt(12) px). It is too small where the camera sharpens its images, too
    large where the print is unsharp, the board was moving, or the focus differs between the light's
    colour and the laser's.

    Examples
    --------
    >>> from lsvision.calibration.target import ChArUco
    >>> from lsvision.io.images import read_image
    >>> image = read_image("calibration/example/boards/board_00.jpg")
    >>> 0.3 < measure_lens_blur([image], ChArUco()).sigma < 2.0
    True
    """
    views: list[TargetView] = []
    board_images: list[npt.ArrayLike] = []
    for image in images:
        try:
            views.append(find_target(image, target))
        except LsvisionError:
            continue
        board_images.append(image)
    return estimate_blur_from_views(board_images, views, along)


def estimate_blur_from_views(
    images: Sequence[npt.ArrayLike],
    views: Sequence[TargetView | LaserView],
    along: Literal["u", "v"],
) -> LensBlur:
    """Return the blur from images and the views of the board in them, one for each image.

    See `measure_lens_blur` for parameters, result and errors.
    """
    if along not in ("u", "v"):
        raise ValueError(f"expected along 'u' or 'v', got {along!r}")
    sigmas = [
        sigma
        for image, view in zip(images, views, strict=True)
        for sigma in _measure_edge_sigmas(image, view, along)
    ]
    if len(sigmas) < MIN_EDGES:
        raise CalibrationFailed(
            f"{len(sigmas)} edges of squares are sharp enough to measure the blur and "
            f"{MIN_EDGES} are needed: use squares of {MIN_EDGE_LENGTH_PX:.0f} px and more, not "
            "overexposed, on a chessboard or ChArUco board"
        )
    median = float(np.median(sigmas))
    scatter = mad_std(np.array(sigmas) - median)
    # The standard uncertainty of a median is 1.25 times that of a mean.
    return LensBlur(median, 1.25 * scatter / len(sigmas) ** 0.5, len(sigmas))


def _measure_edge_sigmas(
    image: npt.ArrayLike, view: TargetView | LaserView, along: str
) -> Iterable[float]:
    """Yield the sigma of each edge of one image that can be measured."""
    grey = convert_to_grey(image).astype(np.float64)
    chords = _find_chords(view, 0 if along == "u" else 1)
    step = max(1, math.ceil(len(chords) / MAX_EDGES_PER_IMAGE))
    for start, stop in chords[::step]:
        for fraction in ACROSS_FRACTIONS:
            sigma = _measure_edge_sigma(grey, start, stop, fraction)
            if sigma is not None:
                yield sigma
                break


def _find_chords(view: TargetView | LaserView, axis: int) -> FloatArray:
    """Return the ends (k, 2, 2) in px of the edges that run across an image axis."""
    distances = np.linalg.norm(view.points[:, None, :2] - view.points[None, :, :2], axis=2)
    pitch = float(np.min(distances[distances > 0]))
    first, second = np.nonzero(np.triu(np.abs(distances - pitch) < 0.1 * pitch))
    chords = np.stack([view.pixels[first], view.pixels[second]], axis=1)
    extents = np.abs(chords[:, 1] - chords[:, 0])
    lengths = np.linalg.norm(extents, axis=1)
    across_axis: FloatArray = chords[
        (extents[:, 1 - axis] > extents[:, axis]) & (lengths > MIN_EDGE_LENGTH_PX)
    ]
    return across_axis


def _measure_edge_sigma(
    grey: FloatArray, start: Points, stop: Points, fraction: float
) -> float | None:
    """Return the sigma (px) of the blur across an edge; None if other structures disturb it."""
    from scipy.optimize import leastsq
    from scipy.special import ndtr

    values, coordinates, length = _select_pixels_around_edge(grey, start, stop, fraction)
    half_width = float(np.abs(coordinates[0]).max()) if len(values) else 0.0
    sides = [values[coordinates[0] * sign > SIDE_FRACTION * half_width] for sign in (-1, 1)]
    if min(len(side) for side in sides) < MIN_SIDE_PIXELS:
        return None
    low, high = (float(np.median(side)) for side in sides)
    if abs(high - low) < MIN_CONTRAST or max(low, high) > SATURATION_LEVEL:
        return None

    def residuals_at(parameters: FloatArray) -> FloatArray:
        level, step, offset, slope, sigma = parameters
        step_response = ndtr(
            (coordinates[0] - offset - slope * coordinates[1] / length) / max(abs(sigma), 0.05)
        )
        residuals: FloatArray = level + step * step_response - values
        return residuals

    initial_guess = [low, high - low, 0.0, 0.0, 0.8]
    # The full output turns off the warning about a fit that has not converged: its rms decides.
    fit, *_ = leastsq(residuals_at, initial_guess, maxfev=120, full_output=True)
    rms, sigma = float(np.sqrt(np.mean(residuals_at(fit) ** 2))), abs(float(fit[4]))
    is_plain_edge = (
        rms < MAX_RELATIVE_RMS * abs(fit[1])
        and MIN_SIGMA_PX < sigma < MAX_SIGMA_FRACTION * half_width
    )
    return sigma if is_plain_edge else None


def _select_pixels_around_edge(
    grey: FloatArray, start: Points, stop: Points, fraction: float
) -> tuple[FloatArray, FloatArray, float]:
    """Return the pixels in the window about the middle of an edge.

    Their brightness (n,) in DN, their positions (2, n), distance from the edge and position along
    it from its middle, and the length of the edge. Units: px.
    """
    length = float(np.hypot(*(stop - start)))
    direction, middle = (stop - start) / length, (start + stop) / 2
    half_size = ALONG_FRACTION * length, min(MAX_HALF_WIDTH_PX, fraction * length)
    corners = np.ceil(np.abs(direction) * half_size[0] + np.abs(direction[::-1]) * half_size[1])
    low = np.maximum(np.floor(middle - corners), 0).astype(int)
    high = np.minimum(np.ceil(middle + corners) + 1, grey.shape[::-1]).astype(int)
    u, v = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    du, dv = u - middle[0], v - middle[1]
    t = du * direction[0] + dv * direction[1]
    d = dv * direction[0] - du * direction[1]
    inside = (np.abs(t) < half_size[0]) & (np.abs(d) < half_size[1])
    values: FloatArray = grey[low[1] : high[1], low[0] : high[0]][inside]
    return values, np.stack([d[inside], t[inside]]), length
