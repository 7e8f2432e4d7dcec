"""Profile-likelihood intervals, valid also where the linear approximation is not.

With F the sum of the squared residuals over their standard deviations and over the variance factor
(-2 log likelihood), the interval of a quantity g contains the values v with min {F : g = v} - min F
<= c. Its ends are the extrema of g over {F <= min F + c}; those of all quantities are computed
together (`lsvision.ellipse.interval_ends`).

For radius and centre, c is the quantile of chi^2 with one degree of freedom (Wilks' theorem), or
that of the F distribution where the noise is estimated. Phi and theta are functions of h / m and
the direction of d = (p, q) (`lsvision.ellipse.parameters`): nearly polar coordinates with the
circle as origin. Within a few standard deviations of it their likelihood ratio is not chi^2
distributed; its quantile is computed from the normal approximation of d
(`lsvision.ellipse.critical_ratio`).

At a circle the radius m - h is at the tip of the cone of all ellipses with that radius, from which
the estimate is farther than from a plane: where a circle is possible, the interval of the radius
also contains that of the radius of a circle. Without this, 86 % of the 95 % intervals of full
circles, 90 % of those of arcs of 240 deg and 93 % of half circles contain the radius; with it 94,
96 and 97 %.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple, get_args
from weakref import WeakKeyDictionary

import numpy as np

from lsvision.ellipse.critical_ratio import CriticalRatios
from lsvision.ellipse.fit_result import EllipseFit
from lsvision.ellipse.fit_stack import FitStack
from lsvision.ellipse.interval_ends import IntervalEnds, find_interval_ends
from lsvision.ellipse.parameters import semi_minor_gradient
from lsvision.ellipse.phi_prior import EXACT_STD
from lsvision.ellipse.region_extrema import (
    CIRCLE,
    END_COUNT,
    PHI_HIGH,
    PHI_HIGH_2,
    PHI_LOW,
    RADIUS_HIGH,
    RADIUS_LOW,
    RADIUS_LOW_2,
    SECOND_ENDS,
    THETA_HIGH,
    THETA_LOW,
    X_HIGH,
    X_LOW,
    Y_HIGH,
    Y_LOW,
)
from lsvision.geometry import FloatArray
from lsvision.geometry.arrays import TINY

SectionQuantity = Literal["radius", "theta", "phi", "centre_x", "centre_y"]
"""Quantities of a section that have an interval."""
Interval = tuple[float, float]
"""Low and high end. Units: mm or rad."""

THETA_LEVEL, MAX_THETA_ERROR = 0.95, math.radians(23.0)
"""Level of confidence of a determined theta, and largest half width of its interval (rad): far from
a circle, that of 30 deg at 99 %."""
MAX_PHI = math.radians(88.0)
"""Largest phi of an interval; at 90 deg the section is no ellipse. Units: rad."""
MIN_RADIUS_FACTOR, MAX_RADIUS_FACTOR = 0.02, 50.0
"""Limits of an interval of the radius, as multiples of the estimated radius: so far beyond the
factor of 2 from which on detection rejects a radius that their size does not matter. The second is
also the largest distance of an end of the centre's interval from the estimate, in semi-major
axes."""
ENDS_OF = {
    "radius": ((RADIUS_LOW, RADIUS_LOW_2), (RADIUS_HIGH,)),
    "phi": ((PHI_LOW, CIRCLE), (PHI_HIGH, PHI_HIGH_2)),
    "centre_x": ((X_LOW,), (X_HIGH,)),
    "centre_y": ((Y_LOW,), (Y_HIGH,)),
}
"""Ends of the search from which the low and the high end of each interval are computed."""
ENDS_OF_THETA = THETA_LOW, THETA_HIGH, CIRCLE
"""The same for both ends of theta."""
MAX_PRIOR_STD_RATIO = 0.995
"""Largest ratio of a known quantity's std to its prior's with which the points contribute: there
the points have 1 % of the information of the prior (1 / 0.995^2 - 1). Above it the interval is that
of the prior."""
MIN_NOISE_RATIO = 1e-9
"""Smallest ratio of the points' noise to the mean semi-axis m: below it F consists of rounding
errors."""


class Intervals(NamedTuple):
    """Intervals (low, high) of all quantities. Units: mm, rad."""

    radius: Interval
    theta: Interval
    phi: Interval
    centre_x: Interval
    centre_y: Interval


class _FitIntervals(NamedTuple):
    """Intervals of a fit, and whether a circle is excluded at 99.9 %."""

    intervals: Intervals
    is_no_circle: bool


# Results that were computed for each fit, by level; they are dropped together with the fit.
_INTERVALS_BY_FIT: WeakKeyDictionary[EllipseFit, dict[float, _FitIntervals]] = WeakKeyDictionary()


def find_interval(fit: EllipseFit, quantity: SectionQuantity, level: float = 0.95) -> Interval:
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
        Ends of the interval; see `find_intervals`.

    Raises
    ------
    ValueError
        If the quantity is unknown, or the level is not between 0 and 1.
    """
    if quantity not in get_args(SectionQuantity):
        raise ValueError(
            f"expected one of {', '.join(get_args(SectionQuantity))}, got {quantity!r}"
        )
    ends: Interval = getattr(find_intervals(fit, level), quantity)
    return ends


def find_intervals(fit: EllipseFit, level: float = 0.95) -> Intervals:
    """Return the intervals of all quantities, each with a coverage probability of `level`.

    Parameters
    ----------
    fit : EllipseFit
        The fit.
    level : float
        Level of confidence, between 0 and 1.

    Returns
    -------
    Intervals
        Units: mm or rad. Theta extends from low to high, also beyond [0, pi); (0, pi) if every
        direction is possible. Phi is limited to [0, 88 deg], the radius to 0.02 to 50 times the
        estimate; a limit is returned where the search finds no end, as on arcs of less than
        60 deg.

    Raises
    ------
    ValueError
        If the level is not between 0 and 1.

    References
    ----------
    Chuang and Lai, Hybrid resampling methods for confidence intervals, Statistica Sinica 10,
    2000 (the critical value of a likelihood ratio is computed for each value of the quantity).
    """
    return find_intervals_of_fits([fit], level)[0]


def find_intervals_of_fits(fits: Sequence[EllipseFit], level: float = 0.95) -> list[Intervals]:
    """Return the intervals of all quantities of several fits, three times as fast as of each alone.

    Each fit keeps its intervals, so that `find_intervals` does not compute them again.

    Parameters
    ----------
    fits : sequence of EllipseFit
        The fits.
    level : float
        Level of confidence, between 0 and 1.

    Returns
    -------
    list of Intervals
        See `find_intervals`.
    """
    if not 0 < level < 1:
        raise ValueError(f"expected a level between 0 and 1, got {level}")
    return [found.intervals for found in _look_up_intervals(fits, float(level))]


def is_theta_determined(fit: EllipseFit) -> bool:
    """Return whether a circle is excluded at 99.9 %, and an error of theta of 23 deg at 95 %."""
    return are_thetas_determined([fit])[0]


def are_thetas_determined(fits: Sequence[EllipseFit]) -> list[bool]:
    """Return `is_theta_determined` of several fits; it takes their intervals at 95 %."""
    determined = []
    for fit, (found, is_no_circle) in zip(fits, _look_up_intervals(fits, THETA_LEVEL), strict=True):
        (low, high), theta = found.theta, fit.ellipse.theta
        determined.append(is_no_circle and max(high - theta, theta - low) < MAX_THETA_ERROR)
    return determined


def _look_up_intervals(fits: Sequence[EllipseFit], level: float) -> list[_FitIntervals]:
    """Return the intervals of fits, those that are kept and those that are computed now."""
    kept = [_INTERVALS_BY_FIT.setdefault(fit, {}) for fit in fits]
    new = [fit for fit, levels in zip(fits, kept, strict=True) if level not in levels]
    for fit, found in zip(new, _compute_intervals(new, level), strict=True):
        _INTERVALS_BY_FIT[fit][level] = found
    return [levels[level] for levels in kept]


def _compute_intervals(fits: Sequence[EllipseFit], level: float) -> list[_FitIntervals]:
    """Return the intervals of fits whose results are not kept."""
    if not fits:
        return []
    stack = FitStack.of([_with_min_noise(fit) for fit in fits])
    critical_ratios = CriticalRatios.of(stack, level)
    known = list(
        map(
            _find_intervals_of_known_quantities,
            stack.fits,
            np.sqrt(critical_ratios.one_dof).tolist(),
        )
    )
    wanted = np.ones((len(fits), END_COUNT), dtype=bool)
    for row, quantities in zip(wanted, known, strict=True):
        if "radius" in quantities:
            row[[RADIUS_LOW, RADIUS_HIGH, RADIUS_LOW_2]] = False
        if "phi" in quantities:
            row[[PHI_LOW, PHI_HIGH, PHI_HIGH_2]] = False
    ends = find_interval_ends(stack, critical_ratios, wanted)
    is_no_circle = ends.circle_ratios > critical_ratios.no_circle
    is_no_circle |= ~stack.may_be_circle
    computed = map(_intervals_between, stack.fits, _split_by_fit(stack, critical_ratios, ends))
    return [
        _FitIntervals(intervals_of_fit._replace(**quantities), excluded)
        for intervals_of_fit, quantities, excluded in zip(
            computed, known, is_no_circle.tolist(), strict=True
        )
    ]


def _with_min_noise(fit: EllipseFit) -> EllipseFit:
    """Return the fit with at least the noise that F can resolve numerically."""
    min_factor = (MIN_NOISE_RATIO * float(fit.parameters[2]) / float(fit.problem.stds.min())) ** 2
    return fit if fit.variance_factor >= min_factor else replace(fit, variance_factor=min_factor)


def _find_intervals_of_known_quantities(fit: EllipseFit, sigmas: float) -> dict[str, Interval]:
    """Return the intervals of quantities that only their priors determine, not the points.

    They extend `sigmas` standard deviations to either side of the estimate.
    """
    covariance, ellipse, problem = fit.parameter_covariance, fit.ellipse, fit.problem
    known = {}
    if problem.known_radius is not None:
        gradient = semi_minor_gradient(fit.parameters)
        std = math.sqrt(max(float(gradient @ covariance @ gradient), 0.0))
        if std > MAX_PRIOR_STD_RATIO * problem.known_radius.effective_std:
            known["radius"] = ellipse.radius - sigmas * std, ellipse.radius + sigmas * std
    if problem.known_phi is not None and not problem.known_phi.includes_circle:
        # The residual of the prior is phi over the prior's std, and so is its gradient.
        _, (gradient,) = problem.known_phi.residuals_and_jacobian(fit.parameters)
        std_ratio = math.sqrt(max(float(gradient @ covariance @ gradient), 0.0))
        if std_ratio > MAX_PRIOR_STD_RATIO:
            std = std_ratio * max(problem.known_phi.std, EXACT_STD)
            known["phi"] = ellipse.phi - sigmas * std, ellipse.phi + sigmas * std
    return known


class _EndsOfFit(NamedTuple):
    """Result of the search for the ends of the intervals of one fit.

    Parameters
    ----------
    parameters : (13, 5) ndarray
        Parameters (centre_x, centre_y, m, p, q) at each end. Units: mm.
    wanted : sequence of bool
        Which of the 13 ends of `lsvision.ellipse.region_extrema` were searched.
    reliable : sequence of bool
        Which of them were found; limits are reported for the others.
    may_be_circle, any_theta : bool
        Whether a circle is possible at the level: by the critical ratio of phi, which then may be
        0, and by that of d, with which theta may have any value.
    max_circle_radius : float
        Upper end of the interval of the radius of a circle. Units: mm.
    """

    parameters: FloatArray
    wanted: Sequence[bool]
    reliable: Sequence[bool]
    may_be_circle: bool
    any_theta: bool
    max_circle_radius: float


def _split_by_fit(
    stack: FitStack, critical_ratios: CriticalRatios, ends: IntervalEnds
) -> Iterator[_EndsOfFit]:
    """Return the result of the search for each fit."""
    may_be_circle = ends.circle_ratios <= critical_ratios.for_circle
    any_theta = critical_ratios.allows_any_theta(ends.circle_ratios)
    # The information about m where p and q are known to be 0, for any centre.
    information = np.linalg.pinv(stack.covariances[:, 2:, 2:])[:, 0, 0]
    stds = 1 / np.sqrt(np.maximum(information, TINY))
    max_circle_radii = ends.parameters[:, CIRCLE, 2] + np.sqrt(critical_ratios.one_dof) * stds
    columns = [ends.wanted, ends.reliable, may_be_circle, any_theta, max_circle_radii]
    return map(_EndsOfFit, ends.parameters, *(column.tolist() for column in columns))


def _intervals_between(fit: EllipseFit, ends: _EndsOfFit) -> Intervals:
    """Return the intervals between end points, clipped to their limits."""
    limits = _limit_intervals(fit)
    x, y, m, p, q = ends.parameters.T.tolist()
    h = list(map(math.hypot, p, q))
    # Both local extrema, if both were searched; the first, with the estimate in it, if none was.
    radius_low_ends, phi_high_ends = (
        [end for end in pair if ends.wanted[end]] or [pair[0]] for pair in SECOND_ENDS.items()
    )
    phi_low, *phi_highs = (
        2 * math.atan(math.sqrt(min(h[end] / m[end], 1.0))) for end in (PHI_LOW, *phi_high_ends)
    )
    max_radius = m[RADIUS_HIGH] - h[RADIUS_HIGH]
    if ends.may_be_circle and ends.reliable[CIRCLE]:
        max_radius = max(max_radius, ends.max_circle_radius)
    any_theta = ends.any_theta or not all(ends.reliable[end] for end in ENDS_OF_THETA)
    between = Intervals(
        radius=(min(m[end] - h[end] for end in radius_low_ends), max_radius),
        theta=limits.theta if any_theta else _theta_interval(fit, ends.parameters),
        phi=(0.0 if ends.may_be_circle else phi_low, max(phi_highs)),
        centre_x=(x[X_LOW], x[X_HIGH]),
        centre_y=(y[Y_LOW], y[Y_HIGH]),
    )
    clipped = {
        name: _clip(
            getattr(between, name),
            getattr(limits, name),
            [all(ends.reliable[end] for end in side) for side in sides],
        )
        for name, sides in ENDS_OF.items()
    }
    return between._replace(**clipped)


def is_limit_of_radius(end: float, radius: float) -> bool:
    """Return whether an end of the interval of a radius is a limit, because no end was found."""
    return not MIN_RADIUS_FACTOR * radius < end < MAX_RADIUS_FACTOR * radius


def _clip(interval: Interval, limits: Interval, found: Sequence[bool]) -> Interval:
    """Return an interval within its limits; a limit takes the place of an end that is not found."""
    (low, high), (lowest, highest), (low_found, high_found) = interval, limits, found
    return max(low, lowest) if low_found else lowest, min(high, highest) if high_found else highest


def _theta_interval(fit: EllipseFit, ends: FloatArray) -> Interval:
    """Return the interval of theta, at most 90 deg to either side of the estimate."""
    theta, quarter = fit.ellipse.theta, math.pi / 2
    low, high = (
        math.remainder(math.atan2(q, p) / 2 - theta, math.pi)
        for p, q in ends[[THETA_LOW, THETA_HIGH], 3:].tolist()
    )
    # An end on the other side of the estimate is more than 90 deg away on its own.
    return theta + (low if low <= 0 else -quarter), theta + (high if high >= 0 else quarter)


def _limit_intervals(fit: EllipseFit) -> Intervals:
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
