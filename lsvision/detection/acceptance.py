"""Whether an arc is a section of a cylinder; if not, the reason in words and numbers."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lsvision.ellipse.section import CylinderSection
from lsvision.geometry import Ellipse, FloatArray
from lsvision.geometry.noisy_points import ComplexArray
from lsvision.profile import PreparedProfile

MAX_RADIUS_RATIO = 2.0
"""Of an end of a radius' own 95 % interval to the radius, or its inverse: beyond, the radius is
not determinable."""
MIN_RADIUS_SIGMAS, CERTAIN_RADIUS_SIGMAS = 2.0, 6.0
"""A radius of fewer standard deviations is not determinable, one of more has an interval well
within that ratio: the interval need not be computed."""


@dataclass(frozen=True, kw_only=True, slots=True)
class AcceptanceSettings:
    """What an arc must be to count as a cylinder's section.

    Parameters
    ----------
    min_points : int
        Inliers.
    min_coverage_deg : float
        Angle of the arc, as directions of its normal. Units: deg.
    max_tilt_deg : float
        Largest phi. Units: deg.
    min_sagitta_sigmas : float
        Height of the arc over its chord in standard deviations of its mean.
    min_inlier_fraction : float
        Share of the span's points that are inliers.
    """

    min_points: int = 12
    min_coverage_deg: float = 38.0
    max_tilt_deg: float = 60.0
    min_sagitta_sigmas: float = 20.0
    min_inlier_fraction: float = 0.7


def shape_rejection_reason(
    ellipse: Ellipse,
    normals: ComplexArray,
    radius_range: tuple[float, float],
    settings: AcceptanceSettings = AcceptanceSettings(),
) -> str | None:
    """Why an ellipse has not the shape of a cylinder's section; None if it has.

    Parameters
    ----------
    ellipse : Ellipse
        Units: mm, rad.
    normals : (n,) complex ndarray
        Outward unit normals at its points.
    radius_range : tuple of float
        Units: mm.
    settings : AcceptanceSettings
        Limits.
    """
    low, high = radius_range
    if len(normals) < settings.min_points:
        return f"only {len(normals)} points on an ellipse, needs {settings.min_points}"
    if normals.imag.sum() <= 0:
        return "concave towards the sensor"
    if not low <= ellipse.radius <= high:
        return f"radius {ellipse.radius:.3g} mm outside {low:.3g} to {high:.3g} mm"
    tilt_deg = math.degrees(ellipse.phi)
    if tilt_deg > settings.max_tilt_deg:
        return f"tilt {tilt_deg:.0f} deg over {settings.max_tilt_deg:.0f} deg"
    coverage_deg = math.degrees(coverage(normals))
    if coverage_deg < settings.min_coverage_deg:
        return f"arc covers {coverage_deg:.0f} deg, needs {settings.min_coverage_deg:.0f} deg"
    return None


def rejection_reason(
    profile: PreparedProfile,
    section: CylinderSection,
    radius_range: tuple[float, float],
    settings: AcceptanceSettings = AcceptanceSettings(),
) -> str | None:
    """Why a fitted section is none of a cylinder; None if nothing speaks against it.

    Parameters
    ----------
    profile : PreparedProfile
        The profile.
    section : CylinderSection
        With indices of the prepared profile.
    radius_range : tuple of float
        Units: mm.
    settings : AcceptanceSettings
        Limits.
    """
    fit = section.fit
    reason = shape_rejection_reason(fit.ellipse, fit.normals, radius_range, settings)
    reason = reason or next(_objections_of_points(profile, section, settings), None)
    # With a known radius the fit cannot run off to a needle: it stops at the kink of b at a circle.
    if reason is None and not fit.converged and fit.problem.known_radius is None:
        tilt_deg = math.degrees(fit.ellipse.phi)
        reason = (
            f"no ellipse fits best: the flatter the better (the fit stopped at {tilt_deg:.0f} deg)"
        )
    return reason or undeterminable_radius_reason(section)


def _objections_of_points(
    profile: PreparedProfile, section: CylinderSection, settings: AcceptanceSettings
) -> Iterator[str]:
    """Beside the ellipse, flat within the noise, or with too many outliers among them."""
    fit, count = section.fit, len(section.indices)
    variances = 2 * profile.noisy_points.mean_variance[section.indices]
    scatter = math.sqrt(float(fit.residuals @ fit.residuals) / variances.sum())
    limit = profile.max_noise_factor(fit.ellipse.radius)
    if scatter > limit:
        hint = "" if profile.noise_is_estimated else ": is the sensor's noise right?"
        yield f"residual rms {scatter:.1f} times the noise, limit {limit:.1f}{hint}"
    middle = complex(fit.normals.sum()) / count
    heights = (profile.noisy_points.z[section.indices] * middle.conjugate()).real
    sagitta = _extent(heights) / max(abs(middle), 0.1)
    noise = math.sqrt(float(fit.problem.stds @ fit.problem.stds) / count)
    if sagitta < settings.min_sagitta_sigmas * noise / math.sqrt(count):
        yield f"flat: rises {sagitta:.2f} mm over its chord at {noise:.2f} mm noise"
    span = int(np.isfinite(profile.points[section.arc.start : section.arc.stop, 0]).sum())
    if count < settings.min_inlier_fraction * span:
        yield f"only {count} of {span} points of the span lie on the ellipse"


def undeterminable_radius_reason(section: CylinderSection) -> str | None:
    """Why a radius is not determinable: its own 95 % interval does not bound it within a factor 2.

    A known radius or tilt bounds it from outside; then nothing is said.

    Parameters
    ----------
    section : CylinderSection
        The fit with its intervals.
    """
    problem = section.fit.problem
    if problem.known_radius is not None or problem.known_phi is not None:
        return None
    radius, std = section.radius, section.radius_std
    if radius > CERTAIN_RADIUS_SIGMAS * std:
        return None
    if radius < MIN_RADIUS_SIGMAS * std:
        return f"radius not determinable: {radius:.3g} +/- {std:.2g} mm; a longer arc is needed"
    low, high = section.interval("radius")
    if max(high / radius, radius / low) <= MAX_RADIUS_RATIO:
        return None
    return f"radius not determinable: {low:.3g} to {high:.3g} mm (95 %); a longer arc is needed"


def coverage(normals: ComplexArray) -> float:
    """Angle of the fan of an arc's normals. Units: rad."""
    return _extent(np.angle(normals * normals.sum().conj()))


def _extent(values: FloatArray) -> float:
    return float(values.max() - values.min())
