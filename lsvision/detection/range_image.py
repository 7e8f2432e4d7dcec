"""A profile as a range image of one row, and its connected components.

A column is a point; neighbours on one line are connected: lost points are bridged and a step
cuts. Points that jumped away are removed first by a median filter of the ranges.
"""

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from lsvision.geometry import BoolArray, IntArray
from lsvision.profile import PreparedProfile

JUMP_SIGMAS = 6.0
"""Multiple of the noise by which no point leaves the line."""
JUMP_PITCHES = 0.5
"""Added to it: a narrow crest is so much higher than the median of five of its points."""
MEDIAN_COLUMNS = 5
"""Width of the median filter: two jumps side by side are removed."""


@dataclass(frozen=True, kw_only=True)
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
    """Indices (k,) of the points on the line, without jumps; whether each is connected (k - 1,)."""

    indices: IntArray
    connected: BoolArray


def rasterise(
    profile: PreparedProfile, settings: RangeImageSettings = RangeImageSettings()
) -> RangeImage:
    """Remove the points that jumped away from the line, and connect neighbours."""
    valid, tolerance = profile.valid_indices, JUMP_SIGMAS * profile.noise_std
    if len(valid) == 0:
        return RangeImage(valid, np.zeros(0, dtype=bool))
    z = profile.noisy_points.z[valid]
    # float32: subtract a height of the line first, or 0.1 mm is lost at 400 mm.
    heights = (z.imag - (z[0] + z[-1]).imag / 2).astype(np.float32)
    jump = np.abs(heights - cv2.medianBlur(heights[None], MEDIAN_COLUMNS)[0])
    on_line = jump <= tolerance + JUMP_PITCHES * profile.pitch
    indices, z = valid[on_line], z[on_line]
    step = z[1:] - z[:-1]
    connected = np.abs(step.imag) <= settings.step_slope * profile.pitch + tolerance
    connected &= np.abs(step.real) <= (settings.bridged_columns + 1.5) * profile.pitch
    return RangeImage(indices, connected)


def connected_components(range_image: RangeImage, smallest: int) -> list[IntArray]:
    """Indices of the profile's points, in order, for each component of `smallest` or more points.

    Smaller ones are jumps and dust.
    """
    cuts = (~range_image.connected).nonzero()[0] + 1
    bounds = [0, *cuts.tolist(), len(range_image.indices)]
    return [
        range_image.indices[start:stop]
        for start, stop in pairwise(bounds)
        if stop - start >= smallest
    ]
