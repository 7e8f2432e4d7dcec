"""What the line does beyond the ends of an arc."""

import numpy as np

from lsvision.profile import PreparedProfile
from lsvision.shapes import IntArray
from lsvision.shapes.noisy_points import ComplexArray
from lsvision.statistics.robust import upper_median

MIN_CONTACT_POINTS = 3
"""So many connected points beyond an end tell a contact: a bead, a neighbour, a plate."""
MAX_GAP_PITCHES = 3.0
"""A next point further away than this many pitches of the arc's own end no longer follows."""


def neighbours_beyond_ends(
    profile: PreparedProfile, indices: IntArray, count: int
) -> tuple[ComplexArray, ComplexArray]:
    """The connected points before the start and after the end of an arc.

    Parameters
    ----------
    profile : PreparedProfile
        The profile.
    indices : (k,) int ndarray
        Points of the arc, rising.
    count : int
        Points to look at on each side.

    Returns
    -------
    before, after : (m,) complex ndarray
        x + iy, outwards from the arc, each within reach of the one before; jumps are left out.
        Units: mm.
    """
    first, last = np.searchsorted(profile.valid_indices, indices[[0, -1]]).tolist()
    before = profile.valid_indices[max(0, first - count) : first][::-1]
    after = profile.valid_indices[last + 1 : last + 1 + count]
    z = profile.noisy_points.z
    return (
        z[before[connected_run(profile, indices[::-1], before)]],
        z[after[connected_run(profile, indices, after)]],
    )


def connected_run(profile: PreparedProfile, own: IntArray, beyond: IntArray) -> IntArray:
    """Which of the points beyond the last of its own follow an arc, each within reach.

    Parameters
    ----------
    profile : PreparedProfile
        The profile.
    own : (k,) int ndarray
        Points of the arc, towards its end.
    beyond : (n,) int ndarray
        Points beyond that end, outwards.

    Returns
    -------
    (m,) int ndarray
        Positions in `beyond`.
    """
    z = profile.noisy_points.z
    steps = z[own[-12:]]
    reach = MAX_GAP_PITCHES * upper_median(np.abs(steps[1:] - steps[:-1]))
    last = complex(steps[-1])
    chain: list[int] = []
    for i, point in enumerate(z[beyond].tolist()):
        if abs(point - last) <= reach * (1.0 if chain else 1.5):
            chain.append(i)
            last = point
    return np.array(chain, dtype=int)
