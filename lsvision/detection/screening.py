"""Accurate screening: do the end points of an arc lie on the ellipse of its middle part.

(Paper section 3.2.2.)

The paper compares r_j with the sensor error. A weld bead leaves a tube so gently that its first
points pass that test one by one; so here the outermost few points are also judged together,
and the limit grows by what the ellipse of the middle part itself does not know at the ends.
"""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.detection.arc_neighbours import MIN_CONTACT_POINTS, neighbours_beyond_ends
from lsvision.detection.end_extension import MIN_INCIDENCE_COSINE, EndExtensionSettings, extend_ends
from lsvision.detection.identification import IdentifiedArc
from lsvision.ellipse.parameters import ellipse_from_parameters, is_ellipse, parameters_from_ellipse
from lsvision.ellipse.robust_gauss_newton import (
    IDENTITY,
    ellipse_residuals,
    propagated_variances,
    refine_ellipse,
    solve_positive_definite,
)
from lsvision.profile import Arc, PreparedProfile
from lsvision.shapes import BoolArray, Ellipse, FloatArray, IntArray
from lsvision.shapes.noisy_points import NoisyPoints
from lsvision.statistics.correlation import autocorrelation_time
from lsvision.statistics.robust import mad_std

END_GROUP_SIZES = (1, 2, 3, 4, 6, 8, 12)


@dataclass(frozen=True, kw_only=True, slots=True)
class ScreeningSettings:
    """Accurate screening, section 3.2.2.

    Parameters
    ----------
    end_part_fraction : float
        Share of the arc's points in its start part, and in its end part.
    contact_part_fraction : float
        The same at an end where the line goes on into something else.
    contact_sigmas : float
        There, outermost points that together lie this far outside are dropped.
    guard_points : int
        And so many more: the foot of a bead lies within the noise, and one such point at a
        flank, where points weigh most, already costs the interval its level.
    sensor_error_sigmas : float
        A single end point further out is dropped, with all beyond it that fail too.
    chi2_sigmas : float
        End points whose chi^2 together exceeds its mean by more standard deviations lose the
        outermost, until they agree.
    edge_points_per_correlation : float
        Where neighbours' errors are alike, the sensor has smoothed along the line, and before
        an edge it mixes in what lies beyond: so many points are dropped at each end, times
        the correlation factor less one.
    """

    end_part_fraction: float = 0.12
    contact_part_fraction: float = 0.2
    contact_sigmas: float = 1.7
    guard_points: int = 2
    sensor_error_sigmas: float = 3.5
    chi2_sigmas: float = 3.5
    edge_points_per_correlation: float = 1.7


def screen_arc(
    profile: PreparedProfile,
    arc: IdentifiedArc,
    settings: ScreeningSettings = ScreeningSettings(),
    reaching: EndExtensionSettings = EndExtensionSettings(),
) -> IdentifiedArc:
    """Drop the end points that do not lie on the ellipse of the middle part.

    Then the whole of what remains reaches out for last points that do, `extend_ends`, where no
    edge had to be dropped.

    Parameters
    ----------
    profile : PreparedProfile
        The profile.
    arc : IdentifiedArc
        From rough identification.
    settings : ScreeningSettings
        Sizes of the parts and limits.
    reaching : EndExtensionSettings
        How far it reaches then.

    Returns
    -------
    IdentifiedArc
        With the points that remain and the ellipse of the middle part; the arc itself where it
        has too few points to be judged.
    """
    count = len(arc.indices)
    before, after = neighbours_beyond_ends(profile, arc.indices, MIN_CONTACT_POINTS + 2)
    contacts = [len(beyond) >= MIN_CONTACT_POINTS for beyond in (before, after)]
    parts = [
        max(2, round(settings.contact_part_fraction * count))
        if contact
        else max(2, round(settings.end_part_fraction * count))
        for contact in contacts
    ]
    inner = arc.indices[parts[0] : count - parts[1]]
    if len(inner) < 8:
        return arc
    middle = _fit_middle(profile, inner, arc.ellipse)
    if middle is None:
        return arc
    edge = round(settings.edge_points_per_correlation * (middle.autocorrelation_time - 1))
    ends = (arc.indices[edge : parts[0]], arc.indices[::-1][edge : parts[1]])
    gaps = _end_residuals(middle, profile.noisy_points[np.concatenate(ends)])
    sides = (slice(0, len(ends[0])), slice(len(ends[0]), None))
    start, stop = (
        end[_ellipse_inliers(gaps[side], middle.autocorrelation_time, settings, contact=contact)]
        for end, side, contact in zip(ends, sides, contacts, strict=True)
    )
    kept = np.concatenate([start, inner, stop[::-1]])
    screened = IdentifiedArc(Arc(int(kept[0]), int(kept[-1]) + 1), kept, middle.ellipse)
    return screened if edge > 0 else extend_ends(profile, screened, middle.covariance, reaching)


@dataclass(frozen=True, eq=False, slots=True)
class _MiddleFit:
    """Ellipse of the middle part with its covariance (mm^2), and how the points scatter.

    `variance_factor` is the variance over the noise model's, `autocorrelation_time` how many
    neighbours in a row say the same; both 1 for a true model and independent errors.
    """

    parameters: FloatArray
    covariance: FloatArray
    variance_factor: float
    autocorrelation_time: float

    @property
    def ellipse(self) -> Ellipse:
        return ellipse_from_parameters(self.parameters)


def _fit_middle(profile: PreparedProfile, part: IntArray, start: Ellipse) -> _MiddleFit | None:
    own = profile.noisy_points[part]
    parameters, covariance = refine_ellipse(own, parameters_from_ellipse(start), steps=2)
    if not is_ellipse(parameters):
        return None
    excess, correlation = 1.0, 1.0
    if not profile.noise_known:
        compared = ellipse_residuals(own, parameters)
        z = compared.residuals / np.sqrt(compared.variances)
        excess = max(1.0, mad_std(z) ** 2)
        correlation = autocorrelation_time(np.clip(z, -3 * excess, 3 * excess))
    return _MiddleFit(parameters, covariance * excess * correlation, excess, correlation)


@dataclass(frozen=True, eq=False, slots=True)
class _EndResiduals:
    """Distances of end points from the middle's ellipse, from the outside in.

    Their covariance is diag(own) + rows' C rows, with C that of the middle's parameters.
    """

    residuals: FloatArray
    point_variances: FloatArray
    jacobian: FloatArray
    parameter_covariance: FloatArray
    faces_sensor: BoolArray

    def __getitem__(self, which: IntArray | slice) -> "_EndResiduals":
        return _EndResiduals(
            self.residuals[which],
            self.point_variances[which],
            self.jacobian[:, which],
            self.parameter_covariance,
            self.faces_sensor[which],
        )

    def normalised_squares(self) -> FloatArray:
        """Of the distances, each over its variance."""
        unsure = propagated_variances(self.jacobian, self.parameter_covariance)
        squares: FloatArray = self.residuals * self.residuals / (self.point_variances + unsure)
        return squares

    def chi2(self) -> float:
        """Of all of them, by Woodbury: as many unknowns as the ellipse has, not as points."""
        over = self.jacobian / self.point_variances
        known = solve_positive_definite(self.parameter_covariance, IDENTITY)
        inner, pull = known + over @ self.jacobian.T, over @ self.residuals
        return float(
            self.residuals @ (self.residuals / self.point_variances)
            - pull @ solve_positive_definite(inner, pull)
        )

    def covariance(self, count: int) -> FloatArray:
        """(count, count) of the outermost."""
        rows = self.jacobian[:, :count]
        return np.diag(self.point_variances[:count]) + rows.T @ self.parameter_covariance @ rows


def _end_residuals(middle: _MiddleFit, points: NoisyPoints) -> _EndResiduals:
    compared = ellipse_residuals(points, middle.parameters)
    own = middle.variance_factor * compared.inflated_variances
    lit = points.incidence_cosines(compared.normals) > MIN_INCIDENCE_COSINE
    return _EndResiduals(compared.residuals, own, compared.jacobian(), middle.covariance, lit)


def _ellipse_inliers(
    gaps: _EndResiduals, correlation: float, settings: ScreeningSettings, *, contact: bool
) -> IntArray:
    """Which points of an end part, given from the outside in, lie on the middle's ellipse."""
    near = (
        gaps.faces_sensor & (gaps.normalised_squares() < settings.sensor_error_sigmas**2)
    ).nonzero()[0]
    for first in range(len(near)):
        judged = near[first:]
        outermost = gaps[judged]
        if _passes_chi2_test(outermost, correlation, settings) and not (
            contact and _deviates_outwards(outermost, settings.contact_sigmas)
        ):
            return judged[settings.guard_points if contact else 0 :]
    return near[:0]


def _passes_chi2_test(gaps: _EndResiduals, correlation: float, settings: ScreeningSettings) -> bool:
    """Chi^2 of end points together, given the middle; correlated ones tell less each."""
    count = len(gaps.residuals)
    return gaps.chi2() <= correlation * (count + settings.chi2_sigmas * math.sqrt(2 * count))


def _deviates_outwards(gaps: _EndResiduals, sigmas: float) -> bool:
    """Whether the outermost few points together lie outside, as the foot of a weld bead does."""
    covariance = gaps.covariance(END_GROUP_SIZES[-1])
    for count in END_GROUP_SIZES:
        if count > len(gaps.residuals):
            return False
        weights = solve_positive_definite(covariance[:count, :count], np.ones(count))
        if float(weights @ gaps.residuals[:count]) > sigmas * math.sqrt(float(weights.sum())):
            return True
    return False
