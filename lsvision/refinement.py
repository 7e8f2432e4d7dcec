"""Geometric refinement of one arc (paper section 2.3), and of the points that it rests on.

Which points are an arc's last ones, only the fit to all of it can tell: where a line grazes, a
point weighs as much as ten elsewhere, and so does a jump.
"""

import math
from typing import NamedTuple

from lsvision.fitting.ellipse_fit import EllipseFit, FittingSettings, fit_ellipse
from lsvision.fitting.ellipse_problem import KnownRadius
from lsvision.fitting.known_phi import KnownPhi
from lsvision.fitting.leverage import without_leverage
from lsvision.profile import WeighedProfile
from lsvision.recognition.identification import IdentifiedArc
from lsvision.recognition.reaching import ReachingSettings, reach_out
from lsvision.recognition.verdict import VerdictSettings

MOST_REFITS = 3
"""To an arc that has reached out further. Each end it reaches makes the fit surer of the other."""


class Known(NamedTuple):
    """Priors of the fit."""

    radius: KnownRadius | None
    phi: KnownPhi | None


def refine_arc(
    profile: WeighedProfile,
    arc: IdentifiedArc,
    known: Known,
    fitting: FittingSettings = FittingSettings(),
    reaching: ReachingSettings = ReachingSettings(),
    verdict: VerdictSettings = VerdictSettings(),
) -> tuple[EllipseFit, IdentifiedArc]:
    """Fit an ellipse to an arc, and to what the fit shows to belong to the arc.

    Where the noise is known, the fit reaches for last points that growth and screening were
    unsure of, and leaves out one that alone spoils it.

    Parameters
    ----------
    profile : WeighedProfile
        The profile.
    arc : IdentifiedArc
        Its points without jumps, and the ellipse to start from.
    known : Known
        Priors.
    fitting, reaching : settings
        Of the fit, and of the reaching.
    verdict : VerdictSettings
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
    if not (profile.noise_known and fit.settled):
        return fit, fitted
    for _ in range(MOST_REFITS):
        wider_arc = reach_out(profile, fitted, fit.regular_covariance, reaching)
        if wider_arc is fitted:
            break
        # An arc that hardly has an ellipse may reach for anything: not for what makes it no pipe.
        wider, wider_fitted = _fit(profile, wider_arc, known, fitting)
        if not wider.settled or math.degrees(wider.ellipse.phi) > verdict.max_tilt_deg:
            break
        fit, fitted = wider, wider_fitted
    if not (kept := without_leverage(fit)).all():
        rest = IdentifiedArc(fitted.arc, fitted.indices[kept], fit.ellipse)
        return _fit(profile, rest, known, fitting)
    return fit, fitted


def _fit(
    profile: WeighedProfile, arc: IdentifiedArc, known: Known, settings: FittingSettings
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
