"""Critical values c of the likelihood ratio F - min F, up to which values are in an interval.

F is the cost of `lsvision.ellipse.cost_expansion`, -2 log likelihood up to a constant; m, h and
d = (p, q) are those of `lsvision.ellipse.parameters`.

The estimate of d is taken to be normally distributed about the true d. All d of one phi form a ring
|d| = h about the circle d = 0, all d of one theta a half line from it. In whitened coordinates,
which are standard deviations along the principal axes of the covariance of d, the ring is an
ellipse, and F - min F of a phi or theta is the squared distance of the estimate from ring or half
line. That is below c if the estimate lies in a tube of half width sqrt(c) about them. So c is the
squared half width of the tube that has the probability `level` (Neyman's construction; see
`lsvision.ellipse.intervals.find_intervals` for a reference). Wilks' theorem has a straight line
instead: c is then the quantile of chi^2 with one degree of freedom. At the circle, where the ring
is a point, it is that with two; near it c lies between them.
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

MIN_STRAIGHT_RING_SIGMAS, MIN_STRAIGHT_CURVATURE_RADIUS_SIGMAS = 20.0, 1.2
"""Distance of the true d from the circle, and smallest radius of curvature of the ring, in sigmas,
beyond which the ring counts as a straight line. A curved tube gains as much probability on its
inner side as it loses on its outer one, to first order in the curvature. So c, which is never below
that of a straight line, is then at most 1 % above it."""
MIN_RING_POINTS, MAX_RING_POINTS, RING_POINTS_PER_SIGMA, RING_POINTS_PER_RATIO = 32, 512, 6, 8
"""Number of points of the integral along the ring: smallest and largest number, number per sigma of
the larger semi-axis, and number per unit of the ring's axis ratio. With them, c has a relative
error of 3e-4 up to an axis ratio of 8."""
END_SIGMAS = np.linspace(0.0, 6.0, 61)
"""Distances of the true d from the end of the half line for which c is tabulated, in sigmas; at the
last it is that of a straight line."""
ARC_ANGLES, ARC_WEIGHTS = (math.pi / 2 * rule for rule in np.polynomial.legendre.leggauss(16))
"""Gauss-Legendre rule over the half circle that ends the tube about a half line: angles from the
direction of the half line, from -pi/2 to pi/2, and their weights. Units: rad."""
NO_CIRCLE_LEVEL = 0.999
"""Level of confidence at which a circle is excluded for theta to be determined."""
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
    no_circle : (s,) ndarray
        c of the best circle above which a circle is excluded at `NO_CIRCLE_LEVEL`.
    m : (s,) ndarray
        m of the estimates. Units: mm.
    estimated_h : (s,) ndarray
        |d| of the estimates. Units: mm.
    whitened_directions : (s,) complex ndarray
        Unit vectors d / |d| of the estimates in whitened coordinates. Units: 1/mm.
    principal_axes : (s,) complex ndarray
        Unit vectors in the (p, q) plane along which the variance of d is smallest.
    semi_axes : (2, s) ndarray
        Semi-axes of the ring |d| = 1 mm in whitened coordinates, the larger first: 1 over the
        standard deviations of d along its principal axes. Units: 1/mm.
    min_straight_h : (s,) ndarray
        |d| from which on the ring counts as a straight line. Units: mm.
    prior_fractions, prior_ratios : (s,) ndarray
        Fraction of the information on d that comes from a prior on phi that includes a circle, and
        c of this prior alone.
    may_be_circle : (s,) bool ndarray
        Whether the section may be a circle: false if a prior on phi excludes it.
    """

    level: float
    one_dof: FloatArray
    two_dof: FloatArray
    no_circle: FloatArray
    m: FloatArray
    estimated_h: FloatArray
    whitened_directions: ComplexArray
    principal_axes: ComplexArray
    semi_axes: FloatArray
    min_straight_h: FloatArray
    prior_fractions: FloatArray
    prior_ratios: FloatArray
    may_be_circle: BoolArray

    @classmethod
    def of(cls, stack: FitStack, level: float) -> Self:
        """Return the critical ratios of fits at a level between 0 and 1."""
        one, two = (squared_quantile(k, stack.degrees_of_freedom, level) for k in (1, 2))
        no_circle = squared_quantile(2, stack.degrees_of_freedom, NO_CIRCLE_LEVEL)
        variances, vectors = np.linalg.eigh(stack.covariances[:, 3:, 3:])  # ascending variances
        principal_axes = vectors[:, 0, 0] + 1j * vectors[:, 1, 0]
        a, b = semi_axes = 1 / np.sqrt(np.maximum(variances.T, TINY))
        m, deviators = stack.parameters[:, 2], deviators_from_parameters(stack.parameters)
        whitened = _whiten_directions(deviators, semi_axes, principal_axes)
        # The smallest radius of curvature of an ellipse with semi-axes a h and b h is h b^2 / a.
        min_straight_h = np.minimum(
            MIN_STRAIGHT_CURVATURE_RADIUS_SIGMAS * a / b**2,
            MIN_STRAIGHT_RING_SIGMAS / np.abs(whitened),
        )
        fractions, prior_ratios = _evaluate_phi_priors_about_circles(stack, variances, level)
        return cls(
            level, one, two, no_circle, m, np.abs(deviators), whitened, principal_axes, semi_axes,
            min_straight_h, fractions, prior_ratios, stack.may_be_circle,
        )  # fmt: skip

    @property
    def for_circle(self) -> FloatArray:
        """Critical ratios of phi = 0, (s,)."""
        return self._raise_to_priors(self.two_dof, slice(None))

    def allows_any_theta(self, circle_ratios: FloatArray) -> BoolArray:
        """Return whether circles are possible: then any theta is, too.

        `circle_ratios` (s,) are F of the best circle less min F.
        """
        return self.may_be_circle & (circle_ratios <= self.two_dof)

    def compute_for_flattening(self, fit_indices: IntArray, flattenings: FloatArray) -> FloatArray:
        """Return c of phi for values of h / m and a true d in the direction of the estimate.

        Parameters
        ----------
        fit_indices : (k,) int ndarray
            Index of the fit of each value.
        flattenings : (k,) ndarray
            Values of h / m.

        Returns
        -------
        (k,) ndarray
        """
        h, ratios = self.m[fit_indices] * flattenings, self.one_dof[fit_indices]
        is_curved = h < self.min_straight_h[fit_indices]
        if is_curved.any():
            counts = np.where(is_curved, self._choose_ring_point_counts(fit_indices, h), 0)
            for count in np.unique(counts[is_curved]).tolist():
                i = counts == count
                probabilities = self._integrate_ring_tube_probabilities(fit_indices[i], h[i], count)
                ratios[i] = self._interpolate(
                    fit_indices[i], _compute_interpolation_fractions(self.level, probabilities)
                )
        return self._raise_to_priors(ratios, fit_indices)

    def compute_for_direction(self, fit_indices: IntArray, deviators: ComplexArray) -> FloatArray:
        """Return c of theta for a true d of the estimate's length in a direction.

        Parameters
        ----------
        fit_indices : (k,) int ndarray
            Index of the fit of each direction.
        deviators : (k,) complex ndarray
            Vectors p + iq, of which only the direction counts.

        Returns
        -------
        (k,) ndarray
        """
        semi_axes, principal_axes = self.semi_axes[:, fit_indices], self.principal_axes[fit_indices]
        whitened = _whiten_directions(deviators, semi_axes, principal_axes)
        sigmas_from_circle = self.estimated_h[fit_indices] * np.abs(whitened)
        fractions = np.interp(
            sigmas_from_circle, END_SIGMAS, _integrate_half_line_fractions(self.level)
        )
        return self._interpolate(fit_indices, fractions)

    def _raise_to_priors(self, ratios: FloatArray, fit_indices: IntArray | slice) -> FloatArray:
        """Return c of phi (k,), nearer to c of the prior the more of the information is from it.

        By the prior, phi is the modulus of a normal variable, and d is quadratic in phi: with the
        prior alone F - min F has larger quantiles than for the normal d of `ratios`.
        """
        increase = np.maximum(self.prior_ratios[fit_indices] - ratios, 0.0)
        return ratios + self.prior_fractions[fit_indices] * increase

    def _interpolate(self, fit_indices: IntArray, fractions: FloatArray) -> FloatArray:
        """Return c between `one_dof` (fraction 0) and `two_dof` (fraction 1), (k,).

        The fractions are computed for known noise; with estimated noise, c of phi and theta is
        taken to lie at the same fraction between the quantiles of the F distribution.
        """
        return (1 - fractions) * self.one_dof[fit_indices] + fractions * self.two_dof[fit_indices]

    def _choose_ring_point_counts(self, fit_indices: IntArray, h: FloatArray) -> IntArray:
        """Return the number of points of the integral along each ring |d| = h, a power of two.

        Rings with the same number are integrated together: there should be few different ones.
        """
        a, b = self.semi_axes[:, fit_indices]
        count = np.maximum(RING_POINTS_PER_SIGMA * a * h, RING_POINTS_PER_RATIO * a / b)
        count = np.clip(count, MIN_RING_POINTS, MAX_RING_POINTS)
        points: IntArray = np.exp2(np.ceil(np.log2(count))).astype(int)
        return points

    def _integrate_ring_tube_probabilities(
        self, fit_indices: IntArray, h: FloatArray, count: int
    ) -> FloatArray:
        """Return the probabilities (k, 3) of tubes about rings |d| = h, (k,).

        The squared half widths of the tubes are `_chi2_quantiles`; the true d lies on the ring, in
        the direction of the estimate. In polar coordinates (r, v) about the true d, the density of
        the estimate is exp(-r^2 / 2) / 2 pi, and its integral over r is in closed form. What
        remains is an integral along the boundary of the tube. The estimate lies outside of a
        closed curve about the true d with the probability

            1 / 2 pi  integral exp(-r^2 / 2) dv,

        and within a curve that does not enclose the true d with minus this integral. The tube is
        the region within its outer boundary without that within its inner one.
        """
        a, b = self.semi_axes[:, fit_indices, None]
        widths = np.sqrt(_chi2_quantiles(self.level))
        both_sides = np.concatenate([widths, -widths])[:, None]
        x, y, speed, normal_x, normal_y = _compute_parallel_curves(
            a, b, h[:, None, None], both_sides, count
        )
        true_d = h[:, None, None] * self.whitened_directions[fit_indices, None, None]
        x -= true_d.real
        y -= true_d.imag
        squared = x * x + y * y
        # (x y' - y x') / r^2, with the derivative speed (-normal_y, normal_x) of (x, y).
        dv = speed * (normal_x * x + normal_y * y) / squared
        integrals = (dv * np.exp(-squared / 2)).sum(axis=2) / count
        outer, inner = integrals[:, :3], integrals[:, 3:]
        probabilities: FloatArray = 1 - outer + inner
        return probabilities


def _evaluate_phi_priors_about_circles(
    stack: FitStack, variances: FloatArray, level: float
) -> tuple[FloatArray, FloatArray]:
    """Return `prior_fractions` and `prior_ratios` of `CriticalRatios`, (s,) each.

    `variances` (s, 2) are those of d along its principal axes; 0 for fits without such a prior.
    """
    fractions, ratios = np.zeros((2, len(stack.fits)))
    for k in np.flatnonzero(stack.has_prior & stack.may_be_circle):
        known = stack.fits[k].problem.known_phi
        if known is not None:
            # Information is 1 over variance: the mean variance of d over that of the prior.
            prior_std = known.deviator_std * stack.parameters[k, 2]
            fractions[k] = min(variances[k].sum() / (2 * prior_std**2), 1.0)
            ratios[k] = known.compute_critical_ratio(level)
    return fractions, ratios


def _compute_parallel_curves(
    a: FloatArray, b: FloatArray, h: FloatArray, distances: FloatArray, count: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return points of curves parallel to ellipses with semi-axes a h and b h, b <= a.

    A point is h (a cos t, b sin t) + s N / |N|, with the signed distance s and the outward normal
    N = (b cos t, a sin t). The curvature of the ellipse is a b / (h |N|^3), so that the derivative
    of the point by t is (h + s a b / |N|^3) (-a sin t, b cos t).

    An inner curve beyond the centre of curvature crosses the major axis. Its points on the wrong
    side are put on the axis, where those of both halves of the ellipse cancel in an integral along
    the curve: what is left encloses the points that are further than s from the ellipse.

    Parameters
    ----------
    a, b : (k, 1) ndarray
        Semi-axes of the ellipses for h = 1.
    h : (k, 1, 1) ndarray
        Factors of the semi-axes.
    distances : (j, 1) ndarray
        Distances s from the ellipses, negative inside.
    count : int
        Number of points of each curve, at equal steps of t.

    Returns
    -------
    x, y : (k, j, count) ndarray
        Points.
    speed, normal_x, normal_y : (k, j, count) or (k, 1, count) ndarray
        Factor of their derivatives by t, speed (-normal_y, normal_x); normal_x is 0 on the axis.
    """
    t = np.arange(count) * (2 * np.pi / count)
    b_cos, a_sin = b * np.cos(t), a * np.sin(t)
    size = np.hypot(b_cos, a_sin)
    x = np.cos(t) * (h * a[:, None] + distances * (b / size)[:, None])
    height = h * b[:, None] + distances * (a / size)[:, None]
    is_beside_axis = height > 0
    y = np.sin(t) * height * is_beside_axis
    speed = h + distances * (a * b / size**3)[:, None]
    return x, y, speed, b_cos[:, None] * is_beside_axis, a_sin[:, None]


@lru_cache(maxsize=CACHED_LEVELS)
def _chi2_quantiles(level: float) -> FloatArray:
    """Return the quantiles for one and two degrees of freedom, their mean between them, (3,)."""
    (one,), (two,) = (squared_quantile(k, np.array([math.inf]), level) for k in (1, 2))
    return np.array([one, (one + two) / 2, two])


@lru_cache(maxsize=CACHED_LEVELS)
def _integrate_half_line_fractions(level: float) -> FloatArray:
    """Return the fractions (61,) for a half line with a true d at `END_SIGMAS` from its end.

    The tube of half width s is the strip |y| <= s, with the half line along x and the true d at the
    origin; it ends in a half circle, at x = -END_SIGMAS - sqrt(s^2 - y^2). Its probability is the
    integral over y of the normal density times the normal probability of x beyond this end. With
    y = s sin(v), the root is s cos(v) and dy = s cos(v) dv.
    """
    s = np.sqrt(_chi2_quantiles(level))[:, None]
    y, s_cos = s * np.sin(ARC_ANGLES), s * np.cos(ARC_ANGLES)
    density = np.exp(-y * y / 2) / math.sqrt(2 * math.pi)
    beyond_end = normal_probability(END_SIGMAS[:, None, None] + s_cos)
    return _compute_interpolation_fractions(level, (density * beyond_end * s_cos) @ ARC_WEIGHTS)


def _compute_interpolation_fractions(level: float, probabilities: FloatArray) -> FloatArray:
    """Return where c lies between `one_dof` (0) and `two_dof` (1), (k,).

    `probabilities` (k, 3) are those of tubes whose squared half widths are `_chi2_quantiles`; at c
    it is `level`. The squared width is interpolated over log(1 - probability), in which it is
    linear at a circle (there 1 - probability = exp(-squared width / 2)) and nearly so elsewhere.
    """
    logs, target = np.log1p(-np.minimum(probabilities, 1 - 1e-15)).T, math.log1p(-level)
    positions = np.zeros(len(probabilities))
    # Lagrange's formula for the positions -1, 0 and 1, the second of which has no term.
    for i, j, k, position in ((0, 1, 2, -1.0), (2, 0, 1, 1.0)):
        numerators = (target - logs[j]) * (target - logs[k])
        denominators = (logs[i] - logs[j]) * (logs[i] - logs[k])
        positions += position * numerators / np.where(denominators == 0, TINY, denominators)
    return np.minimum(np.maximum((positions + 1) / 2, 0.0), 1.0)


def _whiten_directions(
    deviators: ComplexArray, semi_axes: FloatArray, principal_axes: ComplexArray
) -> ComplexArray:
    """Return unit vectors d / |d| in whitened coordinates, (k,); those of d = 0 are principal axes.

    Their lengths are 1 over the standard deviation of d along them. Units: 1/mm.
    """
    lengths = np.abs(deviators)
    units = deviators / np.maximum(lengths, TINY) * principal_axes.conj()
    units[lengths == 0] = 1.0
    a, b = semi_axes
    whitened: ComplexArray = a * units.real + 1j * (b * units.imag)
    return whitened
