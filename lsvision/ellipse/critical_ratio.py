"""Critical likelihood ratios: the largest F - min F of values within an interval.

The vector d = (p, q) is taken to be normally distributed. Its length determines phi, its direction
theta: all d of one phi form a ring about the circle d = 0, all d of one theta a half line from it.
The ratio of a phi or theta is the squared distance, in sigmas, of the estimate from ring or half
line. Its quantile is the squared half width of the tube about them that contains the estimate with
a given probability: near the circle that of chi^2 with two degrees of freedom, else with one.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from lsvision.ellipse.fit import EllipseFit
from lsvision.geometry import FloatArray

MAX_SIGMAS = 20.0
"""Distance from the circle, in sigmas, above which ring and half line are taken to be straight."""
MIN_RING_POINTS, MAX_RING_POINTS, RING_POINTS_PER_SIGMA = 96, 512, 16
"""Number of points of the integral along the ring: its limits, and per sigma of the semi-axis."""
ARC_ANGLES, ARC_WEIGHTS = (math.pi / 2 * rule for rule in np.polynomial.legendre.leggauss(16))
"""Gauss-Legendre rule over the half circle that ends the tube about a half line. Units: rad."""
TINY = 1e-300


@dataclass(frozen=True, eq=False, slots=True)
class CriticalRatios:
    """Critical ratios c of one fit and level.

    Parameters
    ----------
    level : float
        Level of confidence.
    chi2 : (3,) ndarray
        Quantiles of chi^2 with one and two degrees of freedom, and their mean between them.
    one, two : float
        c of one quantity and of both components of d; F quantiles where the noise was estimated.
    m : float
        m of the estimate. Units: mm.
    deviator : (2,) ndarray
        d of the estimate. Units: mm.
    semi_axes : (2,) ndarray
        Semi-axes in sigmas of the ring |d| = 1 mm, the larger first.
    axes : (2, 2) ndarray
        Directions of the semi-axes, in columns.
    prior_share, of_prior : float
        Fraction of the information on d from a prior on phi that includes a circle, and its c.
    may_be_circle : bool
        Whether the section may be a circle: false if a prior on phi excludes it.
    """

    level: float
    chi2: FloatArray
    one: float
    two: float
    m: float
    deviator: FloatArray
    semi_axes: FloatArray
    axes: FloatArray
    prior_share: float
    of_prior: float
    may_be_circle: bool

    @classmethod
    def of(cls, fit: EllipseFit, level: float) -> Self:
        """Return the critical ratios of a fit at a level between 0 and 1."""
        from scipy.special import chdtri, fdtri

        one, two, dof = chdtri(1, 1 - level), chdtri(2, 1 - level), fit.degrees_of_freedom
        chi2 = np.array([one, (one + two) / 2, two])
        if math.isfinite(dof):
            one, two = fdtri(1, dof, level), 2 * fdtri(2, dof, level)
        covariance, m = fit.parameter_covariance[3:, 3:], float(fit.parameters[2])
        variances, axes = np.linalg.eigh(covariance)
        known = fit.problem.known_phi
        may_be_circle = known is None or known.includes_circle
        fraction = of_prior = 0.0
        if known is not None and may_be_circle:
            fraction = min(float(np.trace(covariance)) / (2 * (known.deviator_std * m) ** 2), 1.0)
            of_prior = known.max_likelihood_ratio(level)
        semi_axes = 1 / np.sqrt(np.maximum(variances, TINY))
        return cls(
            level, chi2, float(one), float(two), m, fit.parameters[3:], semi_axes, axes, fraction,
            of_prior, may_be_circle,
        )  # fmt: skip

    @property
    def of_circle(self) -> float:
        """Critical ratio of phi = 0."""
        return self.two + self.prior_share * max(self.of_prior - self.two, 0.0)

    def leaves_theta_open(self, circle_ratio: float) -> bool:
        """Return whether a circle with this ratio is possible: theta's interval is then (0, pi)."""
        return self.may_be_circle and circle_ratio <= self.two

    def of_flattening(self, kappas: FloatArray) -> FloatArray:
        """Return c of phi for h / m (k,) and a true d in the direction of the estimate."""
        direction = self._in_sigmas(self.deviator)
        h = kappas * self.m
        near = h * abs(direction) < MAX_SIGMAS
        critical = np.full(len(h), self.one)
        if near.any():
            critical[near] = self._quantile(self._ring_tube(h[near], direction))
        return critical + self.prior_share * np.maximum(self.of_prior - critical, 0.0)

    def of_direction(self, deviator: FloatArray) -> float:
        """Return c of theta for a direction (2,) of d and a true d of the estimate's length."""
        from scipy.special import ndtr

        distance = math.hypot(*self.deviator) * abs(self._in_sigmas(deviator))
        if not distance < MAX_SIGMAS:
            return self.one
        # The tube is integrated across the half line; along it the normal integral is known.
        s = np.sqrt(self.chi2)[:, None]
        across, along = s * np.sin(ARC_ANGLES), s * np.cos(ARC_ANGLES)
        density = np.exp(-across * across / 2) / math.sqrt(2 * math.pi)
        tube = (density * ndtr(distance + along) * along) @ ARC_WEIGHTS
        return float(self._quantile(tube[None])[0])

    def _in_sigmas(self, direction: FloatArray) -> complex:
        """Return the unit vector of a direction (2,) in sigmas per mm, along the axes of the ring.

        The zero vector gives the first axis.
        """
        length = math.hypot(*direction)
        unit = direction @ self.axes / length if length > 0 else np.array([1.0, 0.0])
        return complex(*(self.semi_axes * unit).tolist())

    def _ring_tube(self, h: FloatArray, direction: complex) -> FloatArray:
        """Return the probability of tubes of half width sqrt(chi2) about rings of radius h, (k, 3).

        By Green's theorem the probability of a region is the integral of 1 - exp(-r^2 / 2) over the
        polar angle of its boundary about the true d, with r the distance. The boundaries are
        parallel curves of the ring, an ellipse. Where the inner one crosses the major axis the tube
        has no hole; the boundary is then put on the axis, where both sides cancel.
        """
        a, b = self.semi_axes
        count = np.clip(RING_POINTS_PER_SIGMA * a * h.max(), MIN_RING_POINTS, MAX_RING_POINTS)
        t = 2 * np.pi * (np.arange(int(count)) + 0.5) / int(count)
        cos, sin = np.cos(t), np.sin(t)
        size = np.hypot(b * cos, a * sin)
        normal = (b * cos + 1j * a * sin) / size
        s = (
            np.sqrt(np.concatenate([self.chi2, self.chi2]))[:, None]
            * np.repeat([1, -1], 3)[:, None]
        )
        h = h[:, None, None]
        curve = h * (a * cos + 1j * b * sin) + s * normal
        tangent = h * (-a * sin + 1j * b * cos) + s * (1j * a * b * normal / size**2)
        crossed = curve.imag * sin < 0
        curve.imag[crossed] = tangent.imag[crossed] = 0.0
        curve -= h * direction
        turn = (tangent / curve).imag
        outside = (turn * np.exp(-(curve.real**2 + curve.imag**2) / 2)).mean(axis=2)
        tube: FloatArray = 1 - outside[:, :3] + outside[:, 3:]
        return tube

    def _quantile(self, tube: FloatArray) -> FloatArray:
        """Return c from the probabilities (k, 3) of tubes of half widths sqrt(chi2).

        log(1 - probability) is linear in the squared width at a circle and nearly so elsewhere. The
        result is interpolated between `one` and `two`.
        """
        tail, wanted = np.log1p(-np.minimum(tube, 1 - 1e-15)), math.log1p(-self.level)
        quantile = np.zeros(len(tube))
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            weight = (wanted - tail[:, j]) * (wanted - tail[:, k])
            quantile += (
                self.chi2[i] * weight / (tail[:, i] - tail[:, j]) / (tail[:, i] - tail[:, k])
            )
        fraction = np.clip((quantile - self.chi2[0]) / (self.chi2[2] - self.chi2[0]), 0.0, 1.0)
        critical: FloatArray = (1 - fraction) * self.one + fraction * self.two
        return critical
