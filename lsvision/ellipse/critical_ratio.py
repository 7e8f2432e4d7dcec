"""Critical likelihood ratios c: the largest F - min F of values within an interval.

F is the cost of `lsvision.ellipse.cost_expansion`; m, p, q and d are those of
`lsvision.ellipse.parameters`.

The vector d = (p, q) is taken to be normally distributed. Its length determines phi, its direction
theta: all d of one phi form a ring about the circle d = 0, all d of one theta a half line from it.
The ratio of a phi or theta is the squared distance, in sigmas, of the estimate from ring or half
line. Its quantile is the squared half width of the tube about them that contains the estimate with
a given probability: near the circle that of chi^2 with two degrees of freedom, else with one.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np

from lsvision.ellipse.fit_stack import FitStack
from lsvision.ellipse.parameters import deviators_from_parameters
from lsvision.geometry import BoolArray, FloatArray, IntArray
from lsvision.geometry.arrays import TINY
from lsvision.geometry.noisy_points import ComplexArray
from lsvision.statistics.quantiles import normal_probability, squared_quantile

MAX_SIGMAS, MAX_CURVATURE_RADIUS = 20.0, 1.2
"""Distance of the true d from the circle and smallest radius of curvature of the ring, in sigmas,
beyond which c is that of a straight line, within 1 %."""
MIN_RING_POINTS, MAX_RING_POINTS, RING_POINTS_PER_SIGMA, RING_POINTS_PER_RATIO = 32, 512, 6, 8
"""Number of points of the integral along the ring: smallest and largest number, number per sigma of
the larger semi-axis, and number per unit of the ring's axis ratio. c is exact to 3e-4 up to an axis
ratio of 8."""
END_SIGMAS = np.linspace(0.0, 6.0, 61)
"""Distances of the true d from the end of the half line for which c is tabulated, in sigmas; at the
last it is that of a straight line."""
ARC_ANGLES, ARC_WEIGHTS = (math.pi / 2 * rule for rule in np.polynomial.legendre.leggauss(16))
"""Gauss-Legendre rule over the half circle that ends the tube about a half line. Units: rad."""
CACHED_LEVELS = 16
"""Number of levels whose quantiles and table for theta are cached."""


@dataclass(frozen=True, eq=False, slots=True)
class CriticalRatios:
    """Critical ratios c of s fits at one level.

    Parameters
    ----------
    level : float
        Level of confidence.
    one_dof, two_dof : (s,) ndarray
        c of one quantity, and of both components of d together: quantiles of chi^2, or of the F
        distribution where the noise was estimated.
    m : (s,) ndarray
        m of the estimates. Units: mm.
    lengths : (s,) ndarray
        |d| of the estimates. Units: mm.
    directions : (s,) complex ndarray
        Unit vectors of these d, in sigmas per mm along the axes of the ring.
    semi_axes : (2, s) ndarray
        Semi-axes in sigmas of the ring |d| = 1 mm, the larger first.
    axes : (s,) complex ndarray
        Directions of the larger semi-axis.
    straight_radii : (s,) ndarray
        Radius of the ring from which on it is treated as a straight line. Units: mm.
    prior_fractions, prior_ratios : (s,) ndarray
        Fraction of the information on d that comes from a prior on phi that includes a circle, and
        c of this prior alone.
    may_be_circle : (s,) bool ndarray
        Whether the section may be a circle: false if a prior on phi excludes it.
    """

    level: float
    one_dof: FloatArray
    two_dof: FloatArray
    m: FloatArray
    lengths: FloatArray
    directions: ComplexArray
    semi_axes: FloatArray
    axes: ComplexArray
    straight_radii: FloatArray
    prior_fractions: FloatArray
    prior_ratios: FloatArray
    may_be_circle: BoolArray

    @classmethod
    def of(cls, stack: FitStack, level: float) -> Self:
        """Return the critical ratios of fits at a level between 0 and 1."""
        one, two = (squared_quantile(k, stack.degrees_of_freedom, level) for k in (1, 2))
        variances, vectors = np.linalg.eigh(stack.covariances[:, 3:, 3:])
        axes = vectors[:, 0, 0] + 1j * vectors[:, 1, 0]
        a, b = semi_axes = 1 / np.sqrt(np.maximum(variances.T, TINY))
        m, deviators = stack.parameters[:, 2], deviators_from_parameters(stack.parameters)
        directions = _in_sigmas(deviators, semi_axes, axes)
        straight_radii = np.minimum(
            MAX_CURVATURE_RADIUS * a / b**2, MAX_SIGMAS / np.abs(directions)
        )
        fractions, prior_ratios = np.zeros((2, len(m)))
        for k in np.flatnonzero(stack.has_prior & stack.may_be_circle):
            known = stack.fits[k].problem.known_phi
            if known is not None:
                fraction = variances[k].sum() / (2 * (known.deviator_std * m[k]) ** 2)
                fractions[k] = min(fraction, 1.0)
                prior_ratios[k] = known.max_likelihood_ratio(level)
        return cls(
            level, one, two, m, np.abs(deviators), directions, semi_axes, axes, straight_radii,
            fractions, prior_ratios, stack.may_be_circle,
        )  # fmt: skip

    @property
    def ratios_for_circle(self) -> FloatArray:
        """Critical ratios of phi = 0, (s,)."""
        return self.two_dof + self.prior_fractions * np.maximum(
            self.prior_ratios - self.two_dof, 0.0
        )

    def allows_any_theta(self, circle_ratios: FloatArray) -> BoolArray:
        """Return whether circles with these ratios (s,) are possible: then any theta is, too."""
        return self.may_be_circle & (circle_ratios <= self.two_dof)

    def ratios_for_flattening(self, owners: IntArray, kappas: FloatArray) -> FloatArray:
        """Return c of phi for values of h / m and a true d in the direction of the estimate.

        Parameters
        ----------
        owners : (k,) int ndarray
            Number of the fit of each value.
        kappas : (k,) ndarray
            Values of h / m.

        Returns
        -------
        (k,) ndarray
        """
        h, ratios = self.m[owners] * kappas, self.one_dof[owners]
        near = h < self.straight_radii[owners]
        if near.any():
            counts = np.where(near, self._ring_points(owners, h), 0)
            for count in np.unique(counts[near]).tolist():
                i = counts == count
                tubes = self._ring_tubes(owners[i], h[i], count)
                ratios[i] = self._interpolate(
                    owners[i], _interpolation_fractions(self.level, tubes)
                )
        more = np.maximum(self.prior_ratios[owners] - ratios, 0.0)
        return ratios + self.prior_fractions[owners] * more

    def ratios_for_direction(self, owners: IntArray, deviators: ComplexArray) -> FloatArray:
        """Return c of theta for a true d of the estimate's length in a direction.

        Parameters
        ----------
        owners : (k,) int ndarray
            Number of the fit of each direction.
        deviators : (k,) complex ndarray
            Vectors p + iq, of which only the direction counts.

        Returns
        -------
        (k,) ndarray
        """
        in_sigmas = _in_sigmas(deviators, self.semi_axes[:, owners], self.axes[owners])
        distances = self.lengths[owners] * np.abs(in_sigmas)
        fractions = np.interp(distances, END_SIGMAS, _half_line_fractions(self.level))
        return self._interpolate(owners, fractions)

    def _interpolate(self, owners: IntArray, fractions: FloatArray) -> FloatArray:
        """Return c between `one_dof` (fraction 0) and `two_dof` (fraction 1), (k,)."""
        return (1 - fractions) * self.one_dof[owners] + fractions * self.two_dof[owners]

    def _ring_points(self, owners: IntArray, h: FloatArray) -> IntArray:
        """Return the number of points of the integral along each ring: powers of two."""
        a, b = self.semi_axes[:, owners]
        count = np.maximum(RING_POINTS_PER_SIGMA * a * h, RING_POINTS_PER_RATIO * a / b)
        count = np.clip(count, MIN_RING_POINTS, MAX_RING_POINTS)
        points: IntArray = np.exp2(np.ceil(np.log2(count))).astype(int)
        return points

    def _ring_tubes(self, owners: IntArray, h: FloatArray, count: int) -> FloatArray:
        """Return probabilities of tubes of half width sqrt(chi2) about rings of radius h, (k, 3).

        By Green's theorem the probability of a region is the integral of 1 - exp(-r^2 / 2) over the
        polar angle of its boundary about the true d, with r the distance. The boundaries are
        parallel curves of the ring, an ellipse. Where the inner one crosses the major axis the tube
        has no hole; the boundary is then put on the axis, where both sides cancel.
        """
        a, b = self.semi_axes[:, owners, None]
        directions = self.directions[owners]
        widths = np.sqrt(_chi2_quantiles(self.level))
        t = np.arange(count) * (2 * np.pi / count)
        b_cos, a_sin = b * np.cos(t), a * np.sin(t)
        size = np.hypot(b_cos, a_sin)
        s, h = np.concatenate([widths, -widths])[:, None], h[:, None, None]
        height = h * b[:, None] + s * (a / size)[:, None]
        is_beside_axis = height > 0
        x = np.cos(t) * (h * a[:, None] + s * (b / size)[:, None])
        x -= h * directions.real[:, None, None]
        y = np.sin(t) * height * is_beside_axis - h * directions.imag[:, None, None]
        speed = h + s * (a * b / size**3)[:, None]
        squared = x * x + y * y
        turn = speed * (b_cos[:, None] * is_beside_axis * x + a_sin[:, None] * y) / squared
        outside = (turn * np.exp(-squared / 2)).sum(axis=2) / count
        # The true d is within the outer boundary (first three widths), not within the inner one.
        tubes: FloatArray = 1 - outside[:, :3] + outside[:, 3:]
        return tubes


@lru_cache(maxsize=CACHED_LEVELS)
def _chi2_quantiles(level: float) -> FloatArray:
    """Return the quantiles for one and two degrees of freedom, their mean between them, (3,)."""
    (one,), (two,) = (squared_quantile(k, np.array([math.inf]), level) for k in (1, 2))
    return np.array([one, (one + two) / 2, two])


@lru_cache(maxsize=CACHED_LEVELS)
def _half_line_fractions(level: float) -> FloatArray:
    """Return the fractions (61,) for a half line with a true d at `END_SIGMAS` from its end."""
    # The tube is integrated across the half line; along it the normal integral is known.
    s = np.sqrt(_chi2_quantiles(level))[:, None]
    across, along = s * np.sin(ARC_ANGLES), s * np.cos(ARC_ANGLES)
    density = np.exp(-across * across / 2) / math.sqrt(2 * math.pi)
    tubes = (density * normal_probability(END_SIGMAS[:, None, None] + along) * along) @ ARC_WEIGHTS
    return _interpolation_fractions(level, tubes)


def _interpolation_fractions(level: float, tubes: FloatArray) -> FloatArray:
    """Return where c lies between `one_dof` (0) and `two_dof` (1), (k,).

    It is interpolated between the probabilities (k, 3) of tubes whose squared half widths are
    `_chi2_quantiles`: log(1 - probability) is linear in the squared width at a circle and nearly so
    elsewhere.
    """
    tails, target = np.log1p(-np.minimum(tubes, 1 - 1e-15)).T, math.log1p(-level)
    positions = np.zeros(len(tubes))
    # Lagrange's formula for the positions -1, 0 and 1, the second of which has no term.
    for i, j, k, position in ((0, 1, 2, -1.0), (2, 0, 1, 1.0)):
        weights = (target - tails[j]) * (target - tails[k])
        products = (tails[i] - tails[j]) * (tails[i] - tails[k])
        positions += position * weights / np.where(products == 0, TINY, products)
    return np.minimum(np.maximum((positions + 1) / 2, 0.0), 1.0)


def _in_sigmas(deviators: ComplexArray, semi_axes: FloatArray, axes: ComplexArray) -> ComplexArray:
    """Return the unit vectors of directions in sigmas per mm, along the axes of the rings.

    The zero vector gives the first axis.
    """
    lengths = np.abs(deviators)
    units = deviators / np.maximum(lengths, TINY) * axes.conj()
    units[lengths == 0] = 1.0
    a, b = semi_axes
    in_sigmas: ComplexArray = a * units.real + 1j * (b * units.imag)
    return in_sigmas
