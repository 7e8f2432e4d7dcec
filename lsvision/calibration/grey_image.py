"""Grey images of 8 bit, in which targets are detected, from the images of a caller."""

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.laser_line.image_array import as_image


def grey_image(image: npt.ArrayLike) -> npt.NDArray[np.uint8]:
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
