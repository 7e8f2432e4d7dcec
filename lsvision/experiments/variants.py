"""Chains with one step left out, or done as the paper's text has it, on one arc in hand."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from lsvision.detection.identification import IdentifiedArc
from lsvision.detection.screening import screen_arc
from lsvision.ellipse.conditioning import ConditionedArc, condition_arc
from lsvision.ellipse.fit import FittingSettings, fit_ellipse
from lsvision.ellipse.homogenising import homogenise_profile_paper
from lsvision.ellipse.smoothing import smooth_profile_paper
from lsvision.paper_pipeline import PaperSettings
from lsvision.profile import Arc, PreparedProfile
from lsvision.shapes import Ellipse, IntArray, Points, radial_residuals

RADIAL = FittingSettings(residual="radial")


@dataclass(frozen=True, eq=False)
class AblationArc:
    """A pipe's arc before screening, with what the steps make of it.

    Parameters
    ----------
    profile : PreparedProfile
        The section's.
    arc : IdentifiedArc
        From rough identification.
    seed : IdentifiedArc
        The candidate it grew from.
    """

    profile: PreparedProfile
    arc: IdentifiedArc
    seed: IdentifiedArc

    @cached_property
    def screened(self) -> IdentifiedArc:
        """After accurate screening."""
        return screen_arc(self.profile, self.arc)

    def condition(self, arc: IdentifiedArc) -> ConditionedArc:
        """Smoothed and homogenised."""
        return condition_arc(self.profile.noisy_points[arc.indices], arc.ellipse)

    def points(self, indices: IntArray) -> Points:
        """(k, 2) points of the profile. Units: mm."""
        points: Points = self.profile.points[indices]
        return points

    def finish(self, arc: IdentifiedArc) -> Ellipse:
        """Condition and fit: the end of the chain, from any arc."""
        conditioned = self.condition(arc)
        return self.fit(arc.indices[conditioned.inliers], conditioned.ellipse)

    def fit(self, indices: IntArray, start: Ellipse) -> Ellipse:
        """The weighted orthogonal fit."""
        covariances = self.profile.covariances[indices]
        return fit_ellipse(self.points(indices), start, covariances).ellipse


@dataclass(frozen=True, slots=True)
class Variant:
    """A chain with one step changed.

    Parameters
    ----------
    group : str
        "as it is", "left out" or "as the paper has it".
    name : str
        In plain words.
    ellipse_of : callable
        Makes an ellipse of an `AblationArc`.
    """

    group: str
    name: str
    ellipse_of: Callable[[AblationArc], Ellipse]


def _without_smoothing(arc: AblationArc) -> Ellipse:
    return arc.fit(arc.screened.indices, arc.screened.ellipse)


def _without_homogenising(arc: AblationArc) -> Ellipse:
    kept = arc.condition(arc.screened).inliers
    return arc.fit(arc.screened.indices[kept], arc.screened.ellipse)


def _kept(arc: AblationArc) -> IntArray:
    indices: IntArray = arc.screened.indices[arc.condition(arc.screened).inliers]
    return indices


def _direct_fit(arc: AblationArc) -> Ellipse:
    """OpenCV's algebraic fit, about the centroid because it works in float32."""
    points = arc.points(_kept(arc))
    middle = points.mean(axis=0)
    fitted = cv2.fitEllipseDirect((points - middle).astype(np.float32))
    (x, y), (first, second), turn_deg = fitted
    centre = (float(x + middle[0]), float(y + middle[1]))
    if not (math.isfinite(first) and min(first, second) > 0):
        return arc.screened.ellipse
    return Ellipse.from_axes(centre, first / 2, second / 2, math.radians(turn_deg))


def _equal_weights(arc: AblationArc) -> Ellipse:
    return fit_ellipse(arc.points(_kept(arc)), arc.screened.ellipse).ellipse


def _radial(arc: AblationArc) -> Ellipse:
    return fit_ellipse(arc.points(_kept(arc)), arc.screened.ellipse, settings=RADIAL).ellipse


def _fixed_sensor_error(arc: AblationArc) -> Ellipse:
    """Screening with one limit in mm, Figure 9."""
    literal, indices = PaperSettings(), arc.arc.indices
    part = max(1, round(literal.end_part_fraction * len(indices)))
    middle = fit_ellipse(arc.points(indices[part:-part]), arc.arc.ellipse, settings=RADIAL).ellipse
    kept = np.abs(radial_residuals(arc.points(indices), middle)) < literal.sensor_error_mm
    kept[part:-part] = True
    span = Arc(int(indices[kept][0]), int(indices[kept][-1]) + 1)
    return arc.finish(IdentifiedArc(span, indices[kept], middle))


def _smoothed_over_x(arc: AblationArc) -> Ellipse:
    smooth = smooth_profile_paper(_by_x(arc.points(_kept(arc))))
    return fit_ellipse(smooth, arc.screened.ellipse).ellipse


def _homogenised_over_x(arc: AblationArc) -> Ellipse:
    even = homogenise_profile_paper(_by_x(arc.points(_kept(arc))))
    return fit_ellipse(even, arc.screened.ellipse).ellipse


def _all_of_it(arc: AblationArc) -> Ellipse:
    """Sections 3.3 and 2.3 to the letter, on an arc that is found and screened as ours."""
    smooth = smooth_profile_paper(_by_x(arc.points(arc.screened.indices)))
    even = homogenise_profile_paper(smooth)
    return fit_ellipse(even, arc.screened.ellipse, settings=RADIAL).ellipse


def _by_x(points: Points) -> Points:
    ordered: Points = points[np.argsort(points[:, 0], kind="stable")]
    return ordered


LEFT_OUT, AS_PAPER = "left out", "as the paper has it"
VARIANTS = (
    Variant("as it is", "every step, as lsvision does it", lambda arc: arc.finish(arc.screened)),
    Variant(LEFT_OUT, "rough identification: the first candidate is the arc",
            lambda arc: arc.finish(screen_arc(arc.profile, arc.seed))),
    Variant(LEFT_OUT, "accurate screening", lambda arc: arc.finish(arc.arc)),
    Variant(LEFT_OUT, "smoothing", _without_smoothing),
    Variant(LEFT_OUT, "homogenising", _without_homogenising),
    Variant(LEFT_OUT, "iterative fit: a direct algebraic one instead", _direct_fit),
    Variant(AS_PAPER, "screening with one sensor error of 0.9 mm", _fixed_sensor_error),
    Variant(AS_PAPER, "smoothing y over x", _smoothed_over_x),
    Variant(AS_PAPER, "homogenising over x", _homogenised_over_x),
    Variant(AS_PAPER, "all points of equal weight", _equal_weights),
    Variant(AS_PAPER, "equal weights and radial residuals, Eq. (4)", _radial),
    Variant(AS_PAPER, "sections 3.3 and 2.3 to the letter", _all_of_it),
)  # fmt: skip
"""In the order of the report."""
