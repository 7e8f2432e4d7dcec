"""The last points of an arc: single ones behind a gap, far out where the line grazes.

There a point's error along its ray hardly moves it across the surface: one such point tells more
of an ellipse than ten on its crest. Growth stops before them, because a jump might look the same
to an ellipse that is unsure of itself so far out; here the ellipse is that of the whole arc.
"""

import numpy as np

from lsvision.fitting.quick_fit import compare, refine_quickly
from lsvision.profile import WeighedProfile
from lsvision.shapes import BoolArray, FloatArray, IntArray

FARTHEST_COLUMNS = 8
"""Beyond the end of an arc so many columns are looked at."""
ROUNDS = 6
SIGMAS = 3.0
"""Of the point and the ellipse together; a point further off does not belong to the arc."""
SUREST = 10.0
"""The ellipse must be known to so many of the point's own standard deviations: then a jump of 20
sigma along the ray leaves it by more than `SIGMAS`."""


def reach_out(
    profile: WeighedProfile, kept: IntArray, parameters: FloatArray, free_ends: tuple[bool, bool]
) -> IntArray:
    """Points of an arc with those just beyond its free ends that lie on its ellipse.

    Parameters
    ----------
    profile : WeighedProfile
        The profile.
    kept : (k,) int ndarray
        Indices of the arc's points, rising.
    parameters : (5,) ndarray
        Of its ellipse; see `lsvision.fitting.ellipse_parameters`. Units: mm.
    free_ends : (bool, bool)
        Whether nothing touches the arc at its start, and at its end.

    Returns
    -------
    (m,) int ndarray
        m >= k.
    """
    for _ in range(ROUNDS):
        beyond = _beyond(profile, kept, free_ends)
        if len(beyond) == 0 or not _near_ellipse(profile, beyond, parameters).any():
            break
        parameters, unsure = refine_quickly(profile.noisy[kept], parameters, 1)
        reached = beyond[_on_ellipse(profile, beyond, parameters, unsure)]
        if len(reached) == 0:
            break
        kept = np.sort(np.concatenate([kept, reached]))
    return kept


def _beyond(profile: WeighedProfile, kept: IntArray, free_ends: tuple[bool, bool]) -> IntArray:
    first, last = np.searchsorted(profile.order, kept[[0, -1]]).tolist()
    before = profile.order[max(0, first - FARTHEST_COLUMNS) : first] if free_ends[0] else kept[:0]
    after = profile.order[last + 1 : last + 1 + FARTHEST_COLUMNS] if free_ends[1] else kept[:0]
    return np.concatenate([
        before[before >= kept[0] - FARTHEST_COLUMNS], after[after <= kept[-1] + FARTHEST_COLUMNS]
    ])


def _near_ellipse(
    profile: WeighedProfile, beyond: IntArray, parameters: FloatArray
) -> BoolArray:
    """As near as `SIGMAS` allows to an ellipse that is as unsure as may be."""
    compared = compare(profile.noisy[beyond], parameters)
    near: BoolArray = compared.signed**2 < (2 * SIGMAS) ** 2 * (1 + SUREST**2) * compared.variances
    return near


def _on_ellipse(
    profile: WeighedProfile, beyond: IntArray, parameters: FloatArray, unsure: FloatArray
) -> BoolArray:
    compared = compare(profile.noisy[beyond], parameters)
    rows, own = compared.rows(), compared.variances
    of_ellipse = ((unsure @ rows) * rows).sum(axis=0)
    on_ellipse: BoolArray = (compared.signed**2 < SIGMAS**2 * (own + of_ellipse)) & (
        of_ellipse < SUREST**2 * own
    )
    return on_ellipse
