"""Every stretch of a profile that holds no cylinder, with one reason: never silence."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from lsvision.profile import Arc, WeighedProfile
from lsvision.recognition.verdict import Rejection, flatness_of, reason_for_leftover
from lsvision.shapes import IntArray

LARGEST_COMMON_SHARE = 0.5
"""A rejection that shares more of its points with a cylinder or another rejection is left out."""
FEWEST_POINTS = 8


class Accepted(Protocol):
    """What has been accepted as a cylinder: it rests on points."""

    @property
    def indices(self) -> IntArray:
        """Indices of the profile's points."""
        ...


def explain_leftovers(
    profile: WeighedProfile,
    components: list[IntArray],
    cylinders: Sequence[Accepted],
    rejections: list[Rejection],
    radius_range: tuple[float, float],
) -> list[Rejection]:
    """Rejections without repetition, and one for each stretch nothing was said of yet.

    Parameters
    ----------
    profile : WeighedProfile
        The profile.
    components : list of (k,) int ndarray
        Connected points.
    cylinders : sequence
        What was found.
    rejections : list of Rejection
        What was tried in vain, the most telling first.
    radius_range : tuple of float
        Units: mm.

    Returns
    -------
    list of Rejection
        In the order of the profile.
    """
    told = np.zeros(len(profile.points), dtype=bool)
    for cylinder in cylinders:
        told[cylinder.indices[0] : cylinder.indices[-1] + 1] = True
    kept: list[Rejection] = []
    for rejection in rejections:
        span = slice(rejection.arc.start, rejection.arc.stop)
        if told[span].mean() <= LARGEST_COMMON_SHARE:
            own = profile.points[span][np.isfinite(profile.points[span, 0])]
            flat = flatness_of(own, profile.noise_std)
            kept.append(Rejection(rejection.arc, flat or rejection.reason))
            told[span] = True
    for component in components:
        untold = np.flatnonzero(~told[component])
        for run in np.split(untold, np.flatnonzero(np.diff(untold) > 1) + 1):
            if len(run) >= FEWEST_POINTS:
                points = component[run]
                reason = reason_for_leftover(
                    profile.points[points], profile.noise_std, radius_range
                )
                kept.append(Rejection(Arc(int(points[0]), int(points[-1]) + 1), reason))
    return sorted(kept, key=lambda rejection: rejection.arc.start)
