"""Accurate screening: do the end points of an arc lie on the ellipse of its middle part.

(Paper section 3.2.2.)

The paper compares r_j with the sensor error. A weld bead leaves a tube so gently that its first
points pass that test one by one; so here the outermost few points are also judged together,
and the limit grows by what the ellipse of the middle part itself does not know at the ends.
"""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.fitting.correlation import correlation_factor
from lsvision.fitting.ellipse_parameters import ellipse_of, is_ellipse, parameters_of
from lsvision.fitting.quick_fit import (
    IDENTITY,
    compare,
    refine_quickly,
    solve_positive,
    variances_along_rows,
)
from lsvision.fitting.scatter import robust_std
from lsvision.profile import Arc, WeighedProfile
from lsvision.recognition.identification import IdentifiedArc
from lsvision.recognition.reaching import LEAST_FACING, ReachingSettings, reach_out
from lsvision.recognition.surroundings import CONTACT_POINTS, followers
from lsvision.shapes import BoolArray, Ellipse, FloatArray, IntArray
from lsvision.shapes.noisy_points import NoisyPoints

OUTERMOST = (1, 2, 3, 4, 6, 8, 12)


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
    joint_sigmas : float
        End points whose chi^2 together exceeds its mean by more standard deviations lose the
        outermost, until they agree.
    edge_share : float
        Where neighbours' errors are alike, the sensor has smoothed along the line, and before
        an edge it mixes in what lies beyond: so many points are dropped at each end, times
        the correlation factor less one.
    """

    end_part_fraction: float = 0.12
    contact_part_fraction: float = 0.2
    contact_sigmas: float = 1.7
    guard_points: int = 2
    sensor_error_sigmas: float = 3.5
    joint_sigmas: float = 3.5
    edge_share: float = 1.7


def screen_arc(
    profile: WeighedProfile,
    arc: IdentifiedArc,
    settings: ScreeningSettings = ScreeningSettings(),
    reaching: ReachingSettings = ReachingSettings(),
) -> IdentifiedArc:
    """Drop the end points that do not lie on the ellipse of the middle part.

    Then the whole of what remains reaches out for last points that do, `reach_out`, where no
    edge had to be dropped.

    Parameters
    ----------
    profile : WeighedProfile
        The profile.
    arc : IdentifiedArc
        From rough identification.
    settings : ScreeningSettings
        Sizes of the parts and limits.
    reaching : ReachingSettings
        How far it reaches then.

    Returns
    -------
    IdentifiedArc
        With the points that remain and the ellipse of the middle part; the arc itself where it
        has too few points to be judged.
    """
    count = len(arc.indices)
    before, after = followers(profile, arc.indices, CONTACT_POINTS + 2)
    contacts = [len(beyond) >= CONTACT_POINTS for beyond in (before, after)]
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
    edge = round(settings.edge_share * (middle.correlation - 1))
    ends = (arc.indices[edge : parts[0]], arc.indices[::-1][edge : parts[1]])
    gaps = _gaps_to(middle, profile.noisy[np.concatenate(ends)])
    sides = (slice(0, len(ends[0])), slice(len(ends[0]), None))
    start, stop = (
        end[_on_ellipse(gaps[side], middle.correlation, settings, contact=contact)]
        for end, side, contact in zip(ends, sides, contacts, strict=True)
    )
    kept = np.concatenate([start, inner, stop[::-1]])
    screened = IdentifiedArc(Arc(int(kept[0]), int(kept[-1]) + 1), kept, middle.ellipse)
    return screened if edge > 0 else reach_out(profile, screened, middle.covariance, reaching)


@dataclass(frozen=True, eq=False, slots=True)
class _MiddlePart:
    """Ellipse of the middle part with its covariance (mm^2), and how the points scatter.

    `excess` is the variance over the noise model's, `correlation` how many neighbours in a row
    say the same; both 1 for a true model and independent errors.
    """

    parameters: FloatArray
    covariance: FloatArray
    excess: float
    correlation: float

    @property
    def ellipse(self) -> Ellipse:
        return ellipse_of(self.parameters)


def _fit_middle(profile: WeighedProfile, part: IntArray, start: Ellipse) -> _MiddlePart | None:
    own = profile.noisy[part]
    parameters, covariance = refine_quickly(own, parameters_of(start), steps=2)
    if not is_ellipse(parameters):
        return None
    excess, correlation = 1.0, 1.0
    if not profile.noise_known:
        compared = compare(own, parameters)
        z = compared.signed / np.sqrt(compared.variances)
        excess = max(1.0, robust_std(z) ** 2)
        correlation = correlation_factor(np.clip(z, -3 * excess, 3 * excess))
    return _MiddlePart(parameters, covariance * excess * correlation, excess, correlation)


@dataclass(frozen=True, eq=False, slots=True)
class _Gaps:
    """Distances of end points from the middle's ellipse, from the outside in.

    Their covariance is diag(own) + rows' C rows, with C that of the middle's parameters.
    """

    signed: FloatArray
    own: FloatArray
    rows: FloatArray
    parameters: FloatArray
    lit: BoolArray

    def __getitem__(self, which: IntArray | slice) -> "_Gaps":
        return _Gaps(
            self.signed[which],
            self.own[which],
            self.rows[:, which],
            self.parameters,
            self.lit[which],
        )

    def squares(self) -> FloatArray:
        """Of the distances, each over its variance."""
        unsure = variances_along_rows(self.rows, self.parameters)
        squares: FloatArray = self.signed * self.signed / (self.own + unsure)
        return squares

    def chi2(self) -> float:
        """Of all of them, by Woodbury: as many unknowns as the ellipse has, not as points."""
        over = self.rows / self.own
        known = solve_positive(self.parameters, IDENTITY)
        inner, pull = known + over @ self.rows.T, over @ self.signed
        return float(self.signed @ (self.signed / self.own) - pull @ solve_positive(inner, pull))

    def covariance(self, count: int) -> FloatArray:
        """(count, count) of the outermost."""
        rows = self.rows[:, :count]
        return np.diag(self.own[:count]) + rows.T @ self.parameters @ rows


def _gaps_to(middle: _MiddlePart, points: NoisyPoints) -> _Gaps:
    compared = compare(points, middle.parameters)
    own = middle.excess * compared.tolerant
    lit = points.facing(compared.normals) > LEAST_FACING
    return _Gaps(compared.signed, own, compared.rows(), middle.covariance, lit)


def _on_ellipse(
    gaps: _Gaps, correlation: float, settings: ScreeningSettings, *, contact: bool
) -> IntArray:
    """Which points of an end part, given from the outside in, lie on the middle's ellipse."""
    near = (gaps.lit & (gaps.squares() < settings.sensor_error_sigmas**2)).nonzero()[0]
    for first in range(len(near)):
        judged = near[first:]
        outermost = gaps[judged]
        if _agrees(outermost, correlation, settings) and not (
            contact and _leaves(outermost, settings.contact_sigmas)
        ):
            return judged[settings.guard_points if contact else 0 :]
    return near[:0]


def _agrees(gaps: _Gaps, correlation: float, settings: ScreeningSettings) -> bool:
    """Chi^2 of end points together, given the middle; correlated ones tell less each."""
    count = len(gaps.signed)
    return gaps.chi2() <= correlation * (count + settings.joint_sigmas * math.sqrt(2 * count))


def _leaves(gaps: _Gaps, sigmas: float) -> bool:
    """Whether the outermost few points together lie outside, as the foot of a weld bead does."""
    covariance = gaps.covariance(OUTERMOST[-1])
    for count in OUTERMOST:
        if count > len(gaps.signed):
            return False
        weights = solve_positive(covariance[:count, :count], np.ones(count))
        if float(weights @ gaps.signed[:count]) > sigmas * math.sqrt(float(weights.sum())):
            return True
    return False
