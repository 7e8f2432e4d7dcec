"""Geometric refinement of one arc (paper section 2.3), and of the points that it rests on.

Which points are an arc's last ones, only the fit to all of it can tell: where a line grazes, a
point weighs as much as ten elsewhere, and so does a jump.
"""

import math
from typing import NamedTuple

from lsvision.detection.acceptance import AcceptanceSettings
from lsvision.detection.end_extension import EndExtensionSettings, extend_ends
from lsvision.detection.identification import IdentifiedArc
from lsvision.ellipse.fit import EllipseFit, FittingSettings, fit_ellipse
from lsvision.ellipse.influence import reject_influential_points
from lsvision.ellipse.phi_prior import PhiPrior
from lsvision.ellipse.problem import RadiusPrior
from lsvision.profile import PreparedProfile

MAX_END_EXTENSIONS = 3
"""To an arc that has reached out further. Each end it reaches makes the fit surer of the other."""


class Priors(NamedTuple):
    """Priors of the fit."""

    radius: RadiusPrior | None
    phi: PhiPrior | None


def refine_arc(
    profile: PreparedProfile,
    arc: IdentifiedArc,
    known: Priors,
    fitting: FittingSettings = FittingSettings(),
    reaching: EndExtensionSettings = EndExtensionSettings(),
    verdict: AcceptanceSettings = AcceptanceSettings(),
) -> tuple[EllipseFit, IdentifiedArc]:
    """Fit an ellipse to an arc, and to what the fit shows to belong to the arc.

    Where the noise is known, the fit reaches for last points that growth and screening were
    unsure of, and leaves out one that alone spoils it.

    Parameters
    ----------
    profile : PreparedProfile
        The profile.
    arc : IdentifiedArc
        Its points without jumps, and the ellipse to start from.
    known : Priors
        Priors.
    fitting, reaching : settings
        Of the fit, and of the reaching.
    verdict : AcceptanceSettings
        An arc does not reach for what tilts it further than this permits.

    Returns
    -------
    fit : EllipseFit
        To the points of the arc returned.
    arc : IdentifiedArc
        With the fit's ellipse.

    Raises
    ------
    LsvisionError
        If the points have no ellipse; see `fit_ellipse`.
    """
    fit, fitted = _fit(profile, arc, known, fitting)
    if not (profile.noise_known and fit.converged):
        return fit, fitted
    for _ in range(MAX_END_EXTENSIONS):
        wider_arc = extend_ends(profile, fitted, fit.parameter_covariance, reaching)
        if wider_arc is fitted:
            break
        # An arc that hardly has an ellipse may reach for anything: not for what makes it no pipe.
        wider, wider_fitted = _fit(profile, wider_arc, known, fitting)
        if not wider.converged or math.degrees(wider.ellipse.phi) > verdict.max_tilt_deg:
            break
        fit, fitted = wider, wider_fitted
    if not (kept := reject_influential_points(fit)).all():
        rest = IdentifiedArc(fitted.arc, fitted.indices[kept], fit.ellipse)
        return _fit(profile, rest, known, fitting)
    return fit, fitted


def _fit(
    profile: PreparedProfile, arc: IdentifiedArc, known: Priors, settings: FittingSettings
) -> tuple[EllipseFit, IdentifiedArc]:
    fit = fit_ellipse(
        profile.points[arc.indices],
        arc.ellipse,
        profile.covariances[arc.indices] if profile.noise_known else None,
        known_radius=known.radius,
        known_phi=known.phi,
        settings=settings,
    )
    return fit, IdentifiedArc(arc.arc, arc.indices, fit.ellipse)
