"""Images of any depth in axes in pixels."""

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WHITE_PERCENTILE = 99.9
"""Percentile of an image deeper than 8 bit from which pixels are shown white."""


def show_photo(axes: "Axes", image: npt.ArrayLike) -> None:
    """Show an image in axes in pixels, (0, 0) at the centre of the top left pixel, v downwards.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Axes to draw into; x and y get the same scale. Units: px.
    image : (height, width) or (height, width, 3) array_like
        Image, channels in the order blue, green, red. 8 bit is shown as it is; deeper images are
        scaled, because cameras of 10 and 12 bit use the lower bits; NaN is shown black.
    """
    array = np.asarray(image)
    if array.dtype != np.uint8:
        array = np.nan_to_num(array.astype(np.float64), posinf=0.0, neginf=0.0)
        white = float(np.percentile(array, WHITE_PERCENTILE))
        white = white if white > 0 else 1.0  # a black image
        array = (np.clip(array / white, 0, 1) * 255).astype(np.uint8)
    rgb = array if array.ndim == 2 else array[..., ::-1]
    axes.imshow(rgb, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
    axes.set_xlabel("u / px")
    axes.set_ylabel("v / px")
