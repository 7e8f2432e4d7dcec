"""Extraction of a laser line from an image: one sub-pixel point in each column or row."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from lsvision.errors import NoLaserLine
from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.laser_line.coarse_colours import estimate_coarse_colour_std, select_sharper_line
from lsvision.laser_line.detection import DetectedLine, find_direction, find_line
from lsvision.laser_line.gaussian_fit import locate_by_gaussian_fit
from lsvision.laser_line.image_array import MIN_SIZE_PX, Image, as_image
from lsvision.laser_line.jpeg_blocks import BLOCK_PX
from lsvision.laser_line.line import LaserLine
from lsvision.laser_line.line_image import (
    Bayer,
    LineImage,
    as_laser_off,
    find_full_scale,
    prepare_line_image,
    split_colour_planes,
)
from lsvision.laser_line.noise import (
    estimate_block_excess_variance,
    estimate_excess_variance,
)
from lsvision.laser_line.pixel_sampling import correct_pixel_sampling, correct_ridge_sampling
from lsvision.laser_line.ridge_smoothing import (
    correct_ridge_smoothing,
    interpolate_rows_at_columns,
)
from lsvision.laser_line.settings import LineSettings
from lsvision.laser_line.stripe_windows import Stripes, cut_windows
from lsvision.laser_line.subpixel import (
    locate_by_derivative,
    locate_by_steger,
)

MAX_SATURATED_FRACTION = 0.5
"""Largest fraction of the pixels at full scale; above it the whole image is overexposed. A line
covers a few per cent of an image, a bright background that hides it nearly all."""
SATURATED_SIGMA_FACTOR = 2.0
"""Ratio of the filter's sigma at a saturated stripe to that elsewhere: clipping widens a stripe,
and the filter must see its flanks. With a ratio of 1 it does not where the light is 35 times full
scale; with one of 2.8 the errors of coloured lines are 20 to 40 % larger."""
MIN_BORDER_DISTANCE_SIGMAS = 1.5
"""Distance of a line from the image's border, in sigmas of the filter, below which the border cuts
off a flank of the line: a stripe as wide as the filter has 7 % of its light beyond."""
MAX_BORDER_FRACTION = 0.5
"""Largest fraction of a line's columns that may be so near to the border; if fewer are, only these
are lost."""
STEGER_CORRELATION_SIGMAS = 4.0
"""Distance along the line, in sigmas of Steger's smoothing, from which errors are independent."""

__all__ = ["LineSettings", "extract_laser_line"]


def extract_laser_line(
    image: npt.ArrayLike,
    settings: LineSettings | None = None,
    laser_off: npt.ArrayLike | None = None,
) -> LaserLine:
    """Extract the laser line from an image to a fraction of a pixel.

    Parameters
    ----------
    image : (height, width) or (height, width, 3) array_like
        Raw image: uint8, uint16 or float; colours in OpenCV's order blue, green, red.
    settings : LineSettings, optional
        Method, filter and noise; `LineSettings` by default.
    laser_off : array_like, optional
        The same view without the laser, to be subtracted: for scenes in which something else
        looks like a line.

    Returns
    -------
    LaserLine
        The variance `std`^2 is the sum of that predicted from the noise of the pixels, of that of
        the rounding in an image that is or was a JPEG image, and of the excess scatter along the
        line (speckle, roughness of the surface), which is larger where the line is steep.

    Raises
    ------
    NoLaserLine
        If there is no line, the whole image is overexposed, the line runs along the border, or the
        method locates it in no column.
    TypeError, ValueError
        If `image` is not an image, its colours and ``settings.channel`` disagree, or `laser_off`
        differs from it in shape or type.

    Notes
    -----
    Steps: candidates in each column (matched filter), the path of lowest cost through them, and
    the zero crossing of a derivative of Gaussian around it. Of two lines the longer unbroken one
    is extracted, however bright the other; see `LaserLine.second_line_fraction`. The error exceeds
    `std` next to the end of a line, at a step, and where a bright streak crosses the line. Ambient
    light that changes by g DN per row shifts a line of height A towards the brighter side, with a
    filter of 2 px by about 11 g / A px, unless a `laser_off` frame removes it.

    Examples
    --------
    >>> rows = np.arange(240)[:, None]
    >>> image = 10 + 180 * np.exp(-0.5 * ((rows - 100.25) / 1.5) ** 2) * np.ones(320)
    >>> line = extract_laser_line(image.round().astype(np.uint8))
    >>> len(line), line.lost, line.direction, line.pixels[7].round(2)
    (320, 0, 'columns', array([  7.  , 100.25]))
    """
    settings = settings or LineSettings()
    if settings.bayer is not None:
        return _extract_from_mosaic(image, settings, settings.bayer, laser_off)
    line_image = prepare_line_image(image, laser_off, settings.channel, settings.full_scale)
    _check_exposure(line_image)
    direction = settings.direction or find_direction(line_image, settings)
    if direction == "rows":
        line_image = line_image.transpose()
    detected = find_line(line_image, settings)
    coarseness: FloatArray | float = 0.0
    if settings.luminance and line_image.colours:
        line_image, detected, coarseness = select_sharper_line(line_image, detected, settings)
    elif line_image.colours:
        coarseness = estimate_coarse_colour_std(detected)
    stripes = _locate_stripes(line_image, detected, settings)
    stripes = replace(stripes, std=np.hypot(stripes.std, coarseness))
    _check_border(line_image, detected)
    line = _build_line(line_image, detected, stripes, settings)
    if direction == "rows":
        return replace(line, pixels=line.pixels[:, ::-1], direction="rows")
    return line


def _extract_from_mosaic(
    image: npt.ArrayLike, settings: LineSettings, pattern: Bayer, laser_off: npt.ArrayLike | None
) -> LaserLine:
    """Extract the line from the pixels of the laser's colour; for green from both their grids."""
    array = as_image(image, min_size=2 * MIN_SIZE_PX)
    planes = split_colour_planes(array, pattern, settings.channel)
    dark = as_laser_off(laser_off, array)
    dark_planes: list[Image] | list[None] = [None] * len(planes)
    if dark is not None:
        dark_planes = [
            plane for _, _, plane in split_colour_planes(dark, pattern, settings.channel)
        ]
    settings = replace(
        settings,
        bayer=None,
        channel="grey",
        sigma=settings.sigma / 2,
        full_scale=find_full_scale(array, settings.full_scale),
    )
    lines, starts = [], []
    for (row, column, plane), dark_plane in zip(planes, dark_planes, strict=True):
        line = extract_laser_line(plane, settings, dark_plane)
        # Both grids have the direction of the first one.
        settings = replace(settings, direction=line.direction)
        lines.append(_convert_to_sensor_pixels(line, row, column))
        starts.append(column if line.direction == "columns" else row)
    return lines[0] if len(lines) == 1 else _interleave(lines, starts)


def _convert_to_sensor_pixels(line: LaserLine, row: int, column: int) -> LaserLine:
    """Return a line of every second row and column, converted to pixels of the sensor.

    `correct_pixel_sampling` has corrected a thin line, which such pixels undersample.
    """
    return replace(
        line,
        pixels=2 * line.pixels + np.array([column, row]),
        std=2 * line.std,
        width=2 * line.width,
        skew_shift=line.skew_shift / 4,
        filter_sigma=2 * line.filter_sigma,
    )


def _interleave(lines: list[LaserLine], starts: list[int]) -> LaserLine:
    """Return two lines of every second column as one, given the first column of each.

    For lines with one point for each row, columns stand for rows.
    """
    first, second = lines
    columns = np.concatenate(
        [2 * np.arange(len(line)) + start for line, start in zip(lines, starts, strict=True)]
    )
    order = np.argsort(columns, kind="stable")

    merged: dict[str, Any] = {
        name: np.concatenate([getattr(first, name), getattr(second, name)])[order]
        for name in ("pixels", "std", "intensity", "width", "saturated", "skew_shift")
    }
    fraction = max(first.second_line_fraction, second.second_line_fraction)
    return replace(first, second_line_fraction=fraction, **merged)


def _check_exposure(image: LineImage) -> None:
    """Raise NoLaserLine if most of the image is at full scale; every fourth pixel is checked."""
    raw, scale = image.raw_channel[::4, ::4], image.full_scale
    # Whole numbers are compared with a whole number: ten times as fast, and the same.
    reached = raw >= (scale if raw.dtype.kind == "f" else math.ceil(scale))
    saturated = np.count_nonzero(reached) / reached.size
    if saturated > MAX_SATURATED_FRACTION:
        raise NoLaserLine(
            f"{saturated:.0%} of the image is at its full scale of {image.full_scale:g}, expected "
            f"at most {MAX_SATURATED_FRACTION:.0%}: shorten the exposure until only the line is "
            "bright"
        )


def _locate_stripes(image: LineImage, detected: DetectedLine, settings: LineSettings) -> Stripes:
    """Locate the stripes by the method of the settings; `detected` has those of "derivative"."""
    windows, sigma = detected.windows, detected.sigma
    stripes = correct_pixel_sampling(windows, detected.stripes, sigma)
    if settings.method == "gaussian":
        return locate_by_gaussian_fit(windows, stripes, detected.variances)
    if settings.method == "steger":
        ridge = locate_by_steger(image.signal, windows, stripes, detected.variances, sigma)
        return correct_ridge_smoothing(
            windows.columns, correct_ridge_sampling(windows, ridge, sigma), sigma
        )
    return _relocate_saturated(image, replace(detected, stripes=stripes))


def _relocate_saturated(image: LineImage, detected: DetectedLine) -> Stripes:
    """Replace saturated stripes by fits of a Gaussian, or those of a wider filter.

    Without colours a Gaussian is fitted to the unsaturated pixels; where that fails, the wider
    filter locates the stripe, and where that has no zero crossing, the narrow filter's stripe is
    kept. Of a coloured laser the excess of its colour is zero in the saturated middle, and a fit or
    the narrow filter locates one of the rims: the wider filter, in the laser's own channel, alone
    locates such stripes.
    """
    clipped = detected.windows.saturated.any(axis=1) & detected.stripes.found
    if not clipped.any():
        return detected.stripes
    coloured = image.channel_signal is not image.signal
    stripes = detected.stripes
    if not coloured:
        fits = locate_by_gaussian_fit(
            detected.windows.select(clipped),
            stripes.select(clipped),
            detected.variances[clipped],
        )
        fitted = np.isfinite(fits.skew_shifts)
        at = np.flatnonzero(clipped)[fitted]
        stripes = stripes.replace_at(at, fits.select(fitted))
        clipped[at] = False
        if not clipped.any():
            return stripes
    start = detected.stripes.pixels[clipped, 1]
    sigma = SATURATED_SIGMA_FACTOR * detected.sigma
    columns = detected.windows.columns[clipped]
    windows = cut_windows(image, image.channel_signal, columns, start, sigma)
    # An upper limit: each pixel is as noisy as the brightest one.
    largest = detected.variances[clipped].max(axis=1, keepdims=True)
    variances = np.broadcast_to(largest, windows.values.shape)
    wider = locate_by_derivative(windows, start, variances, sigma)
    replaced = wider.found | coloured
    return stripes.replace_at(np.flatnonzero(clipped)[replaced], wider.select(replaced))


def _is_near_border(image: LineImage, detected: DetectedLine) -> BoolArray:
    """Return whether the upper or lower border cuts off a flank of the line (n,)."""
    margin = MIN_BORDER_DISTANCE_SIGMAS * detected.sigma
    rows = detected.windows.centre_rows
    near: BoolArray = (rows < margin) | (rows > image.signal.shape[0] - 1 - margin)
    return near


def _check_border(image: LineImage, detected: DetectedLine) -> None:
    """Raise NoLaserLine if most of the line is cut off by the border of the image."""
    near = _is_near_border(image, detected)
    if near.mean() > MAX_BORDER_FRACTION:
        margin = MIN_BORDER_DISTANCE_SIGMAS * detected.sigma
        raise NoLaserLine(
            f"the line runs within {margin:.0f} px of the image's border "
            f"in {near.mean():.0%} of its columns, where a flank is cut off: move the camera, "
            "the laser or the region of interest until the whole line is in view"
        )


def _build_line(
    image: LineImage, detected: DetectedLine, stripes: Stripes, settings: LineSettings
) -> LaserLine:
    """Build the line of all columns from its stripes; u and v as in `image`."""
    good = stripes.found & ~_is_near_border(image, detected)
    if not good.any():
        raise NoLaserLine(
            f"the method {settings.method!r} locates the line in none of its {len(good)} columns "
            f"with a filter of sigma {detected.sigma:g} px",
            "choose a larger sigma or another method",
        )
    columns, located = detected.windows.columns[good], stripes.select(good)
    is_ridge = settings.method == "steger"
    excess = _estimate_excess_variance(detected, columns, located, is_ridge=is_ridge)
    width = image.signal.shape[1]
    pixels = np.full((width, 2), np.nan)
    pixels[columns] = located.pixels
    std, heights, widths, skew_shift = np.full((4, width), np.nan)
    std[columns] = np.sqrt(located.std**2 + excess)
    heights[columns] = located.heights
    widths[columns] = located.widths
    skew_shift[columns] = located.skew_shifts
    saturated = np.zeros(width, dtype=bool)
    saturated[columns] = detected.windows.saturated[good].any(axis=1)
    return LaserLine(
        pixels,
        std,
        heights,
        widths,
        saturated,
        direction="columns",
        second_line_fraction=detected.second_line_fraction,
        filter_sigma=detected.sigma,
        skew_shift=skew_shift,
        is_ridge=is_ridge,
    )


def _estimate_excess_variance(
    detected: DetectedLine, columns: IntArray, stripes: Stripes, *, is_ridge: bool
) -> FloatArray:
    """Return the variance (n,) of stripes in excess of their predicted noise, in px^2."""
    rows, lag = stripes.pixels[:, 1], None
    if is_ridge:
        rows = interpolate_rows_at_columns(stripes.pixels, columns)
        # The smoothing along the line correlates the errors of neighbours.
        lag = math.ceil(STEGER_CORRELATION_SIGMAS * detected.sigma)
    excess = estimate_excess_variance(columns, rows, stripes.std, lag)
    if detected.blocks is None:
        return excess
    first = detected.blocks.column
    of_blocks = estimate_block_excess_variance(columns, rows, stripes.std, BLOCK_PX, first)
    return np.maximum(excess, of_blocks)
