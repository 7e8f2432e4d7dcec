"""How far lens and pixel blur an image, from the edges between a board's squares.

The laser line itself cannot tell: its width is that of the sheet, the blur and the surface
together. A printed edge has no width of its own.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from lsvision.calibration.bundle_adjustment_state import LaserView
from lsvision.calibration.grey_image import grey_image
from lsvision.calibration.target import Target, TargetView, find_target
from lsvision.errors import CalibrationFailed, LsvisionError
from lsvision.geometry import FloatArray, Points

ALONG_SHARE = 0.3
"""Of an edge's length: looked at to each side of its middle."""
ACROSS_FRACTIONS = (0.25, 0.09)
"""Looked at across the edge: wide; and, where that holds more than the edge, no farther than to
the marker in a ChArUco board's square."""
MAX_HALF_WIDTH_PX = 8.0
"""Across an edge. Units: px."""
MIN_EDGE_LENGTH_PX = 12.0
"""Length of an edge, corner to corner. Units: px."""
MIN_CONTRAST = 20.0
"""Between the two sides of an edge. Units: DN of 255."""
SATURATION_LEVEL = 250.0
"""A side as bright as this may be cut off, which sharpens its edge. Units: DN of 255."""
MAX_RELATIVE_RMS = 0.06
"""Rms of the pixels about a blurred edge, as a share of its contrast: more is no plain edge."""
MIN_EDGES = 20
MAX_EDGES_PER_IMAGE = 40
"""Of each image."""
MAX_SIGMA_FRACTION = 0.4
"""Of the width looked at: a blur as wide as that has no plateau left to be measured by."""
MAD_TO_STD = 1.4826


@dataclass(frozen=True, slots=True)
class LensBlur:
    """Blur of an image across edges of one direction.

    Parameters
    ----------
    sigma : float
        One sigma of the Gaussian that lens and pixel amount to; median of the edges. Units: px.
    std : float
        One sigma of `sigma`, from the scatter of the edges. Units: px.
    edges : int
        How many.
    """

    sigma: float
    std: float
    edges: int


def measure_lens_blur(
    images: Sequence[npt.ArrayLike], target: Target, along: Literal["u", "v"] = "u"
) -> LensBlur:
    """Blur along one direction of the image, from images of a board of squares.

    Parameters
    ----------
    images : sequence of images
        The board, evenly lit and not overexposed, where the laser line will be measured and
        with that focus; views without the board are passed over.
    target : Target
        A `Chessboard` or `ChArUco`; a circle grid has no straight edges.
    along : {"u", "v"}
        Along which image axis; "u" for a laser line that runs from left to right.

    Returns
    -------
    LensBlur
        What `LightSection` wants as ``line_blur_px``.

    Raises
    ------
    CalibrationFailed
        If fewer than 20 edges can be measured.

    Notes
    -----
    Between each two neighbouring corners whose edge runs within 45 deg across `along`, the
    pixels are fitted by low + contrast * Phi((d - d0 - k t) / sigma) of their distance d from
    the chord and their place t along it. Sigma holds the pixel's own width (1 / sqrt(12) px).
    Too small where the camera sharpens its images, too large where the print is unsharp, the
    board was moving, or the light's colour is focussed elsewhere than the laser's.
    """
    views: list[TargetView] = []
    seen: list[npt.ArrayLike] = []
    for image in images:
        try:
            views.append(find_target(image, target))
        except LsvisionError:
            continue
        seen.append(image)
    return estimate_blur_from_views(seen, views, along)


def estimate_blur_from_views(
    images: Sequence[npt.ArrayLike],
    views: Sequence[TargetView | LaserView],
    along: Literal["u", "v"] = "u",
) -> LensBlur:
    """The same where the board is already found: a view for each image.

    Raises
    ------
    CalibrationFailed
        See `measure_lens_blur`.
    """
    sigmas = [
        sigma
        for image, view in zip(images, views, strict=True)
        for sigma in _edge_sigmas(image, view, along)
    ]
    if len(sigmas) < MIN_EDGES:
        raise CalibrationFailed(
            f"{len(sigmas)} edges of squares are sharp enough to measure the blur and "
            f"{MIN_EDGES} are needed: want squares of {MIN_EDGE_LENGTH_PX:.0f} px and more, not "
            "overexposed, on a chessboard or ChArUco board"
        )
    middle = float(np.median(sigmas))
    scatter = MAD_TO_STD * float(np.median(np.abs(np.array(sigmas) - middle)))
    # A median is 1.25 times as uncertain as a mean.
    return LensBlur(middle, 1.25 * scatter / len(sigmas) ** 0.5, len(sigmas))


def _edge_sigmas(image: npt.ArrayLike, view: TargetView | LaserView, along: str) -> Iterable[float]:
    grey = grey_image(image).astype(np.float64)
    chords = _chords(view, 0 if along == "u" else 1)
    for start, stop in chords[:: max(1, len(chords) // MAX_EDGES_PER_IMAGE)]:
        tried = (_edge_sigma(grey, start, stop, share) for share in ACROSS_FRACTIONS)
        sigma = next((one for one in tried if one is not None), None)
        if sigma is not None:
            yield sigma


def _chords(seen: TargetView | LaserView, axis: int) -> FloatArray:
    """Ends (k, 2, 2) in px of the edges between neighbours that run across an image axis."""
    gaps = np.linalg.norm(seen.points[:, None, :2] - seen.points[None, :, :2], axis=2)
    pitch = float(np.min(gaps[gaps > 0]))
    first, second = np.nonzero(np.triu(np.abs(gaps - pitch) < 0.1 * pitch))
    chords = np.stack([seen.pixels[first], seen.pixels[second]], axis=1)
    runs = np.abs(chords[:, 1] - chords[:, 0])
    chosen: FloatArray = chords[
        (runs[:, 1 - axis] > runs[:, axis]) & (runs.max(axis=1) > MIN_EDGE_LENGTH_PX)
    ]
    return chosen


def _edge_sigma(grey: FloatArray, start: Points, stop: Points, share: float) -> float | None:
    """One sigma of the blur across an edge; None where it is no plain one."""
    from scipy.optimize import leastsq
    from scipy.special import ndtr

    values, across, length = _pixels_beside(grey, start, stop, share)
    reach = float(np.abs(across[0]).max()) if len(values) else 0.0
    sides = [values[across[0] * sign > 0.6 * reach] for sign in (-1, 1)]
    if min(len(side) for side in sides) < 5:
        return None
    low, high = (float(np.median(side)) for side in sides)
    if abs(high - low) < MIN_CONTRAST or max(low, high) > SATURATION_LEVEL:
        return None

    def misfit(free: FloatArray) -> FloatArray:
        base, step, place, turn, sigma = free
        shares = ndtr((across[0] - place - turn * across[1] / length) / max(abs(sigma), 0.05))
        residuals: FloatArray = base + step * shares - values
        return residuals

    guess = [low, high - low, 0.0, 0.0, 0.8]
    found, *_ = leastsq(misfit, guess, maxfev=120, full_output=True)
    rms, sigma = float(np.sqrt(np.mean(misfit(found) ** 2))), abs(float(found[4]))
    plain = rms < MAX_RELATIVE_RMS * abs(found[1]) and 0.1 < sigma < MAX_SIGMA_FRACTION * reach
    return sigma if plain else None


def _pixels_beside(
    grey: FloatArray, start: Points, stop: Points, share: float
) -> tuple[FloatArray, FloatArray, float]:
    """Pixels beside the middle part of an edge.

    Returns
    -------
    values : (n,) ndarray
        Units: DN.
    places : (2, n) ndarray
        Distance across the edge, and along it from its middle. Units: px.
    length : float
        Of the edge. Units: px.
    """
    length = float(np.hypot(*(stop - start)))
    direction, middle = (stop - start) / length, (start + stop) / 2
    size = ALONG_SHARE * length, min(MAX_HALF_WIDTH_PX, share * length)
    corners = np.ceil(np.abs(direction) * size[0] + np.abs(direction[::-1]) * size[1])
    low = np.maximum(np.floor(middle - corners), 0).astype(int)
    high = np.minimum(np.ceil(middle + corners) + 1, grey.shape[::-1]).astype(int)
    u, v = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    du, dv = u - middle[0], v - middle[1]
    t = du * direction[0] + dv * direction[1]
    d = dv * direction[0] - du * direction[1]
    near = (np.abs(t) < size[0]) & (np.abs(d) < size[1])
    values: FloatArray = grey[low[1] : high[1], low[0] : high[0]][near]
    return values, np.stack([d[near], t[near]]), length
