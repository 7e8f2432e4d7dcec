"""Images as the target finders want them."""

import cv2
import numpy as np
import numpy.typing as npt


def grey_image(image: npt.ArrayLike) -> npt.NDArray[np.uint8]:
    """8-bit grey image of an 8- or 16-bit grey or colour one.

    Raises
    ------
    TypeError, ValueError
        If it is no image.
    """
    array = np.asarray(image)
    if array.ndim not in (2, 3) or 0 in array.shape or (array.ndim == 3 and array.shape[2] != 3):
        raise ValueError(
            f"want an image (height, width) or (height, width, 3), got shape {array.shape}"
        )
    if array.dtype not in (np.uint8, np.uint16):
        raise TypeError(f"want an image of uint8 or uint16, got {array.dtype}")
    if array.dtype == np.uint16:
        # 10- and 12-bit cameras fill the low bits: scale by what is there.
        array = (array.astype(np.float64) * (255 / max(int(array.max()), 1))).astype(np.uint8)
    if array.ndim == 3:
        array = cv2.cvtColor(np.ascontiguousarray(array), cv2.COLOR_BGR2GRAY)
    return np.ascontiguousarray(array, dtype=np.uint8)
