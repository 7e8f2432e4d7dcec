"""Images from files, with their own depth: 8 or 16 bit, grey or colour."""

import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.errors import UnreadableFile


def read_image(path: str | os.PathLike[str]) -> npt.NDArray[Any]:
    """Read an image as it was stored.

    Parameters
    ----------
    path : path
        Any format of OpenCV: PNG, TIFF, JPEG, BMP, PGM.

    Returns
    -------
    (height, width) or (height, width, 3) ndarray of uint8 or uint16
        Blue first; transparency is left out, and no orientation tag turns it.

    Raises
    ------
    UnreadableFile
        If the file is missing or holds no such image; names the file and the mend.

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
        data = np.frombuffer(source.read_bytes(), dtype=np.uint8)
    except OSError as error:
        raise UnreadableFile(
            f"{source} cannot be read: {error.strerror}: check the name"
        ) from error
    image = _decoded(data)
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise UnreadableFile(
            f"{source} is no image of 8 or 16 bit: save it as PNG, TIFF or JPEG, and copy it "
            "anew if it is cut short"
        )
    return image[..., :3] if image.ndim == 3 else image


def _decoded(data: npt.NDArray[np.uint8]) -> npt.NDArray[Any] | None:
    if not len(data):
        return None
    try:
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    except cv2.error:
        return None
    return None if image is None else np.asarray(image)
