"""Is an arc a cylinder's? If not, the reason in words and numbers."""

import cmath
import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np

from lsvision.detection.arc_neighbours import neighbours_beyond_ends
from lsvision.detection.identification import IdentifiedArc
from lsvision.ellipse.fit import EllipseFit
from lsvision.ellipse.parameters import parameters_from_ellipse
from lsvision.ellipse.robust_gauss_newton import EllipseResiduals, ellipse_residuals
from lsvision.profile import Arc, PreparedProfile
from lsvision.shapes import Ellipse, FloatArray
from lsvision.shapes.arrays import extent_of
from lsvision.shapes.noisy_points import ComplexArray, NoisyPoints

LARGE_RADIUS_FRACTION, LARGE_RADIUS_MIN_SIGMAS = 0.3, 4.0
"""A radius over this share of the view must be known to this many sigmas."""


@dataclass(frozen=True, kw_only=True, slots=True)
class AcceptanceSettings:
    """What an arc must be to count as a cylinder's section.

    Parameters
    ----------
    min_points : int
        On the ellipse.
    min_coverage_deg : float
        Angle of the arc, as directions of its normal. Units: deg.
    max_tilt_deg : float
        Largest phi. Units: deg.
    min_sagitta_sigmas : float
        Height of the arc over its chord in standard deviations of its mean.
    min_inlier_fraction : float
        Share of the span's points that lie on the ellipse.
    min_turn_either_end_deg : float
        Both ends turn less than this: the crest of a bent sheet. Simulated tubes have at
        least one free end. Units: deg.
    min_turn_short_arc_deg : float
        One end of a short arc turns less than this: a rounded edge. Units: deg.
    short_arc_points : int
        Arcs with fewer points are short.
    """

    min_points: int = 12
    min_coverage_deg: float = 38.0
    max_tilt_deg: float = 60.0
    min_sagitta_sigmas: float = 20.0
    min_inlier_fraction: float = 0.7
    min_turn_either_end_deg: float = 35.0
    min_turn_short_arc_deg: float = 20.0
    short_arc_points: int = 20


@dataclass(frozen=True, slots=True)
class Rejection:
    """An arc that is no cylinder, and why.

    Parameters
    ----------
    arc : Arc
        The span.
    reason : str
        In words and numbers.
    """

    arc: Arc
    reason: str


def rejection_reason(
    profile: PreparedProfile,
    arc: IdentifiedArc,
    radius_range: tuple[float, float],
    settings: AcceptanceSettings = AcceptanceSettings(),
    *,
    noise_factor_scale: float = 1.0,
) -> str | None:
    """Why an arc is no section of a cylinder; None where nothing speaks against it.

    Parameters
    ----------
    profile : PreparedProfile
        The profile.
    arc : IdentifiedArc
        With its ellipse.
    radius_range : tuple of float
        Units: mm.
    settings : AcceptanceSettings
        Limits.
    noise_factor_scale : float
        By which the largest misfit is widened, for an arc whose ends are not screened yet.
    """
    compared = ellipse_residuals(
        profile.noisy_points[arc.indices], parameters_from_ellipse(arc.ellipse)
    )
    low, high = radius_range
    objections = chain(
        _shape_rejection_reasons(arc.ellipse, compared.normals, low, high, settings),
        _inlier_rejection_reasons(profile, arc, compared, noise_factor_scale, settings),
    )
    return next(objections, None)


def _shape_rejection_reasons(
    ellipse: Ellipse, normals: ComplexArray, low: float, high: float, settings: AcceptanceSettings
) -> Iterator[str]:
    """Few points, wrong way round, too small or large, too tilted, too short."""
    if len(normals) < settings.min_points:
        yield f"only {len(normals)} points on an ellipse, needs {settings.min_points}"
    if normals.imag.sum() <= 0:
        yield "concave towards the sensor"
    if not low <= ellipse.radius <= high:
        yield f"radius {ellipse.radius:.3g} mm outside {low:.3g} to {high:.3g} mm"
    tilt_deg = math.degrees(ellipse.phi)
    if tilt_deg > settings.max_tilt_deg:
        yield f"tilt {tilt_deg:.0f} deg over {settings.max_tilt_deg:.0f} deg"
    coverage_deg = math.degrees(coverage(normals))
    if coverage_deg < settings.min_coverage_deg:
        yield f"arc covers {coverage_deg:.0f} deg, needs {settings.min_coverage_deg:.0f} deg"


def _inlier_rejection_reasons(
    profile: PreparedProfile,
    arc: IdentifiedArc,
    compared: EllipseResiduals,
    slack: float,
    settings: AcceptanceSettings,
) -> Iterator[str]:
    """Beside the ellipse, flat within the noise, or with too many strangers among them."""
    count = len(compared.residuals)
    squares = compared.residuals * compared.residuals
    misfit = math.sqrt((squares / compared.variances).sum() / count)
    limit = profile.max_noise_factor(arc.ellipse.radius)
    if misfit > slack * limit:
        asked = ": is the sensor's noise right?" if profile.noise_known else ""
        yield f"residual rms {misfit:.1f} times the noise, limit {limit:.1f}{asked}"
    middle = complex(compared.normals.sum()) / count
    heights = (profile.noisy_points.z[arc.indices] * middle.conjugate()).real
    sagitta = _extent(heights) / max(abs(middle), 0.1)
    noise = math.sqrt(compared.variances.sum() / count)
    if sagitta < settings.min_sagitta_sigmas * noise / math.sqrt(count):
        yield f"flat: rises {sagitta:.2f} mm over its chord at {noise:.2f} mm noise"
    span = int(np.isfinite(profile.points[arc.arc.start : arc.arc.stop, 0]).sum())
    if count < settings.min_inlier_fraction * span:
        yield f"only {count} of {span} points of the span lie on the ellipse"


def convergence_rejection_reason(fit: EllipseFit) -> str | None:
    """Why a fit without a minimum has no ellipse; None where it settled.

    Parameters
    ----------
    fit : EllipseFit
        To the arc's points.
    """
    if fit.converged:
        return None
    tilt_deg = math.degrees(fit.ellipse.phi)
    return f"no ellipse fits best: the thinner the better (the fit came to {tilt_deg:.0f} deg tilt)"


def radius_rejection_reason(
    profile: PreparedProfile, radius: float, radius_std: float
) -> str | None:
    """Why a radius is none: less than its own error, or as large as the view and hardly known.

    A radius known to a few sigmas is a short arc, reported with its interval; a large one is
    any gentle curve.

    Parameters
    ----------
    profile : PreparedProfile
        The profile.
    radius, radius_std : float
        Units: mm.
    """
    if radius >= LARGE_RADIUS_MIN_SIGMAS * radius_std:
        return None
    said = f"radius {radius:.3g} +/- {radius_std:.2g} mm"
    if radius < radius_std:
        return f"{said}: the arc is too short or too noisy to have one"
    view = extent_of(profile.points[profile.valid_indices])
    if radius > LARGE_RADIUS_FRACTION * view:
        return f"{said}: any gentle curve in a view of {view:.0f} mm"
    return None


def coverage(normals: ComplexArray) -> float:
    """Angle of the fan of an arc's normals. Units: rad."""
    return _extent(np.angle(normals * normals.sum().conj()))


def _extent(values: FloatArray) -> float:
    return float(values.max() - values.min())


def neighbourhood_rejection_reason(
    profile: PreparedProfile,
    arc: IdentifiedArc,
    settings: AcceptanceSettings = AcceptanceSettings(),
) -> str | None:
    """Why the line around an arc tells that it is none; None where nothing speaks against it.

    A cylinder's line ends: at its own horizon, in a kink at the next thing. A crest of a bent
    sheet goes on smoothly at both ends, the rounded edge of a box at one.

    Parameters
    ----------
    profile : PreparedProfile
        The profile.
    arc : IdentifiedArc
        With its ellipse, before screening.
    settings : AcceptanceSettings
        What counts as smooth.
    """
    ahead = max(6, len(arc.indices) // 8)
    before, after = neighbours_beyond_ends(profile, arc.indices, ahead)
    own = profile.noisy_points[arc.indices]
    fewest = max(5, ahead // 2)
    turns = sorted(
        math.degrees(turn)
        for turn in (
            _end_turn_angle(own[::-1], before, arc.ellipse, fewest),
            _end_turn_angle(own, after, arc.ellipse, fewest),
        )
    )
    if turns[1] < settings.min_turn_either_end_deg:
        return f"goes on smoothly at both ends (turns {turns[0]:.0f} and {turns[1]:.0f} deg)"
    if turns[0] < settings.min_turn_short_arc_deg and len(own) < settings.short_arc_points:
        return f"rounded edge: {len(own)} points, goes on smoothly (turns {turns[0]:.0f} deg)"
    return None


def _end_turn_angle(own: NoisyPoints, beyond: ComplexArray, ellipse: Ellipse, fewest: int) -> float:
    """Angle between the tangent at the last point of `own` and the line that follows it.

    pi where fewer than `fewest` points follow: the arc's own frayed end. Units: rad.
    """
    if len(beyond) < fewest:
        return math.pi
    tangent = 1j * complex(ellipse_residuals(own[-1:], parameters_from_ellipse(ellipse)).normals[0])
    ahead = complex(own.z[-1] - own.z[-min(len(own), 6)])
    if (tangent * ahead.conjugate()).real < 0:
        tangent = -tangent
    # The principal axis of points has half the angle of the sum of their squares.
    centred = beyond - beyond.sum() / len(beyond)
    direction = cmath.sqrt(complex((centred * centred).sum()))
    if (direction * complex(beyond[-1] - beyond[0]).conjugate()).real < 0:
        direction = -direction
    return abs(cmath.phase(direction * tangent.conjugate()))
