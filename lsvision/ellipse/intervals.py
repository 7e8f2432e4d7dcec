"""Profile-likelihood intervals, valid also where the linear approximation is not.

With F the weighted sum of squares over the variance factor, the interval of a quantity g contains
the values v with min {F : g = v} - min F <= c. Its ends are the extrema of g over {F <= min F + c};
those of all quantities are computed together (`lsvision.ellipse.interval_ends`).

For radius and centre, c is the quantile of chi^2 with one degree of freedom. Phi and theta are
polar coordinates of d = (p, q), with the circle as origin. Within a few sigmas of it their ratio is
not chi^2 distributed; its quantile is computed from the normal approximation of d.
"""

import math
from dataclasses import replace
from functools import lru_cache
from typing import Literal, NamedTuple, get_args

import numpy as np

from lsvision.ellipse import region_extrema as rows
from lsvision.ellipse.critical_ratio import CriticalRatios
from lsvision.ellipse.fit import EllipseFit
from lsvision.ellipse.interval_ends import EndPoints, find_end_points
from lsvision.ellipse.parameters import semi_minor_gradient
from lsvision.ellipse.phi_prior import EXACT_STD
from lsvision.statistics.quantiles import squared_quantile

Quantity = Literal["radius", "theta", "phi", "centre_x", "centre_y"]
Interval = tuple[float, float]

THETA_LEVEL, THETA_MAX_ERROR = 0.99, math.radians(30.0)
"""Level of confidence of a determined theta, and largest half width of its interval. Units: rad."""
CIRCLE_LEVEL = 0.999
"""Level of confidence at which a circle must be excluded for theta to be determined."""
CLEAR_RATIO = 4.0
"""Ratio of two values of F - min F above which the linear approximation decides which is larger."""
MAX_PHI = math.radians(88.0)
"""Largest phi of an interval."""
MIN_RADIUS_FACTOR, MAX_RADIUS_FACTOR = 0.02, 50.0
"""Limits of an interval of the radius, in radii; the second, in semi-major axes, of the centre."""
PRIOR_SHARE = 0.995
"""Ratio of a known quantity's std to its prior's, above which its interval is that of the prior."""
MIN_NOISE = 1e-9
"""Smallest noise of points over m: below it F consists of rounding errors."""
CACHED_FITS = 64
"""Number of fits and levels whose intervals are cached: those of several profiles."""


class Intervals(NamedTuple):
    """Intervals (low, high) of all quantities. Units: mm, rad."""

    radius: Interval
    theta: Interval
    phi: Interval
    centre_x: Interval
    centre_y: Interval


def interval(fit: EllipseFit, quantity: Quantity, level: float = 0.95) -> Interval:
    """Return the interval that contains the true value of a quantity with probability `level`.

    Parameters
    ----------
    fit : EllipseFit
        The fit.
    quantity : {"radius", "theta", "phi", "centre_x", "centre_y"}
        Quantity of the interval.
    level : float
        Level of confidence, between 0 and 1.

    Returns
    -------
    low, high : float
        See `intervals`.

    Raises
    ------
    ValueError
        If the quantity is unknown, or the level is not between 0 and 1.
    """
    if quantity not in get_args(Quantity):
        raise ValueError(f"expected one of {', '.join(get_args(Quantity))}, got {quantity!r}")
    ends: Interval = getattr(intervals(fit, level), quantity)
    return ends


def intervals(fit: EllipseFit, level: float = 0.95) -> Intervals:
    """Return the intervals of all quantities, each with a coverage probability of `level`.

    Parameters
    ----------
    fit : EllipseFit
        The fit; its intervals are cached.
    level : float
        Level of confidence, between 0 and 1.

    Returns
    -------
    Intervals
        Units: mm or rad. Theta extends from low to high, also beyond [0, pi); (0, pi) if every
        direction is possible. Phi is limited to [0, 88 deg], the radius to 0.02 to 50 times the
        estimate; these limits are returned where the search finds no end, as on arcs of less
        than 60 deg.

    Raises
    ------
    ValueError
        If the level is not between 0 and 1.

    References
    ----------
    Chuang and Lai, Hybrid resampling methods for confidence intervals, Statistica Sinica 10,
    2000 (the idea of the computed quantile).
    """
    if not 0 < level < 1:
        raise ValueError(f"expected a level between 0 and 1, got {level}")
    return _compute_intervals(fit, float(level))


@lru_cache(maxsize=CACHED_FITS)
def theta_is_determined(fit: EllipseFit) -> bool:
    """Return whether a circle is excluded at 99.9 %, and an error of theta of 30 deg at 99 %."""
    fit = _with_noise(fit)
    clear = _is_clearly_determined(fit)
    if clear is not None:
        return clear
    ratios, wanted = CriticalRatios.of(fit, THETA_LEVEL), np.zeros(rows.ROWS, dtype=bool)
    wanted[[rows.THETA_LOW, rows.THETA_HIGH, rows.CIRCLE]] = True
    ends = find_end_points(fit, ratios, wanted)
    of_circle = squared_quantile(2, fit.degrees_of_freedom, CIRCLE_LEVEL)
    if ratios.may_be_circle and ends.circle_ratio <= of_circle:
        return False
    low, high = _theta_interval(fit, ends)
    furthest = max(high - fit.ellipse.theta, fit.ellipse.theta - low)
    return ends.reliable and furthest < THETA_MAX_ERROR


def _is_clearly_determined(fit: EllipseFit) -> bool | None:
    """Return whether theta is determined in the linear approximation; None if that is not clear."""
    if fit.problem.known_phi is not None:  # not linear in d
        return None
    of_circle = squared_quantile(2, fit.degrees_of_freedom, CIRCLE_LEVEL)
    of_theta = squared_quantile(1, fit.degrees_of_freedom, THETA_LEVEL)
    covariance, d = fit.parameter_covariance[3:, 3:], fit.parameters[3:]
    ratio = float(d @ np.linalg.solve(covariance, d))
    if ratio < of_circle / CLEAR_RATIO:
        return False
    across = np.array([-d[1], d[0]]) / float(d @ d)
    theta_variance = float(across @ covariance @ across) / 4
    if ratio > CLEAR_RATIO * of_circle and (
        CLEAR_RATIO * of_theta * theta_variance < THETA_MAX_ERROR**2
    ):
        return True
    return None


@lru_cache(maxsize=CACHED_FITS)  # a fit is equal to itself alone
def _compute_intervals(fit: EllipseFit, level: float) -> Intervals:
    fit = _with_noise(fit)
    ratios = CriticalRatios.of(fit, level)
    known = _known_quantities(fit, math.sqrt(ratios.one))
    wanted = np.ones(rows.ROWS, dtype=bool)
    if "radius" in known:
        wanted[[rows.RADIUS_LOW, rows.RADIUS_HIGH, rows.RADIUS_LOW_2]] = False
    if "phi" in known:
        wanted[[rows.PHI_LOW, rows.PHI_HIGH, rows.PHI_HIGH_2]] = False
    ends = find_end_points(fit, ratios, wanted)
    computed = _intervals_between(fit, ratios, ends) if ends.reliable else _limits(fit)
    return computed._replace(**known)


def _with_noise(fit: EllipseFit) -> EllipseFit:
    """Return the fit with at least the noise that F can resolve numerically."""
    least = (MIN_NOISE * float(fit.parameters[2]) / float(fit.problem.stds.min())) ** 2
    return fit if fit.variance_factor >= least else replace(fit, variance_factor=least)


def _known_quantities(fit: EllipseFit, sigmas: float) -> dict[str, Interval]:
    """Return the intervals of quantities that only their priors determine, not the points."""
    covariance, ellipse, problem = fit.parameter_covariance, fit.ellipse, fit.problem
    known = {}
    if problem.known_radius is not None:
        gradient = semi_minor_gradient(fit.parameters)
        std = math.sqrt(max(float(gradient @ covariance @ gradient), 0.0))
        if std > PRIOR_SHARE * problem.known_radius.effective_std:
            known["radius"] = ellipse.radius - sigmas * std, ellipse.radius + sigmas * std
    if problem.known_phi is not None and not problem.known_phi.includes_circle:
        _, (gradient,) = problem.known_phi.residuals_and_jacobian(fit.parameters)
        std_ratio = math.sqrt(max(float(gradient @ covariance @ gradient), 0.0))
        if std_ratio > PRIOR_SHARE:
            std = std_ratio * max(problem.known_phi.std, EXACT_STD)
            known["phi"] = ellipse.phi - sigmas * std, ellipse.phi + sigmas * std
    return known


def _intervals_between(fit: EllipseFit, ratios: CriticalRatios, ends: EndPoints) -> Intervals:
    """Return the intervals between end points, clipped to their limits."""
    x, y, m, p, q = ends.parameters.T.tolist()
    h = list(map(math.hypot, p, q))
    low, high = (
        [row for row in pair if ends.wanted[row]] or [pair[0]] for pair in rows.SECOND_ROWS.items()
    )
    phi_low, *phi_highs = (
        2 * math.atan(math.sqrt(min(h[row] / m[row], 1.0))) for row in (rows.PHI_LOW, *high)
    )
    circle = ends.circle_ratio <= ratios.of_circle
    limits = _limits(fit)
    found = Intervals(
        radius=(
            min(m[row] - h[row] for row in low),
            m[rows.RADIUS_HIGH] - h[rows.RADIUS_HIGH],
        ),
        theta=_theta_interval(fit, ends),
        phi=(0.0 if circle else phi_low, max(phi_highs)),
        centre_x=(x[rows.X_LOW], x[rows.X_HIGH]),
        centre_y=(y[rows.Y_LOW], y[rows.Y_HIGH]),
    )
    if ratios.leaves_theta_open(ends.circle_ratio):
        found = found._replace(theta=limits.theta)
    clipped = {
        name: (max(low, least), min(high, most))
        for name, (low, high), (least, most) in zip(found._fields, found, limits, strict=True)
        if name != "theta"
    }
    return found._replace(**clipped)


def _theta_interval(fit: EllipseFit, ends: EndPoints) -> Interval:
    """Return the interval of theta, at most 90 deg to either side of the estimate."""
    theta, quarter = fit.ellipse.theta, math.pi / 2
    turns = []
    for row in (rows.THETA_LOW, rows.THETA_HIGH):
        p, q = ends.parameters[row, 3:].tolist()
        turns.append(math.remainder(math.atan2(q, p) / 2 - theta, math.pi))
    low, high = turns
    return theta + (low if low <= 0 else -quarter), theta + (high if high >= 0 else quarter)


def _limits(fit: EllipseFit) -> Intervals:
    """Return the widest intervals that are reported."""
    ellipse, (x, y) = fit.ellipse, fit.ellipse.centre
    far = MAX_RADIUS_FACTOR * ellipse.semi_major
    return Intervals(
        radius=(MIN_RADIUS_FACTOR * ellipse.radius, MAX_RADIUS_FACTOR * ellipse.radius),
        theta=(0.0, math.pi),
        phi=(0.0, MAX_PHI),
        centre_x=(x - far, x + far),
        centre_y=(y - far, y + far),
    )
