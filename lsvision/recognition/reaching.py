"""The last points of an arc: single ones behind a gap, far out where the line grazes.

There a point's error along its ray hardly moves it across the surface: one such point tells more
of an ellipse than ten on its crest. Growth stops before them, because a jump might look the same
to an ellipse that is unsure of itself so far out; here the ellipse is that of the whole arc.
"""

from dataclasses import dataclass

import numpy as np

from lsvision.fitting.ellipse_parameters import ellipse_of, is_ellipse, parameters_of
from lsvision.fitting.quick_fit import compare, refine_quickly
from lsvision.profile import Arc, WeighedProfile
from lsvision.recognition.identification import IdentifiedArc
from lsvision.recognition.surroundings import CONTACT_POINTS, following
from lsvision.shapes import FloatArray, IntArray

LEAST_FACING = 0.05
"""Cosine of the incidence, 87 deg, from which on no sensor sees a surface: a jump may look like
the last point of an arc, but on its dark side."""
WIDER = 10.0
"""By which the ellipse of the middle part may be further off than that of all points."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ReachingSettings:
    """How far an arc reaches for its last points.

    Parameters
    ----------
    columns : int
        So many are looked at beyond either end.
    sigmas : float
        Of a point and the ellipse together; a point further off does not belong to the arc.
    jump_sigmas : float
        Of the point alone: a point so far along its ray has jumped, however unsure the ellipse.
    surest : float
        The ellipse must be known to so many of the point's own standard deviations.
    contact_points : int
        So many connected points beyond an end, one of them off the ellipse, tell that the line
        goes on into something else.
    contact_sigmas : float
        Off the ellipse, of the point and the ellipse together.
    followers : int
        Connected points that are asked for that.
    rounds : int
        Each point that is reached makes the ellipse surer of the next.
    """

    columns: int = 14
    sigmas: float = 4.5
    jump_sigmas: float = 20.0
    surest: float = 15.0
    contact_points: int = CONTACT_POINTS
    contact_sigmas: float = 3.0
    followers: int = 14
    rounds: int = 6


def reach_out(
    profile: WeighedProfile, arc: IdentifiedArc, settings: ReachingSettings = ReachingSettings()
) -> IdentifiedArc:
    """An arc with the points just beyond its ends that lie on its ellipse.

    Parameters
    ----------
    profile : WeighedProfile
        The profile.
    arc : IdentifiedArc
        Screened; with the ellipse of its middle part.
    settings : ReachingSettings
        How far, and how sure.

    Returns
    -------
    IdentifiedArc
        With as many points or more. An end stays where it is if the line goes on from there
        into something else.
    """
    kept, parameters = arc.indices, parameters_of(arc.ellipse)
    for _ in range(settings.rounds):
        sides = [_beyond(profile, kept, side, settings.columns) for side in (-1, 1)]
        if not _worth_a_fit(profile, np.concatenate(sides), parameters, settings):
            break
        parameters, unsure = refine_quickly(profile.noisy[kept], parameters, 1)
        if not is_ellipse(parameters):
            return arc
        start, stop = (
            _on_ellipse(profile, own, beyond, (parameters, unsure), settings)
            for own, beyond in zip((kept[::-1], kept), sides, strict=True)
        )
        if len(start) + len(stop) == 0:
            break
        kept = np.concatenate([start[::-1], kept, stop])
    if len(kept) == len(arc.indices):
        return arc
    return IdentifiedArc(Arc(int(kept[0]), int(kept[-1]) + 1), kept, ellipse_of(parameters))


def _beyond(profile: WeighedProfile, kept: IntArray, side: int, columns: int) -> IntArray:
    """The points that are there in the next columns, outwards; side -1 is the start."""
    order, end = profile.order[::side], int(kept[::side][-1])
    first = int(np.searchsorted(side * order, side * end)) + 1
    beyond: IntArray = order[first : first + columns]
    return beyond[np.abs(beyond - end) <= columns]


def _worth_a_fit(
    profile: WeighedProfile,
    beyond: IntArray,
    parameters: FloatArray,
    settings: ReachingSettings,
) -> bool:
    """Whether any point is near enough to the middle part's ellipse for that of the whole arc."""
    compared = compare(profile.noisy[beyond], parameters)
    limit = (WIDER * settings.jump_sigmas) ** 2
    return bool((compared.signed**2 < limit * compared.variances).any())


def _on_ellipse(
    profile: WeighedProfile,
    own: IntArray,
    beyond: IntArray,
    fitted: tuple[FloatArray, FloatArray],
    settings: ReachingSettings,
) -> IntArray:
    """Points beyond the end of its own that lie on the ellipse, known with its covariance.

    None where the line goes on beside it, from there or from the last of them.
    """
    compared = compare(profile.noisy[beyond], fitted[0])
    variances, squares = compared.variances, compared.signed**2
    of_ellipse = compared.variances_of_ellipse(fitted[1])
    misfit = squares / (variances + of_ellipse)
    sure = of_ellipse < settings.surest**2 * variances
    near = (misfit < settings.sigmas**2) & (squares < settings.jump_sigmas**2 * variances)
    near &= profile.noisy[beyond].facing(compared.normals) > LEAST_FACING
    count = int(np.flatnonzero(near & sure).max(initial=-1)) + 1
    reached: IntArray = beyond[:count][(near & sure)[:count]]
    for end, start in ((own, 0), (np.concatenate([own, reached]), count)):
        chain = following(profile, end, beyond[start : start + settings.followers])
        beside = misfit[start:][chain] > settings.contact_sigmas**2
        if len(chain) >= settings.contact_points and beside.any():
            return beyond[:0]
    return reached
