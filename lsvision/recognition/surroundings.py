"""What the line does beyond the ends of an arc."""

import math

import numpy as np

from lsvision.fitting.scatter import median
from lsvision.profile import WeighedProfile
from lsvision.shapes import FloatArray, IntArray, Points

REACH_PITCHES = 3.0
"""A next point further away than this many pitches of the arc's own end no longer follows."""


def followers(profile: WeighedProfile, indices: IntArray, count: int) -> tuple[Points, Points]:
    """The connected points before the start and after the end of an arc.

    Parameters
    ----------
    profile : WeighedProfile
        The profile.
    indices : (k,) int ndarray
        Points of the arc, rising.
    count : int
        Points to look at on each side.

    Returns
    -------
    before, after : (m, 2) ndarray
        Outwards from the arc, each within reach of the one before; jumps are left out.
    """
    first = int(np.searchsorted(profile.order, indices[0]))
    last = int(np.searchsorted(profile.order, indices[-1]))
    before = profile.points[profile.order[max(0, first - count) : first]][::-1]
    after = profile.points[profile.order[last + 1 : last + 1 + count]]
    own = profile.points[indices]
    return _chain(own[::-1], before), _chain(own, after)


def _chain(own: Points, beyond: Points) -> Points:
    steps = own[-12:]
    pitch = median(np.hypot(*(steps[1:] - steps[:-1]).T))
    last = own[-1]
    chain: list[FloatArray] = []
    for point in beyond:
        if math.dist(point, last) <= REACH_PITCHES * pitch * (1.0 if chain else 1.5):
            chain.append(point)
            last = point
    return np.array(chain).reshape(-1, 2)
