"""The laser line in an image, column by column, to a fraction of a pixel."""

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from lsvision.errors import NoLaserLine
from lsvision.geometry import BoolArray, FloatArray, IntArray, Points, as_readonly_array
from lsvision.laser_line.derivative_of_gaussian import locate_by_derivative
from lsvision.laser_line.detection import DetectedLine, find_direction, find_line
from lsvision.laser_line.gaussian_fit import locate_by_gaussian_fit
from lsvision.laser_line.line_image import Direction, LineImage, prepare_line_image
from lsvision.laser_line.noise import SLOPE_SPAN, excess_variance
from lsvision.laser_line.settings import LineSettings
from lsvision.laser_line.steger_ridge import locate_by_steger
from lsvision.laser_line.stripe_windows import Stripes, cut_windows

MAX_SATURATED_FRACTION = 0.5
"""Share of the image at full scale from which it is overexposed as a whole."""
SATURATED_SIGMA_FACTOR = 2.0
"""A saturated stripe is wider than its light: its filter is widened by this."""
BORDER_SIGMAS = 1.5
"""Sigmas from the image's border within which the line's flank is cut off."""

__all__ = ["LaserLine", "LineSettings", "extract_laser_line"]


@dataclass(frozen=True, eq=False)
class LaserLine:
    """A laser line: one point for each column (or row) of the image, in order.

    Parameters
    ----------
    pixels : (n, 2) ndarray
        u, v; NaN rows where the line is lost. Pixel (0, 0) is the centre of the top-left
        pixel. Units: px.
    std : (n,) ndarray
        One sigma across the line (along v for columns, along u for rows). Units: px.
    intensity : (n,) ndarray
        Height above the surroundings. Units: DN.
    width : (n,) ndarray
        One sigma of the line's section. Units: px.
    saturated : (n,) ndarray of bool
        Whether the line is at full scale there.
    direction : {"columns", "rows"}
        What the points stand for.
    second_line_fraction : float
        Share of the columns in which a second line, as strong and apart from this one, can be
        followed: above about 0.2, look whether the right one was taken.
    """

    pixels: Points
    std: FloatArray
    intensity: FloatArray
    width: FloatArray
    saturated: BoolArray
    direction: Direction
    second_line_fraction: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "pixels", as_readonly_array(self.pixels, ("n", 2), "pixels"))
        for name in ("std", "intensity", "width"):
            object.__setattr__(
                self, name, as_readonly_array(getattr(self, name), (len(self.pixels),), name)
            )

    def __len__(self) -> int:
        return len(self.pixels)

    @property
    def lost(self) -> int:
        """Number of columns without a line."""
        return int(np.isnan(self.std).sum())


def extract_laser_line(
    image: npt.ArrayLike,
    settings: LineSettings | None = None,
    laser_off: npt.ArrayLike | None = None,
) -> LaserLine:
    """Find the laser line in an image and measure its place in each column.

    Parameters
    ----------
    image : (height, width) or (height, width, 3) array_like
        Raw image: uint8, uint16 or float; colours in OpenCV's order blue, green, red.
    settings : LineSettings, optional
        How to look.
    laser_off : array_like, optional
        The same view without the laser. Takes away all that is not the laser's light: use it
        where anything else in view looks like a line.

    Returns
    -------
    LaserLine
        Its `std` holds what the noise of the pixels explains and, added to that, the scatter
        along the line that it does not, larger where the line is steep: speckle and the
        roughness of the surface.

    Raises
    ------
    NoLaserLine
        If there is none; if the whole image is overexposed; if the line runs along the border.
    TypeError, ValueError
        If it is no image, or colour and ``settings.channel`` disagree.

    Notes
    -----
    Candidates in each column (matched filter), the cheapest path through them, and the zero
    crossing of a derivative-of-Gaussian filter around it. Of two lines the longer unbroken one
    is taken, however bright the other; `LaserLine.second_line_fraction` tells of it. Points next to
    the end of a line, the edge of a step, or where a bright streak crosses err by more than `std`.

    Examples
    --------
    >>> rows = np.arange(240)[:, None]
    >>> image = 10 + 180 * np.exp(-0.5 * ((rows - 100.25) / 1.5) ** 2) * np.ones(320)
    >>> line = extract_laser_line(image.round().astype(np.uint8))
    >>> len(line), line.lost, line.direction, line.pixels[7].round(2)
    (320, 0, 'columns', array([  7.  , 100.25]))
    """
    chosen = settings or LineSettings()
    prepared = prepare_line_image(image, laser_off, chosen.channel, chosen.full_scale)
    _refuse_glare(prepared)
    direction = chosen.direction or find_direction(prepared, chosen)
    level = prepared if direction == "columns" else prepared.transposed()
    found = find_line(level, chosen)
    stripes = _located(level, found, chosen)
    _refuse_border(level, found)
    line = _assembled(level, found, stripes, chosen)
    return (
        line
        if direction == "columns"
        else replace(line, pixels=line.pixels[:, ::-1], direction="rows")
    )


def _refuse_glare(image: LineImage) -> None:
    share = float((image.raw_channel[::4, ::4] >= image.full_scale).mean())
    if share > MAX_SATURATED_FRACTION:
        raise NoLaserLine(
            f"{share:.0%} of the image is at its full scale of {image.full_scale:g} and "
            f"{MAX_SATURATED_FRACTION:.0%} at most can be: shorten the exposure until only the "
            "line is bright"
        )


def _located(image: LineImage, found: DetectedLine, settings: LineSettings) -> Stripes:
    """The line's places by the method asked for."""
    if settings.method == "gaussian":
        return locate_by_gaussian_fit(found.windows, found.stripes, found.variances)
    if settings.method == "steger":
        return locate_by_steger(
            image.signal, found.windows, found.stripes, found.variances, found.sigma
        )
    return _widened_where_saturated(image, found)


def _widened_where_saturated(image: LineImage, found: DetectedLine) -> Stripes:
    """The line's places; where saturated by a wider filter, in the laser's own channel.

    Where that finds nothing, a white-hot line of a coloured laser is lost, because its rim has
    a place of its own; a grey one keeps the narrow filter's place.
    """
    clipped = found.windows.saturated.any(axis=1) & found.stripes.found
    if not clipped.any():
        return found.stripes
    start = found.stripes.pixels[clipped, 1]
    sigma = SATURATED_SIGMA_FACTOR * found.sigma
    windows = cut_windows(image, image.channel_signal, found.windows.columns[clipped], start, sigma)
    brightest = found.variances[clipped].max(axis=1, keepdims=True)
    variances = np.broadcast_to(brightest, windows.values.shape)
    wider = locate_by_derivative(windows, start, variances, sigma)
    taken = wider.found | (image.channel_signal is not image.signal)
    at = np.flatnonzero(clipped)[taken]
    merged = found.stripes
    for name in ("pixels", "std", "heights", "sigmas"):
        values = getattr(merged, name).copy()
        values[at] = getattr(wider, name)[taken]
        merged = replace(merged, **{name: values})
    return merged


def _near_border(image: LineImage, found: DetectedLine) -> BoolArray:
    margin = BORDER_SIGMAS * found.sigma
    rows = found.windows.centre_rows
    near: BoolArray = (rows < margin) | (rows > image.signal.shape[0] - 1 - margin)
    return near


def _refuse_border(image: LineImage, found: DetectedLine) -> None:
    near = _near_border(image, found)
    if near.mean() > 0.5:
        raise NoLaserLine(
            f"the line runs within {BORDER_SIGMAS * found.sigma:.0f} px of the image's border in "
            f"{near.mean():.0%} of its columns, where half of it is cut off: move the camera, "
            "the laser or the region of interest until the whole line is in view"
        )


def _assembled(
    image: LineImage, found: DetectedLine, stripes: Stripes, settings: LineSettings
) -> LaserLine:
    """One entry for each column; u and v still lie as in `image`."""
    good = stripes.found & ~_near_border(image, found)
    columns = found.windows.columns[good]
    places, noise = _in_their_columns(stripes.pixels[good], columns), stripes.std[good]
    # The ridge's smoothing along the line makes neighbours err alike.
    lag = None if settings.method != "steger" else math.ceil(4 * found.sigma)
    excess = excess_variance(columns, places, noise, lag)
    width = image.signal.shape[1]
    pixels = np.full((width, 2), np.nan)
    pixels[columns] = stripes.pixels[good]
    numbers = [np.full(width, np.nan) for _ in range(3)]
    values = np.sqrt(noise**2 + excess), stripes.heights[good], stripes.sigmas[good]
    for number, value in zip(numbers, values, strict=True):
        number[columns] = value
    saturated = np.zeros(width, dtype=bool)
    saturated[columns] = found.windows.saturated[good].any(axis=1)
    std, heights, sigmas = numbers
    return LaserLine(pixels, std, heights, sigmas, saturated, "columns", found.second_line_fraction)


def _in_their_columns(pixels: Points, columns: IntArray) -> FloatArray:
    """Rows at which the line crosses its columns; ridge points lie up to a pixel beside them."""
    before, after = np.roll(pixels, SLOPE_SPAN, axis=0), np.roll(pixels, -SLOPE_SPAN, axis=0)
    run, rise = (after - before).T
    slopes = np.divide(rise, run, out=np.zeros_like(rise), where=np.abs(run) > 1)
    rows: FloatArray = pixels[:, 1] - slopes * (pixels[:, 0] - columns)
    return rows
