"""The laser's own pixels of a sensor with a colour mosaic (Bayer).

Each pixel of such a sensor measures one colour: one pixel in four that of a red or blue laser, two
in four that of a green one. In an interpolated colour image the located line deviates by up to
0.2 px from its true position, to a side that depends on its position relative to the rows; in the
pixels of the laser's colour alone it is located without that error.
"""

from typing import Literal

import cv2
import numpy as np

from lsvision.laser_line.image_array import Image

Bayer = Literal["RGGB", "BGGR", "GRBG", "GBRG"]
COLOUR_ORDER = "BGR"
"""Order of the colours in OpenCV's colour images."""


def colour_planes(array: Image, pattern: Bayer, colour: str) -> list[tuple[int, int, Image]]:
    """Return the pixels of one colour of a mosaic, as images of every second row and column.

    The raw image, or a colour image interpolated from one, has in the first two pixels of the first
    and the second row the colours of `pattern`. Each image comes after its first row and first
    column: one for red and blue, two for green, which are in different rows and columns.

    Examples
    --------
    >>> raw = np.arange(16, dtype=np.uint8).reshape(4, 4)
    >>> (row, column, pixels), = colour_planes(raw, "GRBG", "red")
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
    (see `colour_planes`) is None.

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
