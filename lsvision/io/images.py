"""Images from files, with their own depth: 8 or 16 bit, grey or colour."""

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
"""Largest image that is read; finding its line takes 20 to 50 times its pixels in memory."""


def read_image(path: str | os.PathLike[str]) -> npt.NDArray[Any]:
    """Read an image as it was stored.

    Parameters
    ----------
    path : path
        PNG, TIFF, JPEG, BMP, PGM, PPM or WebP, known by its first bytes; ``"-"`` is standard
        input.

    Returns
    -------
    (height, width) or (height, width, 3) ndarray of uint8 or uint16
        Blue first; transparency is left out, and no orientation tag turns it.

    Raises
    ------
    UnreadableFile
        If the file is missing, holds no such image or one of more than `MAX_PIXELS`; names the
        file and the mend.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "dot.png"
    >>> _ = path.write_bytes(cv2.imencode(".png", np.full((2, 3), 700, np.uint16))[1].tobytes())
    >>> read_image(path).shape, read_image(path).dtype.name
    ((2, 3), 'uint16')
    """
    source = Path(path)
    content = read_bytes(source)
    size = image_size(content)
    if size is not None and size[0] * size[1] > MAX_PIXELS:
        raise UnreadableFile(
            f"{source}: expected an image of at most {MAX_PIXELS / 1e6:g} megapixels, got "
            f"{size[0]} x {size[1]} px: crop it to the laser line"
        )
    image = None if size is None else _decoded(np.frombuffer(content, dtype=np.uint8))
    if image is None or image.dtype not in (np.uint8, np.uint16) or not image.size:
        raise UnreadableFile(
            f"{source} is no image of 8 or 16 bit: save it as PNG, TIFF or JPEG, and copy it "
            "anew if it is cut short"
        )
    return image[..., :3] if image.ndim == 3 else image


def _decoded(data: npt.NDArray[np.uint8]) -> npt.NDArray[Any] | None:
    try:
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    except cv2.error:
        return None
    return None if image is None else np.asarray(image)
