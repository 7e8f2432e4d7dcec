"""Images as the target finders want them."""

import cv2
import numpy as np
import numpy.typing as npt

from lsvision.sensors.image_array import as_image


def grey_image(image: npt.ArrayLike) -> npt.NDArray[np.uint8]:
    """8-bit grey image of an 8- or 16-bit grey or colour one.

    Raises
    ------
    TypeError, ValueError
        If it is no image.
    """
    array = as_image(image)
    if array.dtype.kind == "f":
        raise TypeError(f"expected an image of uint8 or uint16, got {np.asarray(image).dtype}")
    if array.dtype == np.uint16:
        # 10- and 12-bit cameras fill the low bits: scale by what is there.
        array = (array.astype(np.float64) * (255 / max(int(array.max()), 1))).astype(np.uint8)
    if array.ndim == 3:
        array = cv2.cvtColor(np.ascontiguousarray(array), cv2.COLOR_BGR2GRAY)
    return np.ascontiguousarray(array, dtype=np.uint8)
