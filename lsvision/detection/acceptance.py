"""Acceptance tests of fitted sections, and suppression of sections that share their points."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lsvision.detection.arcs import MAX_OVERLAP
from lsvision.ellipse.prior_check import contradicting_radius
from lsvision.ellipse.section import CylinderSection
from lsvision.geometry import Ellipse
from lsvision.geometry.noisy_points import ComplexArray
from lsvision.profile import PreparedProfile

MAX_RADIUS_RATIO = 2.0
"""Largest ratio of an end of the radius' 95 % interval to the radius, or its inverse; beyond it the
radius is not determinable."""
MIN_UNTILTED_SIGMAS = 2.2
"""Smallest ratio of radius to standard uncertainty of an untilted cylinder that fits the arc: below
it the 97 % interval has no upper end. Of such arcs those whose fit came out small and tilted by
chance would seem determined: of 60 deg of small circles 92 % of the 95 % intervals held without
this limit, 94 % with it, at a loss of 1.5 % of the right ones (6 % with a limit of 2.5)."""
CERTAIN_RADIUS_SIGMAS = 6.0
"""Ratio of radius to standard uncertainty above which its interval does not exceed
`MAX_RADIUS_RATIO`: only below it the interval is computed, which takes 20 to 200 ms."""
UNDETERMINABLE = "radius not determinable"
"""First words of the reason for the rejection of a cylinder whose radius is not bounded."""


@dataclass(frozen=True, kw_only=True)
class AcceptanceSettings:
    """Limits for accepting an arc as the section of a cylinder.

    Parameters
    ----------
    min_points : int
        Smallest number of inliers.
    min_coverage_deg : float
        Smallest range of the directions of the arc's normals. Units: deg.
    max_tilt_deg : float
        Largest tilt phi of the cylinder. Units: deg.
    """

    min_points: int = 12
    min_coverage_deg: float = 38.0
    max_tilt_deg: float = 60.0


def shape_rejection_reason(
    ellipse: Ellipse,
    normals: ComplexArray,
    radius_range: tuple[float, float],
    settings: AcceptanceSettings = AcceptanceSettings(),
) -> str | None:
    """Return why an ellipse is not the section of a cylinder; None if it may be.

    `normals` (n,) are its outward unit normals at the points; `radius_range` is in mm.
    """
    low, high = radius_range
    if len(normals) < settings.min_points:
        return f"only {len(normals)} points on an ellipse, needs {settings.min_points}"
    middle = complex(normals.sum())
    if middle.imag <= 0:
        return "concave towards the sensor"
    if not low <= ellipse.radius <= high:
        return f"radius {ellipse.radius:.3g} mm outside {low:.3g} to {high:.3g} mm"
    tilt_deg = math.degrees(ellipse.phi)
    if tilt_deg > settings.max_tilt_deg:
        return f"tilt {tilt_deg:.0f} deg over {settings.max_tilt_deg:.0f} deg"
    rotated = normals * middle.conjugate()
    directions = np.arctan2(rotated.imag, rotated.real)
    coverage_deg = math.degrees(float(directions.max() - directions.min()))
    if coverage_deg < settings.min_coverage_deg:
        return f"arc covers {coverage_deg:.0f} deg, needs {settings.min_coverage_deg:.0f} deg"
    return None


def rejection_reason(
    profile: PreparedProfile,
    section: CylinderSection,
    radius_range: tuple[float, float],
    settings: AcceptanceSettings = AcceptanceSettings(),
) -> str | None:
    """Return why the section of a cylinder is not accepted; None if it is.

    The section has the indices of the prepared `profile`; `radius_range` is in mm.
    """
    fit = section.fit
    reason = shape_rejection_reason(fit.ellipse, fit.normals, radius_range, settings)
    if reason is not None:
        return reason
    # The variances along the normal and the tangent add up to twice the mean variance.
    variance = 2 * float(profile.noisy_points.mean_variance[section.indices].sum())
    scatter = math.sqrt(float(fit.residuals @ fit.residuals) / variance)
    limit = profile.max_noise_factor(fit.ellipse.radius)
    if scatter > limit:
        hint = "" if profile.noise_is_estimated else ": is the sensor's noise right?"
        return f"residual rms {scatter:.1f} times the noise, limit {limit:.1f}{hint}"
    # With a known radius b cannot vanish: the fit stops, unconverged, at the kink of b at a circle.
    if not fit.converged and fit.problem.known_radius is None:
        tilt = f"the fit stopped at {math.degrees(fit.ellipse.phi):.0f} deg"
        return f"no best ellipse: the fit improves as it becomes flatter ({tilt})"
    return undeterminable_radius_reason(section) or contradicted_radius_reason(section)


def contradicted_radius_reason(section: CylinderSection) -> str | None:
    """Return why the points contradict a known radius; None if not, or if it is not known."""
    points, known = contradicting_radius(section.fit), section.fit.problem.known_radius
    if points is None or known is None:
        return None
    where = "they" if section.fit.problem.known_phi is None else "with the known tilt they"
    return (
        f"the known radius of {known.radius:.4g} mm contradicts the points: "
        f"{where} give {points.radius:.4g} +/- {points.std:.2g} mm"
    )


def undeterminable_radius_reason(section: CylinderSection) -> str | None:
    """Return why a radius is not determinable from the points; None if it is, or if it is known."""
    problem = section.fit.problem
    if problem.known_radius is not None or problem.known_phi is not None:
        return None
    radius, squeeze = section.radius, math.cos(section.phi) ** 2
    # The radius m - |(p, q)| has at most twice the variances of m, p and q together.
    max_variance = 2 * float(section.fit.parameter_covariance[2:, 2:].trace())
    if radius * squeeze > CERTAIN_RADIUS_SIGMAS * math.sqrt(max_variance):
        return None
    std = section.local_radius_std
    # A short arc determines its curvature a^2 / b, and 1 / b with a std that is the same for all b.
    if radius * squeeze < MIN_UNTILTED_SIGMAS * std:
        untilted = f"{radius / squeeze:.3g} +/- {std / squeeze**2:.2g} mm untilted"
        return f"{UNDETERMINABLE}: {untilted}; a longer arc is needed"
    if radius > CERTAIN_RADIUS_SIGMAS * std:
        return None
    low, high = section.interval("radius")
    if max(high / radius, radius / low) <= MAX_RADIUS_RATIO:
        return None
    return f"{UNDETERMINABLE}: {low:.3g} to {high:.3g} mm (95 %); a longer arc is needed"


def suppress_overlapping(cylinders: Sequence[CylinderSection]) -> list[CylinderSection]:
    """Return the sections that overlap none with more points, by descending number of points."""
    taken: set[int] = set()
    accepted: list[CylinderSection] = []
    for cylinder in sorted(cylinders, key=lambda cylinder: -len(cylinder.indices)):
        indices = cylinder.indices.tolist()
        if len(taken.intersection(indices)) <= MAX_OVERLAP * len(indices):
            accepted.append(cylinder)
            taken.update(indices)
    return accepted
