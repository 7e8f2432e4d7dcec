"""From any image to the one channel in which the laser line runs from left to right."""

from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

Channel = Literal["grey", "red", "green", "blue", "white"]
Direction = Literal["columns", "rows"]
Image = npt.NDArray[Any]

# Excess of the laser's colour over the mean of the other two: grey surroundings vanish.
# Order of OpenCV: blue, green, red.
MIXTURES: dict[str, tuple[float, float, float]] = {
    "red": (-0.5, -0.5, 1.0),
    "green": (-0.5, 1.0, -0.5),
    "blue": (1.0, -0.5, -0.5),
    "white": (1 / 3, 1 / 3, 1 / 3),
}
MAX_LEVEL = 1e30
"""Largest number of a float image, which is kept in single precision."""
FULL_SCALES = (1023, 4095, 16383, 65535)
"""Full scales of 10, 12, 14 and 16 bit."""


@dataclass(frozen=True, eq=False)
class LineImage:
    """What the extraction works on.

    Parameters
    ----------
    signal : (height, width) ndarray
        uint8, int16 or float32; the laser's light, in colour images the excess of its colour.
        Units: DN.
    channel_signal : (height, width) ndarray
        The same without regard to the other colours: where a line is white-hot its colour is
        lost, and its shape is only here. Units: DN.
    raw_channel : (height, width) ndarray
        The laser's own channel as recorded, for saturation. Units: DN.
    full_scale : float
        Largest recordable number. Units: DN.
    """

    signal: Image
    channel_signal: Image
    raw_channel: Image
    full_scale: float

    def transposed(self) -> "LineImage":
        """Rows for columns."""
        turned = np.ascontiguousarray(self.signal.T)
        own = (
            turned
            if self.channel_signal is self.signal
            else np.ascontiguousarray(self.channel_signal.T)
        )
        same = self.raw_channel is self.signal
        recorded = turned if same else np.ascontiguousarray(self.raw_channel.T)
        return LineImage(turned, own, recorded, self.full_scale)


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
        The same view without the laser; subtracted.
    channel : {"grey", "red", "green", "blue", "white"}
        The laser's colour; "grey" for a camera without colours.
    full_scale : float, optional
        Largest recordable number. By default 255 for uint8; for uint16 the least of 10, 12,
        14 and 16 bit that holds the image. Units: DN.

    Returns
    -------
    LineImage
        Its `signal` still lies as the image does.

    Raises
    ------
    TypeError
        If the numbers are no image's, or a float image comes without `full_scale`.
    ValueError
        If the shape is no image's, colour and `channel` disagree, or `laser_off` differs in
        shape or type.
    """
    array = _checked(image, "image")
    scale = _full_scale(array, full_scale)
    signal, own = _laser_light(array, channel)
    if laser_off is None:
        return LineImage(signal, own, own, scale)
    dark = _checked(laser_off, "laser_off")
    if dark.shape != array.shape or dark.dtype != array.dtype:
        raise ValueError(
            f"want a laser_off frame like the image, {array.shape} {array.dtype}, got "
            f"{dark.shape} {dark.dtype}"
        )
    lit, unlit = (signal, own), _laser_light(dark, channel)
    depth = cv2.CV_16S if array.dtype == np.uint8 else cv2.CV_32F
    less = [cv2.subtract(on, off, dtype=depth) for on, off in zip(lit, unlit, strict=True)]
    return LineImage(less[0], less[0] if own is signal else less[1], own, scale)


def _checked(image: npt.ArrayLike, name: str) -> Image:
    """The image as uint8, uint16 or float32, of a shape that is one."""
    array = np.asarray(image)
    if array.dtype not in (np.uint8, np.uint16) and array.dtype.kind != "f":
        raise TypeError(f"want {name} of uint8, uint16 or float, got {array.dtype}")
    colours = array.ndim == 3 and array.shape[2] == 3
    if array.ndim == 3 and array.shape[2] == 1:
        array = array[:, :, 0]
    if not (array.ndim == 2 or colours) or min(array.shape[:2], default=0) < 16:
        raise ValueError(
            f"want {name} of shape (height, width) or (height, width, 3), 16 px or more each "
            f"way, got {array.shape}"
        )
    if array.dtype in (np.uint8, np.uint16):
        return np.ascontiguousarray(array)
    if not (np.abs(array) <= MAX_LEVEL).all():
        raise ValueError(
            f"want finite numbers up to {MAX_LEVEL:g} in a float {name}, got NaN, infinity or more"
        )
    return np.ascontiguousarray(array, dtype=np.float32)


def _full_scale(array: Image, stated: float | None) -> float:
    if stated is not None:
        return float(stated)
    if array.dtype == np.uint8:
        return 255.0
    if array.dtype == np.uint16:
        brightest = int(array.max())
        return float(next(depth for depth in FULL_SCALES if depth >= brightest))
    raise TypeError(
        "want full_scale beside a float image (its largest recordable number), got None: "
        "LineSettings(full_scale=...)"
    )


def _laser_light(array: Image, channel: Channel) -> tuple[Image, Image]:
    """The laser's light: excess of its colour, and its own channel; the same if grey."""
    if array.ndim == 2:
        if channel not in ("grey", "white"):
            raise ValueError(
                f'want a colour image for channel="{channel}", got a grey one of shape '
                f'{array.shape}: use channel="grey"'
            )
        return array, array
    if channel == "grey":
        return (_grey_of(array),) * 2
    mixture = np.array(MIXTURES[channel], dtype=np.float32)
    mixed: Image = cv2.transform(array, mixture[None])
    if channel == "white":
        return mixed, mixed
    return mixed, np.ascontiguousarray(array[:, :, int(np.argmax(mixture))])


def _grey_of(array: Image) -> Image:
    """The one channel of a grey image that is stored as three."""
    first = array[..., 0]
    if np.array_equal(first, array[..., 1]) and np.array_equal(first, array[..., 2]):
        return np.ascontiguousarray(first)
    raise ValueError(
        f"want a grey image, got colours of shape {array.shape}: name the laser's colour, "
        'LineSettings(channel="red"), "green", "blue" or "white"'
    )
