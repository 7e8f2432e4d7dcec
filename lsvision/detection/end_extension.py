"""The last points of an arc: single ones behind a gap, far out where the line grazes.

There a point's error along its ray hardly moves it across the surface: one such point tells more
of an ellipse than ten on its crest. Growth stops before them, because a jump might look the same
to an ellipse that is unsure of itself so far out; here the ellipse is that of the whole arc.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.detection.arc_neighbours import MIN_CONTACT_POINTS, connected_run
from lsvision.detection.identification import IdentifiedArc
from lsvision.ellipse.parameters import ellipse_from_parameters, is_ellipse, parameters_from_ellipse
from lsvision.ellipse.robust_gauss_newton import ellipse_residuals, refine_ellipse
from lsvision.profile import Arc, PreparedProfile
from lsvision.shapes import BoolArray, FloatArray, IntArray

MIN_INCIDENCE_COSINE = 0.05
"""Cosine of the incidence, 87 deg, from which on no sensor sees a surface: a jump may look like
the last point of an arc, but on its dark side."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EndExtensionSettings:
    """How far an arc reaches for its last points.

    Parameters
    ----------
    search_columns : int
        So many are looked at beyond either end.
    inlier_sigmas : float
        Of a point and the ellipse together; a point further off does not belong to the arc.
    jump_sigmas : float
        Of the point alone: a point so far along its ray has jumped, however unsure the ellipse.
    max_prediction_std_ratio : float
        The ellipse must be known to so many of the point's own standard deviations.
    contact_points : int
        So many connected points beyond an end, two of them off the ellipse, tell that the line
        goes on into something else.
    contact_sigmas : float
        Off the ellipse, of the point and the ellipse together.
    contact_search_points : int
        Connected points that are asked for that.
    max_iterations : int
        Each point that is reached makes the ellipse surer of the next.
    """

    search_columns: int = 14
    inlier_sigmas: float = 4.5
    jump_sigmas: float = 20.0
    max_prediction_std_ratio: float = 30.0
    contact_points: int = MIN_CONTACT_POINTS
    contact_sigmas: float = 3.0
    contact_search_points: int = 14
    max_iterations: int = 6


def extend_ends(
    profile: PreparedProfile,
    arc: IdentifiedArc,
    covariance: FloatArray,
    settings: EndExtensionSettings = EndExtensionSettings(),
) -> IdentifiedArc:
    """An arc with the points just beyond its ends that lie on its ellipse.

    Parameters
    ----------
    profile : PreparedProfile
        The profile.
    arc : IdentifiedArc
        Screened; with the ellipse of its middle part.
    covariance : (5, 5) ndarray
        Of that ellipse; see `lsvision.ellipse.parameters`. Units: mm^2.
    settings : EndExtensionSettings
        How far, and how sure.

    Returns
    -------
    IdentifiedArc
        With as many points or more. An end stays where it is if the line goes on from there
        into something else.
    """
    kept, parameters = arc.indices, parameters_from_ellipse(arc.ellipse)
    looks = _end_neighbourhoods(profile, kept, (-1, 1), (parameters, covariance), settings)
    sides = [look.side for look in looks if _has_possible_inliers(look)]
    for _ in range(settings.max_iterations if sides else 0):
        parameters, covariance = refine_ellipse(profile.noisy_points[kept], parameters, 1)
        if not is_ellipse(parameters):
            return arc
        looks = _end_neighbourhoods(profile, kept, sides, (parameters, covariance), settings)
        reached = [_ellipse_inliers(look) for look in looks]
        if not any(map(len, reached)):
            break
        kept = np.sort(np.concatenate([kept, *reached]))
    if len(kept) == len(arc.indices):
        return arc
    return IdentifiedArc(
        Arc(int(kept[0]), int(kept[-1]) + 1), kept, ellipse_from_parameters(parameters)
    )


@dataclass(frozen=True, eq=False, slots=True)
class _EndNeighbourhood:
    """The points beyond an end, outwards, compared with an ellipse.

    `normalised_squares` is the square of a point's distance, `prediction_variance_ratio` the
    ellipse's variance there, both over the variance of the point itself; `faces_sensor` whether
    a sensor could see it on the ellipse.
    """

    profile: PreparedProfile
    side: int
    end_indices: IntArray
    candidate_indices: IntArray
    normalised_squares: FloatArray
    prediction_variance_ratio: FloatArray
    faces_sensor: BoolArray
    settings: EndExtensionSettings

    @property
    def mahalanobis_squared(self) -> FloatArray:
        """Square of the distance over the variance of point and ellipse together."""
        return self.normalised_squares / (1 + self.prediction_variance_ratio)

    def line_continues(self, reached: IntArray, count: int) -> bool:
        """Whether the line goes on beside the ellipse, from the end and the points reached.

        Those are among the first `count` that were looked at.
        """
        end, settings = np.concatenate([self.end_indices, reached]), self.settings
        next_ones = slice(count, count + settings.contact_search_points)
        chain = connected_run(self.profile, end, self.candidate_indices[next_ones])
        beside = self.mahalanobis_squared[next_ones][chain] > settings.contact_sigmas**2
        return len(chain) >= settings.contact_points and int(beside.sum()) > 1


def _next_indices(profile: PreparedProfile, kept: IntArray, side: int, columns: int) -> IntArray:
    """The points that are there in the next columns, outwards; side -1 is the start."""
    order, last = profile.valid_indices, int(kept[::side][-1])
    place = int(np.searchsorted(order, last))
    beyond = order[place + 1 : place + 1 + columns]
    if side < 0:
        beyond = order[max(place - columns, 0) : place][::-1]
    return beyond[np.abs(beyond - last) <= columns]


def _end_neighbourhoods(
    profile: PreparedProfile,
    kept: IntArray,
    sides: Sequence[int],
    fitted: tuple[FloatArray, FloatArray],
    settings: EndExtensionSettings,
) -> list[_EndNeighbourhood]:
    """What lies beyond the ends, where anything does, and an ellipse with its covariance."""
    parts = [(side, _next_indices(profile, kept, side, settings.search_columns)) for side in sides]
    points = profile.noisy_points[np.concatenate([part for _, part in parts])]
    if len(points) == 0:
        return []
    compared = ellipse_residuals(points, fitted[0])
    own = compared.residuals**2 / compared.variances
    unsure = compared.prediction_variances(fitted[1]) / compared.variances
    lit = points.incidence_cosines(compared.normals) > MIN_INCIDENCE_COSINE
    looks, first = [], 0
    for side, part in parts:
        own_part = slice(first, first + len(part))
        first = own_part.stop
        numbers = (own[own_part], unsure[own_part], lit[own_part])
        looks.append(_EndNeighbourhood(profile, side, kept[::side][-12:], part, *numbers, settings))
    return [look for look in looks if len(look.candidate_indices)]


def _has_possible_inliers(look: _EndNeighbourhood) -> bool:
    """Whether the ellipse of the middle part leaves it possible: then that of all points tells."""
    near = look.faces_sensor & (look.mahalanobis_squared < look.settings.inlier_sigmas**2)
    return bool(near.any()) and not look.line_continues(look.candidate_indices[:0], 0)


def _ellipse_inliers(look: _EndNeighbourhood) -> IntArray:
    """The points beyond an end that lie on the ellipse of the whole arc.

    None where the line goes on beside it, from the end or from the last of them.
    """
    settings = look.settings
    near = (
        look.faces_sensor
        & (look.mahalanobis_squared < settings.inlier_sigmas**2)
        & (look.normalised_squares < settings.jump_sigmas**2)
    )
    on_ellipse = (
        near & (look.prediction_variance_ratio < settings.max_prediction_std_ratio**2)
    ).nonzero()[0]
    if len(on_ellipse) == 0 or look.line_continues(look.candidate_indices[:0], 0):
        return look.candidate_indices[:0]
    reached: IntArray = look.candidate_indices[on_ellipse]
    return (
        look.candidate_indices[:0]
        if look.line_continues(reached, int(on_ellipse[-1]) + 1)
        else reached
    )
