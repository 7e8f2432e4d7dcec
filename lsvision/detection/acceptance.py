"""Acceptance tests of fitted sections, and suppression of sections that overlap larger ones."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.detection.arcs import MAX_OVERLAP
from lsvision.ellipse.intervals import is_limit_of_radius
from lsvision.ellipse.phi_prior import PhiPrior
from lsvision.ellipse.prior_check import find_contradicting_radius, find_contradicting_tilt
from lsvision.ellipse.section import CylinderSection
from lsvision.geometry import Ellipse
from lsvision.geometry.noisy_points import ComplexArray
from lsvision.profile import PreparedProfile

MAX_RADIUS_RATIO = 2.0
"""Largest ratio of the upper end of the 95 % interval to the radius, and of the radius to the lower
end; above it the radius is not determinable."""
MIN_UNTILTED_SIGMAS = 2.2
"""Smallest ratio of the radius of an untilted cylinder that fits the arc to its standard
uncertainty. Below it the 97 % interval of this radius has no upper end, but a fit that is small and
tilted by chance would seem to determine the radius. For arcs of 60 deg of small circles, the 95 %
intervals contain the radius in 92 % of the cases without this limit and in 94 % with it; the limit
rejects 1.5 % of the valid fits (2.5 would reject 6 %)."""
TILT_MARGIN_DEG = 10.0
"""Tilt beyond `max_tilt_deg` at which the iteration of a fit ends: fits of arcs that are on no
ellipse become flatter in each step, and would take most of the time of a profile. Units: deg."""
MAX_CLOSED_MEAN_NORMAL = 0.4
"""Largest length of the mean of the unit normals of a closed section, which faces the sensor with
one side and not with the other: 0 all around, 0.3 with a gap of 90 deg. Of an arc of 180 deg it is
0.64."""
CERTAIN_RADIUS_SIGMAS = 6.0
"""Ratio of radius to standard uncertainty above which the interval certainly is within
`MAX_RADIUS_RATIO`. Only below it the interval is computed, which takes 6 to 55 ms for a short
arc."""
UNDETERMINABLE = "radius not determinable"
"""First words of the reason of a rejection because the interval of the radius is too wide."""
_NEEDED = "a longer arc or a known tilt is needed"


@dataclass(frozen=True, kw_only=True)
class AcceptanceSettings:
    """Limits for accepting an arc as the section of a cylinder.

    Parameters
    ----------
    min_points : int
        Smallest number of inliers. Of 480 simulated pipes with 8 to 25 points it finds 343; a limit
        of 8 finds 398, of 17 235.
    min_coverage_deg : float
        Smallest angle between the normals at both ends of the arc. Of 48 arcs of 45 to 60 deg, and
        48 of 30 to 45 deg, with a known radius it finds 38 and 13; a limit of 27 finds 39 and 33,
        of 53 10 and 1. With an unknown radius it hardly matters: such arcs determine none. Units:
        deg.
    max_tilt_deg : float
        Largest angle phi between the cylinder's axis and the laser plane's normal. Of 800 pipes,
        half of them tilted by up to 75 deg, the others by up to 40, it finds 721; a limit of 42
        finds 627, of 84 776. Units: deg.

    Notes
    -----
    None of these limits yields a false cylinder in 800 scenes with clutter, 320 of them without a
    pipe, and the 95 % intervals of the radius contain it in 94 to 96 % with each: lower limits are
    a choice for data without other shapes than those of `lsvision.simulate`.
    """

    min_points: int = 12
    min_coverage_deg: float = 38.0
    max_tilt_deg: float = 60.0

    @property
    def min_fitted_axis_ratio(self) -> float:
        """Axis ratio b / a at a tilt `TILT_MARGIN_DEG` beyond the largest, where a fit ends."""
        return math.cos(math.radians(min(self.max_tilt_deg + TILT_MARGIN_DEG, 90.0)))


def find_shape_rejection_reason(
    ellipse: Ellipse,
    normals: ComplexArray,
    radius_range: tuple[float, float],
    settings: AcceptanceSettings = AcceptanceSettings(),
) -> str | None:
    """Return the reason why an ellipse cannot be the section of a cylinder; None if it can.

    Parameters
    ----------
    ellipse : Ellipse
        Ellipse of the arc. Units: mm, rad.
    normals : (n,) complex ndarray
        Outward unit normals of the ellipse at the points of the arc.
    radius_range : (float, float)
        Smallest and largest radius. Units: mm.
    settings : AcceptanceSettings
        Limits on points, coverage and tilt.
    """
    low, high = radius_range
    if len(normals) < settings.min_points:
        return f"only {len(normals)} points on an ellipse, needs {settings.min_points}"
    mean_normal = complex(normals.sum()) / len(normals)
    if mean_normal.imag <= 0 and abs(mean_normal) > MAX_CLOSED_MEAN_NORMAL:
        return "concave towards the sensor"
    if not low <= ellipse.radius <= high:
        return f"radius {ellipse.radius:.3g} mm outside {low:.3g} to {high:.3g} mm"
    tilt_deg = math.degrees(ellipse.phi)
    if tilt_deg > settings.max_tilt_deg:
        return f"tilt {tilt_deg:.0f} deg over {settings.max_tilt_deg:.0f} deg"
    directions = np.angle(normals * mean_normal.conjugate())
    coverage_deg = math.degrees(float(directions.max() - directions.min()))
    if coverage_deg < settings.min_coverage_deg:
        return f"arc covers {coverage_deg:.0f} deg, needs {settings.min_coverage_deg:.0f} deg"
    return None


def find_rejection_reason(
    profile: PreparedProfile,
    section: CylinderSection,
    radius_range: tuple[float, float],
    settings: AcceptanceSettings = AcceptanceSettings(),
    known_phi: PhiPrior | None = None,
) -> str | None:
    """Return the reason why a fitted section is rejected; None if it is accepted.

    Parameters
    ----------
    profile : PreparedProfile
        Profile of the section.
    section : CylinderSection
        Section whose indices are those of the prepared profile.
    radius_range : (float, float)
        Smallest and largest radius. Units: mm.
    settings : AcceptanceSettings
        Limits on points, coverage and tilt.
    known_phi : PhiPrior, optional
        Tilt that is known, also where it is no prior of the fit.
    """
    fit = section.fit
    reason = find_shape_rejection_reason(fit.ellipse, fit.normals, radius_range, settings)
    if reason is not None:
        return reason
    # Total variances (the trace): on a steep flank those along the normal vanish.
    variance = 2 * float(profile.noisy_points.mean_variance[section.indices].sum())
    scatter = math.sqrt(float(fit.residuals @ fit.residuals) / variance)
    limit = profile.max_noise_factor(fit.ellipse.radius)
    if scatter > limit:
        hint = "" if profile.noise_is_estimated else ": check the sensor's noise"
        return f"residual rms {scatter:.1f} times the noise, limit {limit:.1f}{hint}"
    # With a known radius the ellipse cannot become flat; such a fit may stop without convergence at
    # a circle, where the derivative of b is discontinuous.
    if not fit.converged and fit.problem.known_radius is None:
        stop = f"the fit stopped at a tilt of {math.degrees(fit.ellipse.phi):.0f} deg"
        return f"no best ellipse: the flatter the ellipse, the better it fits ({stop})"
    return (
        find_undeterminable_radius_reason(section)
        or find_contradicted_radius_reason(section)
        or find_contradicted_tilt_reason(section, known_phi)
    )


def find_contradicted_radius_reason(section: CylinderSection) -> str | None:
    """Return the reason why the points contradict a known radius; None if they do not.

    None also if no radius is known.
    """
    points, known = find_contradicting_radius(section.fit), section.fit.problem.known_radius
    if points is None or known is None:
        return None
    where = "they" if section.fit.problem.known_phi is None else "with the known tilt they"
    return (
        f"the known radius of {known.radius:.4g} mm contradicts the points: "
        f"{where} give {points.radius:.4g} +/- {points.std:.2g} mm"
    )


def find_contradicted_tilt_reason(section: CylinderSection, known: PhiPrior | None) -> str | None:
    """Return the reason why the points contradict a known tilt; None if they do not.

    None also if no tilt is known.
    """
    points = find_contradicting_tilt(section.fit, known)
    if points is None or known is None:
        return None
    where = "they" if section.fit.problem.known_radius is None else "with the known radius they"
    return (
        f"the known tilt of {math.degrees(known.phi):.3g} deg contradicts the points: "
        f"{where} give {math.degrees(points.phi):.3g} +/- {math.degrees(points.std):.2g} deg"
    )


def find_undeterminable_radius_reason(section: CylinderSection) -> str | None:
    """Return the reason why the points do not determine the radius; None if they do.

    None also if the radius or the tilt is known.
    """
    problem = section.fit.problem
    if problem.known_radius is not None or problem.known_phi is not None:
        return None
    radius, squared_axis_ratio = section.radius, math.cos(section.phi) ** 2
    # A bound that takes little time, and is low enough for most arcs: the variance of the radius
    # m - |(p, q)| is at most twice the sum of those of m, p and q.
    max_variance = 2 * float(section.fit.parameter_covariance[2:, 2:].trace())
    if radius * squared_axis_ratio > CERTAIN_RADIUS_SIGMAS * math.sqrt(max_variance):
        return None
    std = section.local_radius_std
    # A short arc determines only its curvature b / a^2, the inverse radius of an untilted cylinder.
    # An inverse radius is equally uncertain with and without the tilt.
    if radius * squared_axis_ratio < MIN_UNTILTED_SIGMAS * std:
        untilted = f"{radius / squared_axis_ratio:.3g} +/- {std / squared_axis_ratio**2:.2g} mm"
        return f"{UNDETERMINABLE}: {untilted} untilted; {_NEEDED}"
    if radius > CERTAIN_RADIUS_SIGMAS * std:
        return None
    low, high = section.interval("radius")
    if max(high / radius, radius / low) <= MAX_RADIUS_RATIO:
        return None
    return f"{UNDETERMINABLE}: {_describe_interval(low, high, radius)}; {_NEEDED}"


def _describe_interval(low: float, high: float, radius: float) -> str:
    """Return the 95 % interval of a radius in words, without the ends that were not found."""
    if not is_limit_of_radius(high, radius):
        lower = "0" if is_limit_of_radius(low, radius) else f"{low:.3g}"
        return f"{lower} to {high:.3g} mm (95 %)"
    lower = "" if is_limit_of_radius(low, radius) else f" from {low:.3g} mm"
    return f"the 95 % interval{lower} has no upper end"


def suppress_overlapping(cylinders: Sequence[CylinderSection]) -> list[CylinderSection]:
    """Return the sections that do not overlap one with more points.

    They are in descending order of their number of points; `MAX_OVERLAP` is the largest fraction of
    its points that a section may share.
    """
    covered: set[int] = set()
    accepted: list[CylinderSection] = []
    for cylinder in sorted(cylinders, key=lambda cylinder: -len(cylinder.indices)):
        indices = cylinder.indices.tolist()
        if len(covered.intersection(indices)) <= MAX_OVERLAP * len(indices):
            accepted.append(cylinder)
            covered.update(indices)
    return accepted
