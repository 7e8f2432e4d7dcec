"""Profile as a range image with one row, and its connected components.

Each column is a point; ranges are measured along the mean ray of the sensor, so that rotating the
points about its origin changes nothing. Neighbours are connected unless there is a step or a large
gap between them. Jumps, which are isolated points away from the line, are first removed by a median
filter.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import cv2
import numpy as np

from lsvision.geometry import BoolArray, IntArray
from lsvision.geometry.noisy_points import rotate_to_ray_frame
from lsvision.profile import PreparedProfile

JUMP_SIGMAS = 6.0
"""Distance of a point from the median-filtered line above which it is a jump, in standard
deviations of the noise. With 4 or 8 the same pipes are found
(jumps of 2 to 12 mm): smaller jumps are outliers of the fits."""
JUMP_PITCHES = 0.5
"""Number of pitches that are added to this distance: the top of a narrow crest is by as much above
the median of five points."""
MAX_ADJACENT_JUMPS = 2
"""Largest number of adjacent jumps that the median filter removes: it takes the median of 2 n + 1
points, of which n may be jumps. Longer runs are components of their own, too short for an arc."""


@dataclass(frozen=True, kw_only=True)
class RangeImageSettings:
    """Limits for connected components of a profile.

    Parameters
    ----------
    bridged_columns : int
        Largest number of consecutive lost columns between connected neighbours.
    step_slope : float
        Largest distance of connected neighbours along the mean ray, in pitches, to which the noise
        is added: the tangent of the steepest flank of a component (4: 76 deg). Rough identification
        extends an arc over steeper flanks.
    """

    bridged_columns: int = 5
    step_slope: float = 4.0


class RangeImage(NamedTuple):
    """Points of a profile that are not jumps.

    Parameters
    ----------
    indices : (k,) int ndarray
        Ascending indices of the points in the prepared profile.
    connected : (k - 1,) bool ndarray
        Whether each point is connected to the next one; empty without points.
    """

    indices: IntArray
    connected: BoolArray


def build_range_image(
    profile: PreparedProfile, settings: RangeImageSettings = RangeImageSettings()
) -> RangeImage:
    """Remove the jumps of a profile, and find out which points are connected to the next one."""
    valid, tolerance = profile.valid_indices, JUMP_SIGMAS * profile.noise_std
    if len(valid) == 0:
        return RangeImage(valid, np.zeros(0, dtype=bool))
    z = rotate_to_ray_frame(profile.noisy_points.z[valid], profile.ray)  # position + i range
    # Relative to a height of the profile: in OpenCV's float32, 400 mm would lose precision.
    heights = (z.imag - (z[0] + z[-1]).imag / 2).astype(np.float32)
    offsets = np.abs(heights - cv2.medianBlur(heights[None], 2 * MAX_ADJACENT_JUMPS + 1)[0])
    on_line = offsets <= tolerance + JUMP_PITCHES * profile.pitch
    indices, z = valid[on_line], z[on_line]
    step = z[1:] - z[:-1]
    connected = np.abs(step.imag) <= settings.step_slope * profile.pitch + tolerance
    # Neighbours beside n lost columns are n + 1 pitches apart, with a tolerance of half a pitch.
    connected &= np.abs(step.real) <= (settings.bridged_columns + 1.5) * profile.pitch
    return RangeImage(indices, connected)


def find_connected_components(range_image: RangeImage, smallest: int) -> list[IntArray]:
    """Return the indices of the points of each component with at least `smallest` points."""
    indices, connected = range_image
    cuts = (~connected).nonzero()[0] + 1
    bounds = pairwise([0, *cuts.tolist(), len(indices)])
    return [indices[start:stop] for start, stop in bounds if stop - start >= smallest]
