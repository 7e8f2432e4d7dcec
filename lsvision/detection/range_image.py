"""Profile as a range image of one row, and its connected components.

Each column is a point. Neighbours are connected unless there is a step or a large gap between them.
Jumps, which are isolated points off the line, are removed first by a median filter of the ranges.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import cv2
import numpy as np

from lsvision.geometry import BoolArray, IntArray
from lsvision.profile import PreparedProfile

JUMP_SIGMAS = 6.0
"""Distance from the median-filtered line above which a point is a jump, in standard deviations of
the noise."""
JUMP_PITCHES = 0.5
"""Pitches that are added to this distance: height of a narrow crest above the median of five
points."""
MAX_ADJACENT_JUMPS = 2
"""Number of adjacent jumps that the median filter removes."""


@dataclass(frozen=True, kw_only=True)
class RangeImageSettings:
    """Limits for connected components of a profile.

    Parameters
    ----------
    bridged_columns : int
        Largest number of consecutive lost columns between connected neighbours.
    step_slope : float
        Largest distance of connected neighbours along Y, in pitches: tangent of the steepest
        flank of a component (4: 76 deg). The growing of arcs adds the steeper rest of a flank.
    """

    bridged_columns: int = 5
    step_slope: float = 4.0


class RangeImage(NamedTuple):
    """Indices (k,) of the points without jumps; whether each is connected to the next."""

    indices: IntArray
    connected: BoolArray


def build_range_image(
    profile: PreparedProfile, settings: RangeImageSettings = RangeImageSettings()
) -> RangeImage:
    """Return the points that are not jumps, and which of them are connected to the next."""
    valid, tolerance = profile.valid_indices, JUMP_SIGMAS * profile.noise_std
    if len(valid) == 0:
        return RangeImage(valid, np.zeros(0, dtype=bool))
    z = profile.noisy_points.z[valid]  # x + iy
    # OpenCV uses float32: without subtracting a height, heights near 400 mm would lose precision.
    heights = (z.imag - (z[0] + z[-1]).imag / 2).astype(np.float32)
    jump = np.abs(heights - cv2.medianBlur(heights[None], 2 * MAX_ADJACENT_JUMPS + 1)[0])
    on_line = jump <= tolerance + JUMP_PITCHES * profile.pitch
    indices, z = valid[on_line], z[on_line]
    step = z[1:] - z[:-1]
    connected = np.abs(step.imag) <= settings.step_slope * profile.pitch + tolerance
    connected &= np.abs(step.real) <= (settings.bridged_columns + 1 + 0.5) * profile.pitch
    return RangeImage(indices, connected)


def connected_components(range_image: RangeImage, smallest: int) -> list[IntArray]:
    """Return the indices of each component of `smallest` points or more."""
    indices, connected = range_image
    cuts = (~connected).nonzero()[0] + 1
    bounds = pairwise([0, *cuts.tolist(), len(indices)])
    return [indices[start:stop] for start, stop in bounds if stop - start >= smallest]
