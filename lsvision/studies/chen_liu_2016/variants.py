"""Chains with one step left out, or done as the paper's text has it, on one arc in hand."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from lsvision.detection.arcs import IdentifiedArc
from lsvision.detection.screening import ScreenedArc, screen_arc
from lsvision.ellipse.fit import EllipseFit, fit_ellipse, fit_noisy_points
from lsvision.ellipse.homogenising import homogenise_arc, homogenise_profile_paper
from lsvision.ellipse.parameters import parameters_from_ellipse
from lsvision.ellipse.problem import least_squares
from lsvision.ellipse.smoothing import SmoothedArc, smooth_arc, smooth_profile_paper
from lsvision.errors import FitFailed
from lsvision.geometry import Ellipse, FloatArray, Points, radial_residuals
from lsvision.geometry.noisy_points import NoisyPoints, as_vectors
from lsvision.measure import Settings
from lsvision.paper_pipeline import PaperSettings
from lsvision.profile import PreparedProfile

FITTING = Settings().fitting
"""Every variant ends in the fit of lsvision's own chain, but for what the variant changes."""
RADIAL = replace(FITTING, residual="radial")


@dataclass(frozen=True, slots=True)
class VariantFit:
    """What a variant makes of an arc.

    Parameters
    ----------
    ellipse : Ellipse
        Units: mm, rad.
    evaluations : int
        Of the residuals in its iterative fit; 0 without one.
    """

    ellipse: Ellipse
    evaluations: int


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
    def screened(self) -> ScreenedArc:
        """After accurate screening."""
        return self.screen(self.arc)

    @cached_property
    def smoothed(self) -> SmoothedArc:
        """After smoothing."""
        return smooth_arc(self.screened.points, self.screened.ellipse)

    @property
    def inliers(self) -> NoisyPoints:
        """Screened points that are no jumps."""
        return self.screened.points[self.smoothed.inliers]

    @property
    def initial_guess(self) -> Ellipse:
        """After homogenising."""
        return homogenise_arc(self.smoothed).ellipse

    def screen(self, arc: IdentifiedArc) -> ScreenedArc:
        """Accurate screening of any arc."""
        screened = screen_arc(self.profile, arc)
        if screened is None:
            raise FitFailed("no ellipse fits the middle part of the arc")
        return screened

    @cached_property
    def with_jumps(self) -> "AblationArc":
        """The same arc with every point of its span, jumps too."""
        valid = self.profile.valid_indices
        inside = (valid >= self.arc.arc.start) & (valid < self.arc.arc.stop)
        whole = IdentifiedArc.of(valid[inside], self.arc.ellipse)
        return AblationArc(self.profile, whole, self.seed)

    def take(self, arc: IdentifiedArc) -> ScreenedArc:
        """An arc as it is, without screening."""
        return ScreenedArc(
            arc.indices, self.profile.noisy_points[arc.indices], arc.ellipse, variance_factor=1.0
        )


@dataclass(frozen=True, slots=True)
class Variant:
    """A chain with one step changed.

    Parameters
    ----------
    group : str
        "as it is", "left out" or "as the paper has it".
    name : str
        In plain words.
    fit_of : callable
        Makes a `VariantFit` of an `AblationArc`.
    """

    group: str
    name: str
    fit_of: Callable[[AblationArc], VariantFit]


def _finish(screened: ScreenedArc) -> VariantFit:
    """Smooth, homogenise and fit: the end of the chain, from any arc."""
    smoothed = smooth_arc(screened.points, screened.ellipse)
    return _fit(screened.points[smoothed.inliers], homogenise_arc(smoothed).ellipse)


def _fit(points: NoisyPoints, initial_guess: Ellipse) -> VariantFit:
    """The weighted orthogonal fit."""
    fit = fit_noisy_points(points, initial_guess, settings=FITTING)
    return _with_evaluations(fit, initial_guess)


def _with_evaluations(fit: EllipseFit, initial_guess: Ellipse) -> VariantFit:
    """The fit, repeated with its evaluations counted; one without a minimum has failed."""
    if not fit.converged:
        raise FitFailed("no ellipse fits best")
    evaluations = 0

    def evaluate(parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        nonlocal evaluations
        evaluations += 1
        return fit.problem.evaluate(parameters)

    start = parameters_from_ellipse(initial_guess)
    least_squares(evaluate, start, FITTING.max_evaluations, FITTING.tolerance)
    return VariantFit(fit.ellipse, evaluations)


def _without_smoothing(arc: AblationArc) -> VariantFit:
    return _fit(arc.screened.points, arc.screened.ellipse)


def _without_homogenising(arc: AblationArc) -> VariantFit:
    return _fit(arc.inliers, arc.screened.ellipse)


def _direct_fit(arc: AblationArc) -> VariantFit:
    """OpenCV's algebraic fit, about the centroid because it works in float32."""
    points = as_vectors(arc.inliers.z)
    middle = points.mean(axis=0)
    fitted = cv2.fitEllipseDirect((points - middle).astype(np.float32))
    (x, y), (first, second), turn_deg = fitted
    centre = (float(x + middle[0]), float(y + middle[1]))
    if not (math.isfinite(first) and min(first, second) > 0):
        return VariantFit(arc.screened.ellipse, 0)
    return VariantFit(Ellipse.from_axes(centre, first / 2, second / 2, math.radians(turn_deg)), 0)


def _equal_weights(arc: AblationArc) -> VariantFit:
    return _unweighted(as_vectors(arc.inliers.z), arc.initial_guess)


def _unweighted(points: Points, initial_guess: Ellipse) -> VariantFit:
    fit = fit_ellipse(points, initial_guess, settings=FITTING)
    return _with_evaluations(fit, initial_guess)


def _radial(arc: AblationArc) -> VariantFit:
    fit = fit_ellipse(as_vectors(arc.inliers.z), arc.initial_guess, settings=RADIAL)
    return _with_evaluations(fit, arc.initial_guess)


def _fixed_sensor_error(arc: AblationArc) -> VariantFit:
    """Screening with one limit in mm, Figure 9."""
    literal, indices = PaperSettings(), arc.arc.indices
    points: Points = arc.profile.points[indices]
    part = max(1, round(literal.end_part_fraction * len(indices)))
    middle = fit_ellipse(points[part:-part], arc.arc.ellipse, settings=RADIAL).ellipse
    kept = np.abs(radial_residuals(points, middle)) < literal.sensor_error_mm
    kept[part:-part] = True
    return _finish(arc.take(IdentifiedArc.of(indices[kept], middle)))


def _smoothed_over_x(arc: AblationArc) -> VariantFit:
    smooth = smooth_profile_paper(_by_x(as_vectors(arc.inliers.z)))
    return _unweighted(smooth, arc.initial_guess)


def _homogenised_over_x(arc: AblationArc) -> VariantFit:
    even = homogenise_profile_paper(_by_x(as_vectors(arc.inliers.z)))
    return _unweighted(even, arc.initial_guess)


def _all_of_it(arc: AblationArc) -> VariantFit:
    """Sections 3.3 and 2.3 to the letter, on an arc that is found and screened as ours."""
    smooth = smooth_profile_paper(_by_x(as_vectors(arc.screened.points.z)))
    fit = fit_ellipse(homogenise_profile_paper(smooth), arc.initial_guess, settings=RADIAL)
    return _with_evaluations(fit, arc.initial_guess)


def _by_x(points: Points) -> Points:
    ordered: Points = points[np.argsort(points[:, 0], kind="stable")]
    return ordered


LEFT_OUT, AS_PAPER = "left out", "as the paper has it"
VARIANTS = (
    Variant("as it is", "every step, as lsvision does it", lambda arc: _finish(arc.screened)),
    Variant(LEFT_OUT, "rough identification: the first candidate is the arc",
            lambda arc: _finish(arc.screen(arc.seed))),
    Variant(LEFT_OUT, "accurate screening", lambda arc: _finish(arc.take(arc.arc))),
    Variant(LEFT_OUT, "smoothing", _without_smoothing),
    Variant(LEFT_OUT, "sensor error of rough identification inside the arc",
            lambda arc: _finish(arc.with_jumps.screened)),
    Variant(LEFT_OUT, "that sensor error and smoothing",
            lambda arc: _without_smoothing(arc.with_jumps)),
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
