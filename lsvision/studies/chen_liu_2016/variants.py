"""Variants of the pipeline: one step left out, or done as in the paper's text, on a given arc.

In lsvision, smoothing and homogenising give the inliers and the initial guess of a weighted fit to
the measured points. The variants that smooth or homogenise as in the paper fit the smoothed or
homogenised points themselves, with equal weights, from lsvision's initial guess.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from lsvision.detection.arcs import IdentifiedArc, ScreenedArc
from lsvision.detection.screening import screen_arcs
from lsvision.ellipse.fit import fit_ellipse, fit_noisy_points
from lsvision.ellipse.fit_result import EllipseFit
from lsvision.ellipse.homogenising import homogenise_arcs
from lsvision.ellipse.outcomes import unwrap
from lsvision.ellipse.parameters import parameters_from_ellipse
from lsvision.ellipse.problem import minimise
from lsvision.ellipse.smoothing import SmoothedArc, smooth_arcs
from lsvision.errors import FitFailed
from lsvision.geometry import Ellipse, Points, radial_residuals
from lsvision.geometry.noisy_points import NoisyPoints, as_vectors
from lsvision.measure import Settings
from lsvision.profile import PreparedProfile
from lsvision.studies.chen_liu_2016.paper_pipeline import (
    PaperSettings,
    homogenise_profile_paper,
    smooth_profile_paper,
)

FITTING = Settings().fitting
"""Settings of the iterative fits but the radial ones: those of `measure_cylinders` by default,
without its limit of the axis ratio."""
RADIAL_FITTING = replace(FITTING, residual="radial")
"""As `FITTING`, with the paper's radial residuals, for screening and the final fit."""


@dataclass(frozen=True, slots=True)
class VariantFit:
    """Result of a variant on an arc.

    Parameters
    ----------
    ellipse : Ellipse
        Fitted ellipse. Units: mm, rad.
    evaluations : int
        Number of evaluations of the residuals in one iterative fit with the final weights,
        without reweighting; 0 without an iterative fit.
    """

    ellipse: Ellipse
    evaluations: int


@dataclass(frozen=True, eq=False)
class AblationArc:
    """A pipe's arc before screening, with the results of the following steps.

    Parameters
    ----------
    profile : PreparedProfile
        Profile of the section.
    arc : IdentifiedArc
        Result of rough identification.
    first_candidate : IdentifiedArc
        First candidate on the same pipe, from which rough identification may have started.
    """

    profile: PreparedProfile
    arc: IdentifiedArc
    first_candidate: IdentifiedArc

    @cached_property
    def screened(self) -> ScreenedArc:
        """The arc after accurate screening."""
        return self.screen(self.arc)

    @cached_property
    def smoothed(self) -> SmoothedArc:
        """The screened arc after smoothing."""
        return _smooth(self.screened)

    @property
    def inliers(self) -> NoisyPoints:
        """Screened points without the jumps that smoothing found."""
        return self.screened.points[self.smoothed.inliers]

    @property
    def ordered_inliers(self) -> Points:
        """`inliers` (n, 2) ordered by x. Units: mm."""
        return _order_by_x(as_vectors(self.inliers.z))

    @property
    def initial_guess(self) -> Ellipse:
        """Ellipse after homogenising, at which the fit starts."""
        return _homogenise(self.smoothed)

    def screen(self, arc: IdentifiedArc) -> ScreenedArc:
        """Return the screened arc; raises FitFailed if its middle part has no ellipse."""
        (screened,) = screen_arcs([self.profile], [arc])
        if screened is None:
            raise FitFailed("no ellipse fits the middle part of the arc")
        return screened

    @cached_property
    def with_jumps(self) -> "AblationArc":
        """The arc with all points of its span, including jumps beyond the sensor error."""
        valid = self.profile.valid_indices
        in_span = (valid >= self.arc.arc.start) & (valid < self.arc.arc.stop)
        arc_with_jumps = IdentifiedArc(valid[in_span], self.arc.ellipse)
        return AblationArc(self.profile, arc_with_jumps, self.first_candidate)

    def without_screening(self, arc: IdentifiedArc) -> ScreenedArc:
        """Return an arc unchanged in the form of a screened arc."""
        return ScreenedArc(
            arc.indices, self.profile.noisy_points[arc.indices], arc.ellipse, variance_factor=1.0
        )


@dataclass(frozen=True, slots=True)
class Variant:
    """Pipeline with one step changed.

    Parameters
    ----------
    group : str
        "as it is", "left out" or "as in the paper".
    name : str
        Description of the change.
    fit : callable
        Function that fits an `AblationArc`: returns a `VariantFit` or raises LsvisionError.
    """

    group: str
    name: str
    fit: Callable[[AblationArc], VariantFit]


def _fit_screened(screened: ScreenedArc) -> VariantFit:
    """Return the ellipse of a screened arc by the following steps of lsvision."""
    smoothed = _smooth(screened)
    return _fit(screened.points[smoothed.inliers], _homogenise(smoothed))


def _smooth(screened: ScreenedArc) -> SmoothedArc:
    """Return one arc smoothed along its ellipse."""
    (smoothed,) = smooth_arcs([screened.points], [screened.ellipse])
    return smoothed


def _homogenise(smoothed: SmoothedArc) -> Ellipse:
    """Return the ellipse of the homogenised arc, at which the fit starts."""
    (homogenised,) = homogenise_arcs([smoothed])
    return homogenised.ellipse


def _fit(points: NoisyPoints, initial_guess: Ellipse) -> VariantFit:
    """Return the ellipse fitted by weighted orthogonal residuals."""
    (outcome,) = fit_noisy_points([(points, initial_guess)], settings=FITTING)
    return _with_evaluations(unwrap(outcome), initial_guess)


def _with_evaluations(fit: EllipseFit, initial_guess: Ellipse) -> VariantFit:
    """Return a fit with its number of evaluations, counted in a fit with its final weights.

    Raises FitFailed if it has not converged.
    """
    if not fit.converged:
        raise FitFailed("the ellipse fit did not converge")
    start = parameters_from_ellipse(initial_guess)[None]
    (outcome,) = minimise([fit.problem], start, FITTING.max_evaluations, FITTING.tolerance)
    return VariantFit(fit.ellipse, unwrap(outcome).evaluations)


def _without_smoothing(arc: AblationArc) -> VariantFit:
    """Return the fit to all screened points, from the screened ellipse."""
    return _fit(arc.screened.points, arc.screened.ellipse)


def _fit_directly(arc: AblationArc) -> VariantFit:
    """Return OpenCV's algebraic fit, relative to the centroid (it computes in float32).

    The screened ellipse if OpenCV returns none with two positive axes.
    """
    points = as_vectors(arc.inliers.z)
    centroid = points.mean(axis=0)
    fitted = cv2.fitEllipseDirect((points - centroid).astype(np.float32))
    (x, y), (first, second), angle_deg = fitted
    centre = (float(x + centroid[0]), float(y + centroid[1]))
    if not (math.isfinite(first) and min(first, second) > 0):
        return VariantFit(arc.screened.ellipse, 0)
    return VariantFit(Ellipse.from_axes(centre, first / 2, second / 2, math.radians(angle_deg)), 0)


def _fit_unweighted(points: Points, initial_guess: Ellipse) -> VariantFit:
    """Return the fit of points (n, 2) in mm by orthogonal residuals of equal weight."""
    fit = fit_ellipse(points, initial_guess, settings=FITTING)
    return _with_evaluations(fit, initial_guess)


def _fit_radial(arc: AblationArc) -> VariantFit:
    """Return the fit by the paper's radial residuals of equal weight, Eq. (4)."""
    fit = fit_ellipse(as_vectors(arc.inliers.z), arc.initial_guess, settings=RADIAL_FITTING)
    return _with_evaluations(fit, arc.initial_guess)


def _fit_with_fixed_sensor_error(arc: AblationArc) -> VariantFit:
    """Return the fit after screening with one limit in mm (Figure 9) for all points."""
    settings, indices = PaperSettings(), arc.arc.indices
    points: Points = arc.profile.points[indices]
    end_points = settings.count_end_points(len(indices))
    middle = fit_ellipse(
        points[end_points:-end_points], arc.arc.ellipse, settings=RADIAL_FITTING
    ).ellipse
    inliers = np.abs(radial_residuals(points, middle)) < settings.sensor_error_mm
    inliers[end_points:-end_points] = True
    return _fit_screened(arc.without_screening(IdentifiedArc(indices[inliers], middle)))


def _run_smoothing_to_fit_of_paper(arc: AblationArc) -> VariantFit:
    """Return the fit by sections 3.3 and 2.3 as published, for an arc from lsvision's screening."""
    smooth = smooth_profile_paper(_order_by_x(as_vectors(arc.screened.points.z)))
    fit = fit_ellipse(homogenise_profile_paper(smooth), arc.initial_guess, settings=RADIAL_FITTING)
    return _with_evaluations(fit, arc.initial_guess)


def _order_by_x(points: Points) -> Points:
    """Return the points ordered by x."""
    ordered: Points = points[np.argsort(points[:, 0], kind="stable")]
    return ordered


LEFT_OUT, AS_PAPER = "left out", "as in the paper"
"""Groups of variants, besides "as it is"."""
VARIANTS = (
    Variant("as it is", "every step, as lsvision does it", lambda arc: _fit_screened(arc.screened)),
    Variant(LEFT_OUT, "rough identification: the first candidate is the arc",
            lambda arc: _fit_screened(arc.screen(arc.first_candidate))),
    Variant(LEFT_OUT, "accurate screening",
            lambda arc: _fit_screened(arc.without_screening(arc.arc))),
    Variant(LEFT_OUT, "smoothing", _without_smoothing),
    Variant(LEFT_OUT, "rejection of points inside the arc by rough identification",
            lambda arc: _fit_screened(arc.with_jumps.screened)),
    Variant(LEFT_OUT, "that rejection and smoothing",
            lambda arc: _without_smoothing(arc.with_jumps)),
    Variant(LEFT_OUT, "homogenising", lambda arc: _fit(arc.inliers, arc.screened.ellipse)),
    Variant(LEFT_OUT, "iterative fit: a direct algebraic one instead", _fit_directly),
    Variant(AS_PAPER, "screening with one sensor error of 0.9 mm", _fit_with_fixed_sensor_error),
    Variant(AS_PAPER, "smoothing y over x, equal weights",
            lambda arc: _fit_unweighted(smooth_profile_paper(arc.ordered_inliers),
            arc.initial_guess)),
    Variant(AS_PAPER, "homogenising over x, equal weights",
            lambda arc: _fit_unweighted(homogenise_profile_paper(arc.ordered_inliers),
                                    arc.initial_guess)),
    Variant(AS_PAPER, "all points of equal weight",
            lambda arc: _fit_unweighted(as_vectors(arc.inliers.z), arc.initial_guess)),
    Variant(AS_PAPER, "equal weights and radial residuals, Eq. (4)", _fit_radial),
    Variant(AS_PAPER, "sections 3.3 and 2.3 as published", _run_smoothing_to_fit_of_paper),
)  # fmt: skip
"""All variants in the order of the report."""
