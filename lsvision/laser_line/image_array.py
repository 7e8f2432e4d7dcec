"""Images that a caller passes: check of type and shape, and conversion to 8-bit grey."""

import os
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[Any]
MIN_SIZE_PX = 16
"""Smallest height and width: what a filter of sigma 1.3 px needs. Units: px."""
MAX_FLOAT_LEVEL = 1e30
"""Largest number of a float image, which is kept in single precision: its sums over a window do not
overflow."""


def as_image(image: npt.ArrayLike, name: str = "image", min_size: int = MIN_SIZE_PX) -> Image:
    """Return an image as uint8, uint16 or float32, grey or with three colours.

    Parameters
    ----------
    image : (height, width), (height, width, 1) or (height, width, 3) array_like
        uint8, uint16 or float.
    name : str
        Name of the argument in the message.
    min_size : int
        Smallest height and width. Units: px.

    Returns
    -------
    (height, width) or (height, width, 3) ndarray
        Contiguous; the given array itself where it has this form.

    Raises
    ------
    TypeError
        If it is not an array (such as the name of a file), or its numbers are of another type.
    ValueError
        If the shape is another, a side is shorter than `min_size`, or a float image holds NaN,
        infinity or a number beyond `MAX_FLOAT_LEVEL`.

    Examples
    --------
    >>> as_image("x.png")
    Traceback (most recent call last):
    ...
    TypeError: expected image as an array, got 'x.png': lsvision.read_image('x.png') reads it
    >>> as_image(np.zeros((480, 640, 4), np.uint8))
    Traceback (most recent call last):
    ...
    ValueError: expected image of shape (height, width) or (height, width, 3), 16 px or more each \
way, got (480, 640, 4): leave transparency out, image[..., :3]
    """
    if isinstance(image, str | os.PathLike):
        file = os.fspath(image)
        raise TypeError(
            f"expected {name} as an array, got {file!r}: lsvision.read_image({file!r}) reads it"
        )
    array = np.asarray(image)
    array = array.astype(array.dtype.newbyteorder("="), copy=False)  # as of big-endian files
    if array.dtype not in (np.uint8, np.uint16) and array.dtype.kind != "f":
        hint = ""
        if array.dtype.kind in "iu":
            hint = ": convert it, as image.astype(np.uint8) where it holds 0 to 255"
        got = array.dtype if array.dtype.kind != "O" else type(image).__name__
        raise TypeError(f"expected {name} of uint8, uint16 or float, got {got}{hint}")
    if array.ndim == 3 and array.shape[2] == 1:
        array = array[:, :, 0]
    colours = array.ndim == 3 and array.shape[2] == 3
    if not (array.ndim == 2 or colours) or min(array.shape[:2], default=0) < min_size:
        raise ValueError(
            f"expected {name} of shape (height, width) or (height, width, 3), {min_size} px or "
            f"more each way, got {array.shape}{_describe_remedy(array.shape)}"
        )
    if array.dtype.kind != "f":
        return np.ascontiguousarray(array)
    if not (np.abs(array) <= MAX_FLOAT_LEVEL).all():
        raise ValueError(
            f"expected finite numbers up to {MAX_FLOAT_LEVEL:g} in a float {name}, got NaN, "
            "infinity or more"
        )
    return np.ascontiguousarray(array, dtype=np.float32)


def convert_to_grey(image: npt.ArrayLike) -> npt.NDArray[np.uint8]:
    """Return an 8- or 16-bit grey or colour image as 8-bit grey.

    The largest value of a 16-bit image becomes 255.

    Raises
    ------
    TypeError, ValueError
        If it is not an image.
    """
    array = as_image(image)
    if array.dtype.kind == "f":
        raise TypeError(f"expected an image of uint8 or uint16, got {np.asarray(image).dtype}")
    if array.dtype == np.uint16:
        # 10- and 12-bit cameras leave the upper bits zero: scale by the largest value.
        array = (array.astype(np.float64) * 255 / max(int(array.max()), 1)).astype(np.uint8)
    if array.ndim == 3:
        array = cv2.cvtColor(np.ascontiguousarray(array), cv2.COLOR_BGR2GRAY)
    return np.ascontiguousarray(array, dtype=np.uint8)


def _describe_remedy(shape: tuple[int, ...]) -> str:
    """Return the remedy for an image of a wrong shape; empty if none is known."""
    if len(shape) == 3 and shape[2] == 4:
        return ": leave transparency out, image[..., :3]"
    if len(shape) == 3 and shape[0] in (1, 3):
        return ": the colours must be the last axis, np.moveaxis(image, 0, -1)"
    if len(shape) > 2 and shape[0] > 1:
        return ": one image at a time"
    return ""
