"""The last points of an arc: single ones behind a gap, far out where the line grazes.

There a point's error along its ray hardly moves it across the surface: one such point tells more
of an ellipse than ten on its crest. Growth stops before them, because a jump might look the same
to an ellipse that is unsure of itself so far out; here the ellipse is that of the whole arc.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.fitting.ellipse_parameters import ellipse_of, is_ellipse, parameters_of
from lsvision.fitting.quick_fit import compare, refine_quickly
from lsvision.profile import Arc, WeighedProfile
from lsvision.recognition.identification import IdentifiedArc
from lsvision.recognition.surroundings import CONTACT_POINTS, following
from lsvision.shapes import BoolArray, FloatArray, IntArray

LEAST_FACING = 0.05
"""Cosine of the incidence, 87 deg, from which on no sensor sees a surface: a jump may look like
the last point of an arc, but on its dark side."""


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
        So many connected points beyond an end, two of them off the ellipse, tell that the line
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
    surest: float = 30.0
    contact_points: int = CONTACT_POINTS
    contact_sigmas: float = 3.0
    followers: int = 14
    rounds: int = 6


def reach_out(
    profile: WeighedProfile,
    arc: IdentifiedArc,
    covariance: FloatArray,
    settings: ReachingSettings = ReachingSettings(),
) -> IdentifiedArc:
    """An arc with the points just beyond its ends that lie on its ellipse.

    Parameters
    ----------
    profile : WeighedProfile
        The profile.
    arc : IdentifiedArc
        Screened; with the ellipse of its middle part.
    covariance : (5, 5) ndarray
        Of that ellipse; see `lsvision.fitting.ellipse_parameters`. Units: mm^2.
    settings : ReachingSettings
        How far, and how sure.

    Returns
    -------
    IdentifiedArc
        With as many points or more. An end stays where it is if the line goes on from there
        into something else.
    """
    kept, parameters = arc.indices, parameters_of(arc.ellipse)
    looks = _look_beyond(profile, kept, (-1, 1), (parameters, covariance), settings)
    sides = [look.side for look in looks if _may_be_reached(look)]
    for _ in range(settings.rounds if sides else 0):
        parameters, covariance = refine_quickly(profile.noisy[kept], parameters, 1)
        if not is_ellipse(parameters):
            return arc
        looks = _look_beyond(profile, kept, sides, (parameters, covariance), settings)
        reached = [_on_ellipse(look) for look in looks]
        if not any(map(len, reached)):
            break
        kept = np.sort(np.concatenate([kept, *reached]))
    if len(kept) == len(arc.indices):
        return arc
    return IdentifiedArc(Arc(int(kept[0]), int(kept[-1]) + 1), kept, ellipse_of(parameters))


@dataclass(frozen=True, eq=False, slots=True)
class _Look:
    """The points beyond an end, outwards, compared with an ellipse.

    `own` is the square of a point's distance, `unsure` the ellipse's variance there, both over
    the variance of the point itself; `lit` whether a sensor could see it on the ellipse.
    """

    profile: WeighedProfile
    side: int
    end: IntArray
    beyond: IntArray
    own: FloatArray
    unsure: FloatArray
    lit: BoolArray
    settings: ReachingSettings

    @property
    def misfit(self) -> FloatArray:
        """Square of the distance over the variance of point and ellipse together."""
        return self.own / (1 + self.unsure)

    def goes_on(self, reached: IntArray, count: int) -> bool:
        """Whether the line goes on beside the ellipse, from the end and the points reached.

        Those are among the first `count` that were looked at.
        """
        end, settings = np.concatenate([self.end, reached]), self.settings
        next_ones = slice(count, count + settings.followers)
        chain = following(self.profile, end, self.beyond[next_ones])
        beside = self.misfit[next_ones][chain] > settings.contact_sigmas**2
        return len(chain) >= settings.contact_points and int(beside.sum()) > 1


def _beyond(profile: WeighedProfile, kept: IntArray, side: int, columns: int) -> IntArray:
    """The points that are there in the next columns, outwards; side -1 is the start."""
    order, last = profile.order, int(kept[::side][-1])
    place = int(np.searchsorted(order, last))
    beyond = order[place + 1 : place + 1 + columns]
    if side < 0:
        beyond = order[max(place - columns, 0) : place][::-1]
    return beyond[np.abs(beyond - last) <= columns]


def _look_beyond(
    profile: WeighedProfile,
    kept: IntArray,
    sides: Sequence[int],
    fitted: tuple[FloatArray, FloatArray],
    settings: ReachingSettings,
) -> list[_Look]:
    """What lies beyond the ends, where anything does, and an ellipse with its covariance."""
    parts = [(side, _beyond(profile, kept, side, settings.columns)) for side in sides]
    points = profile.noisy[np.concatenate([part for _, part in parts])]
    if len(points) == 0:
        return []
    compared = compare(points, fitted[0])
    own = compared.signed**2 / compared.variances
    unsure = compared.variances_of_ellipse(fitted[1]) / compared.variances
    lit = points.facing(compared.normals) > LEAST_FACING
    looks, first = [], 0
    for side, part in parts:
        own_part = slice(first, first + len(part))
        first = own_part.stop
        numbers = (own[own_part], unsure[own_part], lit[own_part])
        looks.append(_Look(profile, side, kept[::side][-12:], part, *numbers, settings))
    return [look for look in looks if len(look.beyond)]


def _may_be_reached(look: _Look) -> bool:
    """Whether the ellipse of the middle part leaves it possible: then that of all points tells."""
    near = look.lit & (look.misfit < look.settings.sigmas**2)
    return bool(near.any()) and not look.goes_on(look.beyond[:0], 0)


def _on_ellipse(look: _Look) -> IntArray:
    """The points beyond an end that lie on the ellipse of the whole arc.

    None where the line goes on beside it, from the end or from the last of them.
    """
    settings = look.settings
    near = look.lit & (look.misfit < settings.sigmas**2) & (look.own < settings.jump_sigmas**2)
    on_ellipse = (near & (look.unsure < settings.surest**2)).nonzero()[0]
    if len(on_ellipse) == 0 or look.goes_on(look.beyond[:0], 0):
        return look.beyond[:0]
    reached: IntArray = look.beyond[on_ellipse]
    return look.beyond[:0] if look.goes_on(reached, int(on_ellipse[-1]) + 1) else reached
