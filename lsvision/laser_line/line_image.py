"""Reduction of an image to the channels from which a laser line is extracted.

Grey values are in digital numbers (DN), the counts that the camera states.

Each pixel of a sensor with a colour mosaic (Bayer) measures one colour: one pixel in four that of a
red or blue laser, two in four that of a green one. In an interpolated colour image the located line
deviates by up to 0.2 px from its true position, to a side that depends on its position relative to
the rows; in the pixels of the laser's colour alone it is located without that error.
"""

from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.geometry import FloatArray, IntArray
from lsvision.laser_line.image_array import Image, as_image

Channel = Literal["grey", "red", "green", "blue", "white"]
Direction = Literal["columns", "rows"]
Bayer = Literal["RGGB", "BGGR", "GRBG", "GBRG"]
COLOUR_ORDER = "BGR"
"""Order of the colours in OpenCV's colour images."""

CHANNEL_WEIGHTS: dict[str, tuple[float, float, float]] = {
    "red": (-0.5, -0.5, 1.0),
    "green": (-0.5, 1.0, -0.5),
    "blue": (1.0, -0.5, -0.5),
    "white": (1 / 3, 1 / 3, 1 / 3),
}
"""Weights of blue, green, red (OpenCV's order). For a coloured laser: its colour minus the mean of
the other two, the excess, which is zero on grey surroundings; for white light: the mean of all."""
FULL_SCALES = (1023, 4095, 16383, 65535)
"""Largest pixel values of cameras with 10, 12, 14 and 16 bit. Units: DN."""


@dataclass(frozen=True, eq=False)
class LineImage:
    """Channels of an image from which a laser line is extracted.

    Equal channels, such as those of a grey image, are the same array, not copies. Only `signal` is
    always contiguous in memory: whole images are processed in it alone.

    Parameters
    ----------
    signal : (height, width) ndarray
        uint8, uint16, int16 or float32; image in which the line is found: the grey values, or in
        colour images the excess of the laser's colour over the mean of the others (0 where it is
        negative and the type unsigned). The laser-off image is subtracted. Units: DN.
    channel_signal : (height, width) ndarray
        As `signal`, but the laser's colour without subtraction of the others. Where all colours are
        saturated the excess is zero, and only this channel shows the line. Units: DN.
    raw_channel : (height, width) ndarray
        The laser's colour before subtraction of the laser-off image; a pixel of it at `full_scale`
        is saturated. Units: DN.
    full_scale : float
        Largest value of a pixel. Units: DN.
    colours : tuple of (height, width, 3) ndarray
        The image, and the laser-off image if there is one, where `signal` is the excess of a
        colour; otherwise empty.
    weights : tuple of float
        Weights of blue, green and red in the excess of a colour; otherwise empty.
    """

    signal: Image
    channel_signal: Image
    raw_channel: Image
    full_scale: float
    colours: tuple[Image, ...] = ()
    weights: tuple[float, ...] = ()

    @property
    def value_step(self) -> float:
        """Smallest difference of two pixel values: 1, or less for a float image. Units: DN.

        A float image with a full scale below 255, such as 1, is taken to be one of 8 bit.
        """
        return min(1.0, self.full_scale / 255) if self.raw_channel.dtype.kind == "f" else 1.0

    def transpose(self) -> "LineImage":
        """Return the image with rows and columns exchanged."""
        signal = cv2.transpose(self.signal)
        # Channels that are the same array stay the same, which callers test.
        channel_signal, raw_channel = (
            signal if channel is self.signal else channel.T
            for channel in (self.channel_signal, self.raw_channel)
        )
        colours = tuple(colour.swapaxes(0, 1) for colour in self.colours)
        return replace(
            self,
            signal=signal,
            channel_signal=channel_signal,
            raw_channel=raw_channel,
            colours=colours,
        )

    def read_signal(self, rows: IntArray, columns: IntArray) -> FloatArray:
        """Return the signal at pixels, in DN; of a coloured laser neither rounded nor cut off at 0.

        Without the negative values of the background, its noise would seem to be half as large, and
        faint stripes narrower than they are.
        """
        if not self.colours:
            return self.signal[rows, columns].astype(np.float64)
        values = self.colours[0][rows, columns].astype(np.float64)
        for dark in self.colours[1:]:
            values -= dark[rows, columns]
        excess: FloatArray = values @ np.array(self.weights)
        return excess

    def with_luminance_signal(self) -> "LineImage":
        """Return the image with the luminance of its `colours` (Y of JPEG) as signal.

        The luminance may have a higher resolution than the colours. Saturated pixels remain those
        of the laser's colour.
        """
        luminances = [cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY) for colour in self.colours]
        signal = luminances[0] if len(luminances) == 1 else _subtract(*luminances)
        return replace(self, signal=signal, channel_signal=signal, colours=())


def prepare_line_image(
    image: npt.ArrayLike,
    laser_off: npt.ArrayLike | None,
    channel: Channel,
    full_scale: float | None,
) -> LineImage:
    """Check an image and reduce it to the laser's channel.

    Parameters
    ----------
    image : (height, width) or (height, width, 3) array_like
        uint8, uint16 or float; colours in OpenCV's order blue, green, red.
    laser_off : array_like, optional
        Image of the same view without the laser, which is subtracted.
    channel : {"grey", "red", "green", "blue", "white"}
        The laser's colour, "white" for a line of white light; "grey" for a grey image.
    full_scale : float, optional
        Largest value of a pixel. By default 255 for uint8; for uint16 the smallest of 10,
        12, 14 and 16 bit that holds the image. Units: DN.

    Returns
    -------
    LineImage
        Channels with the rows and columns of `image`.

    Raises
    ------
    TypeError
        If the type of the image is another one, or a float image comes without `full_scale`.
    ValueError
        If the shape is not that of an image, colour and `channel` disagree, or `laser_off`
        differs in shape or type.
    """
    array = as_image(image)
    scale = find_full_scale(array, full_scale)
    signal, raw_channel = _split_channels(array, channel)
    coloured = raw_channel is not signal
    weights = CHANNEL_WEIGHTS[channel] if coloured else ()
    dark = as_laser_off(laser_off, array)
    if dark is None:
        colours = (array,) if coloured else ()
        return LineImage(signal, raw_channel, raw_channel, scale, colours, weights)
    dark_signal, dark_channel = _split_channels(dark, channel)
    difference = _subtract(signal, dark_signal)
    if not coloured:
        return LineImage(difference, difference, raw_channel, scale)
    channel_difference = _subtract(raw_channel, dark_channel)
    return LineImage(difference, channel_difference, raw_channel, scale, (array, dark), weights)


def as_laser_off(laser_off: npt.ArrayLike | None, image: Image) -> Image | None:
    """Return a laser-off frame as an image like the one with the laser; None for None.

    TypeError or ValueError if it is not an image, or differs from the other in shape or type.
    """
    if laser_off is None:
        return None
    dark = as_image(laser_off, "laser_off")
    if dark.shape != image.shape or dark.dtype != image.dtype:
        raise ValueError(
            f"expected a laser_off frame like the image, {image.shape} {image.dtype}, got "
            f"{dark.shape} {dark.dtype}"
        )
    return dark


def find_full_scale(array: Image, given: float | None) -> float:
    """Return the largest possible value of a pixel: as given, else by the type of the image.

    For uint16 it is the smallest of `FULL_SCALES` that is not below the brightest pixel. TypeError
    if none is given for a float image. Units: DN.
    """
    if given is not None:
        return float(given)
    if array.dtype == np.uint8:
        return 255.0
    if array.dtype == np.uint16:
        brightest = int(array.max())
        return float(next(scale for scale in FULL_SCALES if scale >= brightest))
    raise TypeError(
        "expected full_scale for a float image (the largest value of a pixel), got None: give "
        "LineSettings(full_scale=...)"
    )


def _subtract(image: Image, dark: Image) -> Image:
    """Return an image minus the one without the laser: int16 for 8 bit, else float32."""
    depth = cv2.CV_16S if image.dtype == np.uint8 else cv2.CV_32F
    difference: Image = cv2.subtract(image, dark, dtype=depth)
    return difference


def _split_channels(array: Image, channel: Channel) -> tuple[Image, Image]:
    """Return the signal and the laser's colour (see `LineImage`) of one image.

    They are the same array where no colour is subtracted. ValueError if colour and `channel`
    disagree.
    """
    if array.ndim == 2:
        if channel not in ("grey", "white"):
            raise ValueError(
                f'expected a colour image for channel="{channel}", got a grey one of shape '
                f'{array.shape}: use channel="grey"'
            )
        return array, array
    if channel == "grey":
        grey = _extract_grey_channel(array)
        return grey, grey
    weights = np.array(CHANNEL_WEIGHTS[channel], dtype=np.float32)
    signal: Image = cv2.transform(array, weights[None])
    return signal, signal if channel == "white" else array[:, :, int(np.argmax(weights))]


def _extract_grey_channel(array: Image) -> Image:
    """Return one channel of a grey image stored as three equal channels; else ValueError."""
    first = array[..., 0]
    if np.array_equal(first, array[..., 1]) and np.array_equal(first, array[..., 2]):
        return np.ascontiguousarray(first)
    raise ValueError(
        f"expected a grey image, got colours of shape {array.shape}: name the laser's colour, "
        'LineSettings(channel="red"), "green", "blue" or "white"'
    )


def split_colour_planes(array: Image, pattern: Bayer, colour: str) -> list[tuple[int, int, Image]]:
    """Return the pixels of one colour of a mosaic, as images of every second row and column.

    The image is raw, or a colour image interpolated from a raw one. `pattern` names the colours of
    the first two pixels of its first row, then of its second. Each item is first row, first column
    and pixels: one item for red and blue, two for green, in different rows and columns.

    Examples
    --------
    >>> raw = np.arange(16, dtype=np.uint8).reshape(4, 4)
    >>> (row, column, pixels), = split_colour_planes(raw, "GRBG", "red")
    >>> row, column, pixels.tolist()
    (0, 1, [[1, 3], [9, 11]])
    """
    letter = colour[0].upper()
    plane = array if array.ndim == 2 else array[:, :, COLOUR_ORDER.index(letter)]
    return [
        (index // 2, index % 2, np.ascontiguousarray(plane[index // 2 :: 2, index % 2 :: 2]))
        for index, pixel_letter in enumerate(pattern)
        if pixel_letter == letter
    ]


def interpolate_grey(array: Image, pattern: Bayer | None) -> Image:
    """Return the luminance of a mosaic at every pixel, in which objects of any colour are visible.

    The given image is returned if it has colours or another depth than 8 or 16 bit, or if `pattern`
    (see `split_colour_planes`) is None.

    Examples
    --------
    >>> raw = np.tile(np.array([[90, 60], [60, 30]], np.uint8), (8, 8))
    >>> np.unique(interpolate_grey(raw, "RGGB")).tolist()
    [66]
    """
    if pattern is None or array.ndim != 2 or array.dtype not in (np.uint8, np.uint16):
        return array
    grey: Image = cv2.cvtColor(array, getattr(cv2, f"COLOR_Bayer{pattern}2GRAY"))
    return grey
