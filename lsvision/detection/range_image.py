"""A profile drawn on a grid, and its connected components.

Drawing makes neighbourhood a matter of pixels: a lost column is bridged, a step cuts, and a
point that jumped away lies alone, whatever the order of the columns says.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from lsvision.profile import PreparedProfile
from lsvision.shapes import BoolArray, FloatArray, IntArray, Points
from lsvision.shapes.arrays import extent_of

MAX_SIDE_PX = 384
"""Pixels along X or Y at the most: components are cut by links, not by resolution."""
PIXELS_PER_POINT = 0.5
"""Pixel columns for each point: links are drawn as lines, so half the resolution loses none."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RangeImageSettings:
    """How a profile is cut into connected components.

    Parameters
    ----------
    bridged_columns : int
        Lost or jumped columns in a row that do not cut the line.
    step_slope : float
        Neighbours further apart in Y than this many pitches are cut: tan of the steepest
        flank that is followed (4: 76 deg). The rest of a flank is found by the arc's growth.
    step_sigmas : float
        Added to the step: multiples of the noise.
    """

    bridged_columns: int = 3
    step_slope: float = 4.0
    step_sigmas: float = 6.0


@dataclass(frozen=True, eq=False, slots=True)
class RangeImage:
    """A drawn profile that remembers which point made which pixel.

    Parameters
    ----------
    image : (h, w) uint8 ndarray
        255 where the line was drawn; row 0 is the far end (smallest y).
    indices : (k,) int ndarray
        Indices of the profile's points that lie in the image.
    pixels : (k, 2) int ndarray
        Column and row of each of them.
    pixel_mm : float
        Size of a pixel in both directions. Units: mm.
    """

    image: np.ndarray
    indices: IntArray
    pixels: IntArray
    pixel_mm: float


def rasterise(
    profile: PreparedProfile, settings: RangeImageSettings = RangeImageSettings()
) -> RangeImage:
    """Draw a profile: points that belong together become one connected stroke.

    Parameters
    ----------
    profile : PreparedProfile
        Its order is the order of drawing.
    settings : RangeImageSettings
        Where to bridge and where to cut.

    Returns
    -------
    RangeImage
        Empty (no indices) for a profile without valid points. Points far out of the middle
        98 % of Y (rubbish values) are left out.
    """
    indices = _valid_indices_in_range(profile)
    if len(indices) < 2:
        return RangeImage(np.zeros((1, 1), np.uint8), indices[:0], np.empty((0, 2), int), 1.0)
    points = profile.points[indices]
    pitch = profile.pitch
    pixel = max(pitch / PIXELS_PER_POINT, extent_of(points) / MAX_SIDE_PX)
    x, y = points.T
    pixels = np.rint((points - (x.min(), y.min())) / pixel).astype(np.int32) + 1
    image = np.zeros((pixels[:, 1].max() + 2, pixels[:, 0].max() + 2), np.uint8)
    step = settings.step_slope * pitch + settings.step_sigmas * profile.noise_std
    image[pixels[:, 1], pixels[:, 0]] = 255
    cv2.polylines(image, _polylines(points, pixels, pitch, step, settings), False, 255)
    return RangeImage(image, indices, pixels, pixel)


def connected_components(range_image: RangeImage, smallest: int) -> list[IntArray]:
    """Indices of the profile's points, one array a component, left to right.

    Parameters
    ----------
    range_image : RangeImage
        The drawn profile.
    smallest : int
        Components with fewer points are left out: jumps, dust.
    """
    if len(range_image.indices) == 0:
        return []
    # 16 bits hold every label of an image of this size, and OpenCV labels them on this thread:
    # for 32 bits it wakes its workers, which takes longer than the image.
    _, labels = cv2.connectedComponents(range_image.image, connectivity=8, ltype=cv2.CV_16U)
    label = labels[range_image.pixels[:, 1], range_image.pixels[:, 0]]
    order = label.argsort(kind="stable")
    ordered = label[order]
    cuts = (ordered[1:] != ordered[:-1]).nonzero()[0] + 1
    components = np.split(range_image.indices[order], cuts)
    return sorted((c for c in components if len(c) >= smallest), key=lambda c: int(c[0]))


def _valid_indices_in_range(profile: PreparedProfile) -> IntArray:
    valid = profile.valid_indices
    if len(valid) < 2:
        return valid
    z = profile.noisy_points.z[valid]
    outermost = len(z) // 100
    within = np.ones(len(z), dtype=bool)
    for values in (z.real, z.imag):
        ordered = np.partition(values, (outermost, len(z) - 1 - outermost))
        low, high = float(ordered[outermost]), float(ordered[-1 - outermost])
        margin = (high - low) + 10 * profile.pitch
        within &= (values >= low - margin) & (values <= high + margin)
    return valid[within]


def _polylines(
    points: Points, pixels: IntArray, pitch: float, step: float, settings: RangeImageSettings
) -> list[IntArray]:
    """Polylines through linked neighbours, and bridges over what does not belong."""

    def linked(skip: int) -> BoolArray:
        gap: FloatArray = np.abs(points[skip:] - points[:-skip])
        reach = (settings.bridged_columns + 1.5) * pitch
        near: BoolArray = (gap[:, 0] <= reach) & (gap[:, 1] <= step * max(1, skip - 1))
        return near

    cut = ~linked(1)
    strokes: list[IntArray] = np.split(pixels, cut.nonzero()[0] + 1)
    for skip in range(2, min(settings.bridged_columns + 1, len(points) - 1) + 1):
        over_a_cut = (linked(skip) & cut[: len(points) - skip]).nonzero()[0]
        strokes.extend(pixels[[i, i + skip]] for i in over_a_cut.tolist())
    return strokes
