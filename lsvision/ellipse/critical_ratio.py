"""Critical likelihood ratios: the largest F - min F of values within an interval.

The vector d = (p, q) is taken to be normally distributed. Its length determines phi, its direction
theta: all d of one phi form a ring about the circle d = 0, all d of one theta a half line from it.
The ratio of a phi or theta is the squared distance, in sigmas, of the estimate from ring or half
line. Its quantile is the squared half width of the tube about them that contains the estimate with
a given probability: near the circle that of chi^2 with two degrees of freedom, else with one.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np

from lsvision.ellipse.fit import EllipseFit
from lsvision.geometry import FloatArray
from lsvision.statistics.quantiles import normal_probability, squared_quantile

MAX_SIGMAS, MAX_CURVATURE_RADIUS = 20.0, 1.2
"""Distance of the true d from the circle and smallest radius of curvature of the ring, in sigmas,
beyond which c is that of a straight line, within 1 %."""
MIN_RING_POINTS, MAX_RING_POINTS, RING_POINTS_PER_SIGMA = 32, 512, 6
"""Number of points of the integral along the ring: its limits, and per sigma of the semi-axis."""
MAX_DISTANCE = 5.0
"""Distance in sigmas from the true d beyond which a boundary of the tube has no probability."""
END_SIGMAS = np.linspace(0.0, 6.0, 61)
"""Distances of the true d from the end of the half line for which c is tabulated, in sigmas; at the
last it is that of a straight line."""
ARC_ANGLES, ARC_WEIGHTS = (math.pi / 2 * rule for rule in np.polynomial.legendre.leggauss(16))
"""Gauss-Legendre rule over the half circle that ends the tube about a half line. Units: rad."""
CACHED_LEVELS = 16
"""Number of levels whose quantiles and table for theta are cached."""
TINY = 1e-300


@dataclass(frozen=True, eq=False, slots=True)
class CriticalRatios:
    """Critical ratios c of one fit and level.

    Parameters
    ----------
    level : float
        Level of confidence.
    one, two : float
        c of one quantity and of both components of d; F quantiles where the noise was estimated.
    m : float
        m of the estimate. Units: mm.
    deviator : complex
        d of the estimate. Units: mm.
    semi_axes : tuple of float
        Semi-axes in sigmas of the ring |d| = 1 mm, the larger first.
    axis : complex
        Direction of the larger semi-axis.
    prior_fraction, of_prior : float
        Fraction of the information on d from a prior on phi that includes a circle, and its c.
    may_be_circle : bool
        Whether the section may be a circle: false if a prior on phi excludes it.
    """

    level: float
    one: float
    two: float
    m: float
    deviator: complex
    semi_axes: tuple[float, float]
    axis: complex
    prior_fraction: float
    of_prior: float
    may_be_circle: bool

    @classmethod
    def of(cls, fit: EllipseFit, level: float) -> Self:
        """Return the critical ratios of a fit at a level between 0 and 1."""
        one, two = (squared_quantile(k, fit.degrees_of_freedom, level) for k in (1, 2))
        covariance, m = fit.parameter_covariance[3:, 3:], float(fit.parameters[2])
        variances, axes = np.linalg.eigh(covariance)
        known = fit.problem.known_phi
        may_be_circle = known is None or known.includes_circle
        fraction = of_prior = 0.0
        if known is not None and may_be_circle:
            fraction = min(float(np.trace(covariance)) / (2 * (known.deviator_std * m) ** 2), 1.0)
            of_prior = known.max_likelihood_ratio(level)
        a, b = (1 / math.sqrt(max(variance, TINY)) for variance in variances.tolist())
        deviator, axis = complex(*fit.parameters[3:].tolist()), complex(*axes[:, 0].tolist())
        return cls(level, one, two, m, deviator, (a, b), axis, fraction, of_prior, may_be_circle)

    @property
    def of_circle(self) -> float:
        """Critical ratio of phi = 0."""
        return self.two + self.prior_fraction * max(self.of_prior - self.two, 0.0)

    def leaves_theta_open(self, circle_ratio: float) -> bool:
        """Return whether a circle with this ratio is possible: theta's interval is then (0, pi)."""
        return self.may_be_circle and circle_ratio <= self.two

    def of_flattening(self, kappas: Sequence[float]) -> list[float]:
        """Return c of phi for values of h / m and a true d in the direction of the estimate."""
        direction, (a, b) = self._in_sigmas(self.deviator), self.semi_axes
        reach = min(MAX_CURVATURE_RADIUS * a / (b * b), MAX_SIGMAS / abs(direction)) / self.m
        ratios = dict.fromkeys(kappas, self.one)
        near = [kappa for kappa in ratios if kappa < reach]
        if near:
            tubes = self._ring_tube(self.m * np.array(near), direction).tolist()
            fractions = [_fraction_of_two(self.level, tube) for tube in tubes]
            ratios.update(zip(near, map(self._interpolate, fractions), strict=True))
        of_prior, fraction = self.of_prior, self.prior_fraction
        return [ratios[kappa] + fraction * max(of_prior - ratios[kappa], 0.0) for kappa in kappas]

    def of_direction(self, deviator: complex) -> float:
        """Return c of theta for a direction of d and a true d of the estimate's length."""
        distance = abs(self.deviator) * abs(self._in_sigmas(deviator))
        fraction = np.interp(distance, END_SIGMAS, _half_line_fractions(self.level))
        return self._interpolate(float(fraction))

    def _interpolate(self, fraction: float) -> float:
        return (1 - fraction) * self.one + fraction * self.two

    def _in_sigmas(self, direction: complex) -> complex:
        """Return the unit vector of a direction in sigmas per mm, along the axes of the ring.

        The zero vector gives the first axis.
        """
        (a, b), unit = self.semi_axes, 1.0 + 0.0j
        if direction:
            unit = direction / abs(direction) * self.axis.conjugate()
        return complex(a * unit.real, b * unit.imag)

    def _ring_tube(self, h: FloatArray, direction: complex) -> FloatArray:
        """Return the probability of tubes of half width sqrt(chi2) about rings of radius h, (k, 3).

        By Green's theorem the probability of a region is the integral of 1 - exp(-r^2 / 2) over the
        polar angle of its boundary about the true d, with r the distance. The boundaries are
        parallel curves of the ring, an ellipse. Where the inner one crosses the major axis the tube
        has no hole; the boundary is then put on the axis, where both sides cancel.
        """
        a, b = self.semi_axes
        count = RING_POINTS_PER_SIGMA * a * float(h.max())
        count = int(min(max(count, MIN_RING_POINTS), MAX_RING_POINTS))
        widths = np.sqrt(_chi2_quantiles(self.level))
        t = np.arange(count) * (2 * np.pi / count)
        cos, sin = np.cos(t), np.sin(t)
        distances = np.hypot(a * cos - direction.real, b * sin - direction.imag) * h.min()
        within = distances < MAX_DISTANCE + widths[-1]
        cos, sin = cos[within], sin[within]
        size = np.hypot(b * cos, a * sin)
        s, h = np.concatenate([widths, -widths])[:, None], h[:, None, None]
        height = h * b + s * (a / size)
        uncrossed = height > 0
        x = cos * (h * a + s * (b / size)) - h * direction.real
        y = sin * height * uncrossed - h * direction.imag
        speed = h + s * (a * b / size**3)
        squared = x * x + y * y
        turn = speed * (b * cos * uncrossed * x + a * sin * y) / squared
        outside = (turn * np.exp(-squared / 2)).sum(axis=2) / count
        tube: FloatArray = 1 - outside[:, :3] + outside[:, 3:]
        return tube


@lru_cache(maxsize=CACHED_LEVELS)
def _chi2_quantiles(level: float) -> FloatArray:
    """Return the quantiles for one and two degrees of freedom, with their mean between them."""
    one, two = (squared_quantile(k, math.inf, level) for k in (1, 2))
    return np.array([one, (one + two) / 2, two])


@lru_cache(maxsize=CACHED_LEVELS)
def _half_line_fractions(level: float) -> FloatArray:
    """Return `_fraction_of_two` for a half line with a true d at `END_SIGMAS` from its end."""
    # The tube is integrated across the half line; along it the normal integral is known.
    s = np.sqrt(_chi2_quantiles(level))[:, None]
    across, along = s * np.sin(ARC_ANGLES), s * np.cos(ARC_ANGLES)
    density = np.exp(-across * across / 2) / math.sqrt(2 * math.pi)
    tubes = (density * normal_probability(END_SIGMAS[:, None, None] + along) * along) @ ARC_WEIGHTS
    return np.array([_fraction_of_two(level, tube) for tube in tubes.tolist()])


def _fraction_of_two(level: float, tube: Sequence[float]) -> float:
    """Return where c lies from `one` (0) to `two` (1), from probabilities of tubes of three widths.

    log(1 - probability) is linear in the squared width at a circle and nearly so elsewhere.
    """
    tail, target = [math.log1p(-min(each, 1 - 1e-15)) for each in tube], math.log1p(-level)
    position = 0.0
    for i, j, k, node in ((0, 1, 2, -1.0), (2, 0, 1, 1.0)):
        weight = (target - tail[j]) * (target - tail[k])
        position += node * weight / ((tail[i] - tail[j]) * (tail[i] - tail[k]) or TINY)
    return min(max((position + 1) / 2, 0.0), 1.0)
