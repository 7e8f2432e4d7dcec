"""A profile rasterised into a range image of one row, and its connected components.

A column of the row is a point, the column between two points is set where they are neighbours on
one line: lost points are bridged and a step cuts. Points that jumped away are removed first by a
median filter of the ranges.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from lsvision.geometry import IntArray
from lsvision.profile import PreparedProfile

JUMP_SIGMAS = 6.0
"""Multiple of the noise by which no point leaves the line."""
JUMP_PITCHES = 0.5
"""Added to it: a narrow crest is so much higher than the median of five of its points."""
MAX_LABELS = 65_535
"""Of an image with labels of 16 bits."""
MEDIAN_COLUMNS = 5
"""Width of the median filter: two jumps side by side are removed."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RangeImageSettings:
    """How a profile is cut into connected components.

    Parameters
    ----------
    bridged_columns : int
        Lost columns in a row that do not cut the line.
    step_slope : float
        Neighbours further apart in Y than this many pitches are cut: tan of the steepest
        flank that is followed (4: 76 deg). The rest of a flank is found by the arc's growth.
    """

    bridged_columns: int = 5
    step_slope: float = 4.0


@dataclass(frozen=True, eq=False, slots=True)
class RangeImage:
    """The points on the line, and which of them are neighbours.

    Parameters
    ----------
    indices : (k,) int ndarray
        Of the profile's points, in order, without those that jumped away.
    image : (1, 2 k) uint8 ndarray
        255 at each even column, a point, and at each odd one whose two points are connected.
    """

    indices: IntArray
    image: np.ndarray


def rasterise(
    profile: PreparedProfile, settings: RangeImageSettings = RangeImageSettings()
) -> RangeImage:
    """Rasterise the points on the line, without jumps, and connect neighbours.

    Parameters
    ----------
    profile : PreparedProfile
        In order along the line.
    settings : RangeImageSettings
        Where to bridge and where to cut.
    """
    valid = profile.valid_indices
    if len(valid) == 0:
        return RangeImage(valid, np.zeros((1, 0), np.uint8))
    z, noise = profile.noisy_points.z[valid], JUMP_SIGMAS * profile.noise_std
    # float32: subtract a height of the line first, or 0.1 mm is lost at 400 mm.
    heights = (z.imag - (z[0] + z[-1]).imag / 2).astype(np.float32)
    middle = cv2.medianBlur(heights[None], MEDIAN_COLUMNS)[0]
    on_line = np.abs(heights - middle) <= noise + JUMP_PITCHES * profile.pitch
    indices, z = valid[on_line], z[on_line]
    step = z[1:] - z[:-1]
    near = np.abs(step.real) <= (settings.bridged_columns + 1.5) * profile.pitch
    near &= np.abs(step.imag) <= settings.step_slope * profile.pitch + noise
    image = np.zeros((1, 2 * len(indices)), np.uint8)
    image[0, ::2] = 255
    image[0, 1:-1:2] = np.where(near, 255, 0)
    return RangeImage(indices, image)


def connected_components(range_image: RangeImage, smallest: int) -> list[IntArray]:
    """Indices of the profile's points, one array a component, in order.

    Parameters
    ----------
    range_image : RangeImage
        The rasterised profile.
    smallest : int
        Components with fewer points are left out: jumps, dust.
    """
    if len(range_image.indices) == 0:
        return []
    # OpenCV labels 16 bits on this thread; for 32 bits it wakes its workers, which takes longer.
    labelled = range_image.image.shape[1] < MAX_LABELS
    depth = cv2.CV_16U if labelled else cv2.CV_32S
    _, labels = cv2.connectedComponents(range_image.image, connectivity=4, ltype=depth)
    own = labels[0, ::2]
    cuts = (own[1:] != own[:-1]).nonzero()[0] + 1
    components = np.split(range_image.indices, cuts)
    return [component for component in components if len(component) >= smallest]
