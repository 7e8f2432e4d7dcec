"""Critical likelihood ratios: how far F may rise above its minimum within an interval.

In the normal approximation of d = (p, q), whose length gives phi and whose direction gives theta,
the ratio of a phi is the squared distance, in sigmas, of the estimate from the ring of all d that
have it; for theta a half line from the circle d = 0 has the place of the ring. The quantile of that
distance is the half width of the tube about ring or half line that holds the estimate with a given
probability: at the circle that of chi^2 with two degrees of freedom, far from it with one.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from lsvision.ellipse.fit import EllipseFit
from lsvision.geometry import FloatArray

MAX_SIGMAS = 20.0
"""Distance from the circle, in sigmas, beyond which ring and half line count as straight lines."""
MIN_RING_POINTS, MAX_RING_POINTS, RING_POINTS_PER_SIGMA = 96, 512, 16
"""Points of the integral along the ring: as many for each sigma of its semi-major axis."""
ARC_ANGLES, ARC_WEIGHTS = (math.pi / 2 * rule for rule in np.polynomial.legendre.leggauss(16))
"""Gauss-Legendre rule over the half circle that ends the tube about a half line. Units: rad."""
TINY = 1e-300


@dataclass(frozen=True, eq=False, slots=True)
class CriticalRatios:
    """Critical ratios c of one fit and level.

    Parameters
    ----------
    level : float
        Probability.
    chi2 : (3,) ndarray
        Quantiles of chi^2 with one and two degrees of freedom, and their mean between them.
    one, two : float
        c of one quantity, and of both components of d: Student's where the noise was estimated.
    m : float
        Of the estimate. Units: mm.
    deviator : (2,) ndarray
        d of the estimate. Units: mm.
    semi_axes : (2,) ndarray
        The ring |d| = 1 mm in sigmas: an ellipse with these semi-axes, the larger first.
    axes : (2, 2) ndarray
        Their directions, in columns.
    prior_share, of_prior : float
        How much of what is known of d comes from a known phi that may be a circle, and c of that.
    may_be_circle : bool
        False where a known phi excludes it: such a prior is used only if the points tell theta.
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
        """Critical ratios of a fit at a level between 0 and 1."""
        from scipy.special import chdtri, fdtri

        one, two, freedom = chdtri(1, 1 - level), chdtri(2, 1 - level), fit.degrees_of_freedom
        chi2 = np.array([one, (one + two) / 2, two])
        if math.isfinite(freedom):
            one, two = fdtri(1, freedom, level), 2 * fdtri(2, freedom, level)
        covariance, m = fit.parameter_covariance[3:, 3:], float(fit.parameters[2])
        variances, axes = np.linalg.eigh(covariance)
        known = fit.problem.known_phi
        may_be_circle = known is None or known.includes_circle
        share = of_prior = 0.0
        if known is not None and may_be_circle:
            share = min(float(np.trace(covariance)) / (2 * (known.deviator_std * m) ** 2), 1.0)
            of_prior = known.max_likelihood_ratio(level)
        semi_axes = 1 / np.sqrt(np.maximum(variances, TINY))
        return cls(
            level, chi2, float(one), float(two), m, fit.parameters[3:], semi_axes, axes, share,
            of_prior, may_be_circle,
        )  # fmt: skip

    @property
    def of_circle(self) -> float:
        """C of phi = 0."""
        return self.two + self.prior_share * max(self.of_prior - self.two, 0.0)

    def leaves_theta_open(self, circle_ratio: float) -> bool:
        """Whether a circle of that ratio belongs to theta's interval, which then is (0, pi)."""
        return self.may_be_circle and circle_ratio <= self.two

    def of_flattening(self, kappas: FloatArray) -> FloatArray:
        """C of phi, by h / m (k,), for a true d in the direction of the estimate."""
        at = self._in_sigmas(self.deviator)
        h = kappas * self.m
        near = h * abs(at) < MAX_SIGMAS
        critical = np.full(len(h), self.one)
        if near.any():
            critical[near] = self._quantile(self._ring_tube(h[near], at))
        return critical + self.prior_share * np.maximum(self.of_prior - critical, 0.0)

    def of_direction(self, deviator: FloatArray) -> float:
        """C of theta, by a vector (2,) of its direction, for a true d of the estimate's length."""
        from scipy.special import ndtr

        distance = math.hypot(*self.deviator) * abs(self._in_sigmas(deviator))
        if not distance < MAX_SIGMAS:
            return self.one
        # Normal probability along the half line, to the end of the tube, integrated across.
        s = np.sqrt(self.chi2)[:, None]
        across, along = s * np.sin(ARC_ANGLES), s * np.cos(ARC_ANGLES)
        density = np.exp(-across * across / 2) / math.sqrt(2 * math.pi)
        tube = (density * ndtr(distance + along) * along) @ ARC_WEIGHTS
        return float(self._quantile(tube[None])[0])

    def _in_sigmas(self, direction: FloatArray) -> complex:
        """Unit vector of a direction (2,) in sigmas per mm, along the axes of the ring.

        Along its first axis where there is none.
        """
        length = math.hypot(*direction)
        unit = direction @ self.axes / length if length > 0 else np.array([1.0, 0.0])
        return complex(*(self.semi_axes * unit).tolist())

    def _ring_tube(self, h: FloatArray, at: complex) -> FloatArray:
        """Probability of the tubes of half width sqrt(chi2) about rings of radius h, (k, 3).

        By Green's theorem that of a region is an integral over the angle at which its boundary is
        seen from the true d, of 1 - exp(-r^2 / 2) with r the distance. The boundaries are curves
        parallel to the ring, an ellipse; where the inner one crosses the major axis, the tube has
        no hole, and it is led along the axis, where both sides cancel.
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
        curve -= h * at
        turn = (tangent / curve).imag
        seen = (turn * np.exp(-(curve.real**2 + curve.imag**2) / 2)).mean(axis=2)
        tube: FloatArray = 1 - seen[:, :3] + seen[:, 3:]
        return tube

    def _quantile(self, tube: FloatArray) -> FloatArray:
        """C, from the probabilities (k, 3) of tubes of half widths sqrt(chi2).

        log(1 - probability) is linear in the squared width at a circle and nearly so elsewhere. The
        result is never below that of one degree of freedom, and is Student's in proportion.
        """
        tail, wanted = np.log1p(-np.minimum(tube, 1 - 1e-15)), math.log1p(-self.level)
        quantile = np.zeros(len(tube))
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            weight = (wanted - tail[:, j]) * (wanted - tail[:, k])
            quantile += (
                self.chi2[i] * weight / (tail[:, i] - tail[:, j]) / (tail[:, i] - tail[:, k])
            )
        share = np.clip((quantile - self.chi2[0]) / (self.chi2[2] - self.chi2[0]), 0.0, 1.0)
        critical: FloatArray = (1 - share) * self.one + share * self.two
        return critical
