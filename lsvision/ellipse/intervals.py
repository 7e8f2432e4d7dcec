"""Intervals from the profile likelihood: right also where the linear approximation is not.

For a value of the quantity everything else is fitted anew; the interval holds the values whose
likelihood ratio stays below a critical one. For radius and centre that is chi^2 with one degree
of freedom. Phi and theta are polar coordinates of the deviator e = (p, q), whose origin is the
circle: within an error or two of it their ratio is no chi^2, and its quantile is computed, in
the normal approximation of e alone (which is regular there), by quadrature.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from lsvision.ellipse.constrained import (
    Constraint,
    circle_constraint,
    constrained_cost,
    fixed_centre,
    fixed_phi,
    fixed_radius,
    fixed_theta,
)
from lsvision.ellipse.fit import NONCIRCULAR_SIGMAS, EllipseFit
from lsvision.ellipse.parameters import semi_minor_gradient
from lsvision.shapes import FloatArray, Points

Quantity = Literal["radius", "theta", "phi", "centre_x", "centre_y"]
THETA_LEVEL, THETA_MAX_ERROR = 0.99, math.radians(30.0)
"""Confidence at which a theta that counts as determined is no further off."""
CIRCLE_LEVEL = 0.999
"""Confidence at which a section must be no circle before its theta counts as determined."""
MAX_PHI = math.radians(88.0)
INTERVAL_PRECISION = 0.01
"""An interval's ends are found to this share of a sigma."""
MIN_RADIUS_FACTOR, MAX_RADIUS_FACTOR = 0.02, 50.0


def interval(fit: EllipseFit, quantity: Quantity, level: float = 0.95) -> tuple[float, float]:
    """Interval that holds the true value with probability `level`.

    Parameters
    ----------
    fit : EllipseFit
        The fit.
    quantity : {"radius", "theta", "phi", "centre_x", "centre_y"}
        What the interval is of.
    level : float
        Between 0 and 1.

    Returns
    -------
    low, high : float
        Units: mm or rad. Theta runs from low to high and may leave [0, pi) to do so; (0, pi)
        if every direction is possible. Phi stays in [0, 88 deg].

    Raises
    ------
    ValueError
        If the quantity is none of these or the level is no probability.

    References
    ----------
    Chuang and Lai, Hybrid resampling methods for confidence intervals, Statistica Sinica 10,
    2000 (the idea of the computed quantile).
    """
    if quantity not in get_args(Quantity):
        raise ValueError(f"want one of {', '.join(get_args(Quantity))}, got {quantity!r}")
    if not 0 < level < 1:
        raise ValueError(f"want a level between 0 and 1, got {level}")
    likelihood = _ProfileLikelihood(fit, level)
    if quantity == "phi":
        return _phi_interval(likelihood)
    if quantity == "theta":
        return _theta_interval(likelihood)
    if quantity == "radius":
        radius = fit.ellipse.radius
        limits = MIN_RADIUS_FACTOR * radius, MAX_RADIUS_FACTOR * radius
        step = likelihood.std(semi_minor_gradient(fit.parameters))
        return likelihood.interval_around(fixed_radius, radius, step, limits)
    axis = 0 if quantity == "centre_x" else 1
    far = MAX_RADIUS_FACTOR * fit.ellipse.semi_major
    value = fit.ellipse.centre[axis]
    step = likelihood.std(np.eye(5)[axis])
    limits = value - far, value + far
    return likelihood.interval_around(lambda v: fixed_centre(axis, v), value, step, limits)


def theta_is_determined(fit: EllipseFit) -> bool:
    """Whether theta means something: no circle, at 99.9 %, and not 30 deg off, at 99 %."""
    if _is_theta_undetermined(_ProfileLikelihood(fit, CIRCLE_LEVEL)):
        return False
    surplus = _theta_excess_ratio(_ProfileLikelihood(fit, THETA_LEVEL))
    return all(surplus(fit.ellipse.theta + off) > 0 for off in (-THETA_MAX_ERROR, THETA_MAX_ERROR))


@dataclass(frozen=True, eq=False, slots=True)
class _ProfileLikelihood:
    """Likelihood ratios of a fit, in units of its own variance factor."""

    fit: EllipseFit
    level: float

    def ratio(self, constraint: Constraint) -> float:
        """-2 log of the likelihood with the constraint over that without."""
        best = self.fit.problem.evaluate(self.fit.parameters)[0]
        cost = constrained_cost(self.fit.problem, constraint, self.fit.parameters)
        return max(0.0, cost - float(best @ best)) / self.fit.variance_factor

    @property
    def critical_ratio_1d(self) -> float:
        """Critical ratio of one quantity; that of Student where the noise was estimated."""
        from scipy.special import fdtri

        if math.isinf(self.fit.degrees_of_freedom):
            return _chi2_of_one(self.level)
        return float(fdtri(1, self.fit.degrees_of_freedom, self.level))

    @property
    def critical_ratio_2d(self) -> float:
        """Critical ratio of both components of the deviator."""
        from scipy.special import chdtri, fdtri

        if math.isinf(self.fit.degrees_of_freedom):
            return float(chdtri(2, 1 - self.level))
        return 2 * float(fdtri(2, self.fit.degrees_of_freedom, self.level))

    def std(self, gradient: FloatArray) -> float:
        """One sigma of a quantity in the linear approximation."""
        return math.sqrt(float(gradient @ self.fit.parameter_covariance @ gradient))

    def interval_around(
        self,
        constrain: Callable[[float], Constraint],
        value: float,
        step: float,
        limits: tuple[float, float],
    ) -> tuple[float, float]:
        """Ends of the region around the estimate where the ratio stays below chi^2 of one."""
        critical = self.critical_ratio_1d

        def surplus(at: float) -> float:
            return self.ratio(constrain(at)) - critical

        return _find_sign_change(surplus, value, limits[0], step), _find_sign_change(
            surplus, value, limits[1], step
        )

    def critical_near_circle(self, at: FloatArray, alternatives: Points) -> float:
        """Quantile of the squared distance of e-hat from the nearest of the alternatives.

        `at` is the true deviator, `alternatives` the deviators that share its phi (or theta).
        """
        covariance = self.fit.parameter_covariance[3:, 3:]
        whiten = np.linalg.inv(np.linalg.cholesky(covariance))
        if math.hypot(*(whiten @ at)) > NONCIRCULAR_SIGMAS:
            return self.critical_ratio_1d
        drawn = _normal_grid() + whiten @ at
        others = alternatives @ whiten.T
        squares = (drawn**2).sum(axis=1)[:, None] + (others**2).sum(axis=1) - 2 * drawn @ others.T
        nearest = np.sort(squares.min(axis=1))
        quantile = float(np.interp(self.level * len(nearest), np.arange(len(nearest)), nearest))
        one, two = _chi2_of_one(self.level), -2 * math.log(1 - self.level)
        share = min(max((quantile - one) / (two - one), 0.0), 1.0)
        # Between one and two dimensions; Student's where the noise was estimated.
        return (1 - share) * self.critical_ratio_1d + share * self.critical_ratio_2d


def _is_theta_undetermined(likelihood: _ProfileLikelihood) -> bool:
    known = likelihood.fit.problem.known_phi
    if known is not None and not known.includes_circle:
        return False  # Used only where the points tell theta.
    return likelihood.ratio(circle_constraint()) <= likelihood.critical_ratio_2d


def _chi2_of_one(level: float) -> float:
    from scipy.special import chdtri

    return float(chdtri(1, 1 - level))


def _phi_interval(likelihood: _ProfileLikelihood) -> tuple[float, float]:
    fit = likelihood.fit
    m, theta = float(fit.parameters[2]), fit.ellipse.theta
    angles = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    share, of_prior = _prior_weight(likelihood)

    def surplus(phi: float) -> float:
        h = m * (1 - math.cos(phi)) / (1 + math.cos(phi))
        at = h * np.array([math.cos(2 * theta), math.sin(2 * theta)])
        critical = likelihood.critical_near_circle(at, h * ring)
        critical += share * max(of_prior - critical, 0.0)
        constraint = fixed_phi(phi) if phi > 0 else circle_constraint()
        return likelihood.ratio(constraint) - critical

    phi = fit.ellipse.phi
    # h = m (1 - cos phi) / (1 + cos phi), about m phi^2 / 4.
    std = math.sqrt(float(np.trace(fit.parameter_covariance[3:, 3:]))) / m
    step = min(2 * std / max(phi, 1e-9), 2 * math.sqrt(std), 0.5)
    return _find_sign_change(surplus, phi, 0.0, step), _find_sign_change(
        surplus, phi, MAX_PHI, step
    )


def _prior_weight(likelihood: _ProfileLikelihood) -> tuple[float, float]:
    """How much of what is known of (p, q) near a circle is the prior, and its critical ratio."""
    fit = likelihood.fit
    known = fit.problem.known_phi
    if known is None or not known.includes_circle:
        return 0.0, 0.0
    posterior = float(np.trace(fit.parameter_covariance[3:, 3:])) / float(fit.parameters[2]) ** 2
    share = min(posterior / (2 * known.deviator_std**2), 1.0)
    return share, known.max_likelihood_ratio(likelihood.level)


def _theta_excess_ratio(likelihood: _ProfileLikelihood) -> Callable[[float], float]:
    """Likelihood ratio of a theta less its critical value: positive outside the interval."""
    h = max(math.hypot(*likelihood.fit.parameters[3:]), 1e-12)
    away = np.concatenate([[0.0], np.geomspace(0.03, 10.0, 40)]) * h

    def surplus(at: float) -> float:
        direction = np.array([math.cos(2 * at), math.sin(2 * at)])
        critical = likelihood.critical_near_circle(h * direction, away[:, None] * direction)
        return likelihood.ratio(fixed_theta(at)) - critical

    return surplus


def _theta_interval(likelihood: _ProfileLikelihood) -> tuple[float, float]:
    fit = likelihood.fit
    p, q = fit.parameters[3:]
    h = max(math.hypot(p, q), 1e-12)
    theta, surplus = fit.ellipse.theta, _theta_excess_ratio(likelihood)
    quarter = math.pi / 2
    if _is_theta_undetermined(likelihood):
        return 0.0, math.pi
    step = min(likelihood.std(np.array([0, 0, 0, -q, p])) / (2 * h * h), 0.3)
    return (
        _find_sign_change(surplus, theta, theta - quarter, step),
        _find_sign_change(surplus, theta, theta + quarter, step),
    )


def _find_sign_change(
    surplus: Callable[[float], float], inside: float, limit: float, step: float
) -> float:
    """Where a function that is negative at `inside` turns positive; `limit` if it does not.

    Steps grow from one and a half until the sign turns, then Brent.
    """
    from scipy.optimize import brentq

    sign = math.copysign(1.0, limit - inside)
    last, reach = inside, 1.5 * step
    while last != limit:
        at = inside + sign * reach
        if (limit - at) * sign <= 0:
            at = limit
        if surplus(at) > 0:
            if last == inside and surplus(inside) >= 0:
                return inside  # noise-free: no width that numbers could show
            tolerance = max(INTERVAL_PRECISION * step, 1e-12)
            return float(brentq(surplus, last, at, xtol=tolerance, rtol=1e-12, maxiter=30))
        last, reach = at, 1.7 * reach
    return limit


def _normal_grid(radii: int = 28, angles: int = 24) -> Points:
    """Equally probable points of the standard normal distribution of the plane."""
    share = (np.arange(radii) + 0.5) / radii
    radius = np.sqrt(-2 * np.log(1 - share))
    turn = 2 * np.pi * (np.arange(angles) + 0.5) / angles
    grid = radius[:, None, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)[None]
    points: Points = grid.reshape(-1, 2)
    return points
