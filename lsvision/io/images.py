"""Image files of 8 or 16 bit, grey or colour."""

import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.errors import UnreadableFile
from lsvision.files.limited_reading import read_bytes
from lsvision.io.image_headers import image_size

MAX_PIXELS = 10**8
"""Largest number of pixels of an image that is read; extracting its laser line takes 20 to 50 times
the memory of the pixels."""


def read_image(path: str | os.PathLike[str]) -> npt.NDArray[Any]:
    """Read an image as it was stored.

    Parameters
    ----------
    path : path
        PNG, TIFF, JPEG, BMP, PGM, PPM or WebP, detected by its first bytes; ``"-"`` is standard
        input.

    Returns
    -------
    (height, width) or (height, width, 3) ndarray of uint8 or uint16
        Channels in the order blue, green, red; transparency and orientation tags are ignored.

    Raises
    ------
    UnreadableFile
        If the file is missing, not such an image, or larger than `MAX_PIXELS`; names the file
        and the remedy.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "dot.png"
    >>> _ = path.write_bytes(cv2.imencode(".png", np.full((2, 3), 700, np.uint16))[1].tobytes())
    >>> read_image(path).shape, read_image(path).dtype.name
    ((2, 3), 'uint16')
    """
    source = Path(path)
    try:
        image = decode_image(read_bytes(source))
    except TooManyPixels as error:
        raise UnreadableFile(f"{source}: {error}: crop it to the laser line") from None
    if image is None or image.dtype not in (np.uint8, np.uint16) or not image.size:
        raise UnreadableFile(
            f"{source} is not an image of 8 or 16 bit: save it as PNG, TIFF or JPEG, and copy it "
            "again if it is truncated"
        )
    return image[..., :3] if image.ndim == 3 else image


def encode_png(image: npt.NDArray[Any]) -> bytes:
    """Return the content of a PNG file of an image of 8 or 16 bit (blue, green, red).

    Examples
    --------
    >>> image = np.full((2, 3), 700, np.uint16)
    >>> bool((decode_image(encode_png(image)) == image).all())
    True
    """
    _, content = cv2.imencode(".png", np.ascontiguousarray(image))
    return bytes(content)


class TooManyPixels(ValueError):
    """Error of an image with more than `MAX_PIXELS`."""


def decode_image(content: bytes) -> npt.NDArray[Any] | None:
    """Return the image of a file's content, as it was stored.

    The size is read from the header and checked before the image is decoded.

    Returns
    -------
    ndarray, optional
        Image of any bit depth; None if the bytes are not an image.

    Raises
    ------
    TooManyPixels
        If the image is larger than `MAX_PIXELS`.
    """
    size = image_size(content)
    if size is None:
        return None
    if size[0] * size[1] > MAX_PIXELS:
        raise TooManyPixels(
            f"expected an image of at most {MAX_PIXELS / 1e6:g} megapixels, got "
            f"{size[0]} x {size[1]} px"
        )
    try:
        image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        return None
    return None if image is None else np.asarray(image)
