"""Measured section of a cylinder: its quantities with standard uncertainties and intervals."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from typing import get_args

import numpy as np

from lsvision.ellipse.fit_result import EllipseFit
from lsvision.ellipse.intervals import (
    SectionQuantity,
    are_thetas_determined,
    find_interval,
    find_intervals_of_fits,
    is_limit_of_radius,
    is_theta_determined,
)
from lsvision.ellipse.parameters import (
    axis_ratio_gradient,
    phi_std_from_ratio,
    semi_major_gradient,
    semi_minor_gradient,
)
from lsvision.ellipse.section_table import (
    SECTION_QUANTITIES,
    build_section_row,
    format_section_cells,
)
from lsvision.geometry import Ellipse, FloatArray, IntArray
from lsvision.geometry.ellipse import WithEllipse
from lsvision.profile import Arc
from lsvision.results.picture import draw_svg
from lsvision.results.quantities import (
    LEVEL,
    Estimate,
    Record,
    convert_numbers_to_json,
    replace_nonfinite,
)
from lsvision.results.result import Result
from lsvision.statistics.quantiles import squared_quantile

SECTIONS_AT_ONCE = 32
"""Number of sections whose intervals are computed together: more need more memory and are no
faster."""
SKEWED_RADIUS_SIGMAS = 20.0, 25.0
"""Ratios of the radius to its `local_radius_std` below which the skewness of the likelihood counts
fully, and above which it does not count. Short arcs determine 1 / b: at the first ratio the upper
half of the 95 % interval is longer by 2 / 20, 10 %."""
MIN_FLATTENING_MM = 1e-12
"""Smallest (a - b) / 2 as a divisor; the standard uncertainty of theta is then that of any
direction. Units: mm."""
UNIFORM_THETA_STD = math.pi / math.sqrt(12)
"""Standard deviation of an undetermined direction, uniform in [0, pi). Units: rad."""


@dataclass(frozen=True, eq=False, repr=False)
class CylinderSection(WithEllipse, Result):
    """Cylinder measured in one light section.

    Parameters
    ----------
    fit : EllipseFit
        Fitted ellipse with its covariance.
    arc : Arc
        Index span of the profile.
    indices : (k,) int ndarray
        Indices of the fitted points in the profile.

    Examples
    --------
    >>> import lsvision as lsv
    >>> section = lsv.simulate.random_section("single", 7, noise_mm=0.02)
    >>> (pipe,) = lsv.measure_cylinders(section.profile).cylinders
    >>> pipe  # doctest: +ELLIPSIS
    <CylinderSection: radius 36.9... mm, theta 40... deg, phi 3... deg, ..., ... points>
    >>> low, high = pipe.interval("radius")
    >>> low < pipe.radius < high
    True
    """

    fit: EllipseFit
    arc: Arc
    indices: IntArray

    @property
    def ellipse(self) -> Ellipse:
        """Fitted ellipse. Units: mm, rad."""
        return self.fit.ellipse

    @property
    def axis_candidates(self) -> FloatArray:
        """Both axis directions consistent with this section: (2, 3) unit vectors, section frame.

        cos(phi) n + sin(phi) m and cos(phi) n - sin(phi) m, with n the laser plane's normal and
        m the ellipse's major axis.
        """
        return self.ellipse.axis_twins

    @property
    def axis_twins(self) -> FloatArray:
        """Older name of `axis_candidates`."""
        return self.axis_candidates

    @property
    def covariance(self) -> FloatArray:
        """Covariance of centre_x, centre_y, semi_major, semi_minor, theta: (5, 5).

        Linear approximation; units mm and rad. Towards a circle the variance of theta grows
        without limit; `interval` is valid there, too.
        """
        parameters = self.fit.parameters
        by_axes = semi_major_gradient(parameters), semi_minor_gradient(parameters)
        jacobian = np.vstack([np.eye(2, 5), *by_axes, self._theta_gradient])
        return jacobian @ self.fit.parameter_covariance @ jacobian.T

    @property
    def radius_std(self) -> float:
        """Standard uncertainty of the radius. Units: mm.

        Definition: `local_radius_std`; where this exceeds a twentieth of the radius, at least the
        upper half of the 95 % interval divided by its quantile (1.96 for a given noise): there the
        likelihood is skewed, and the covariance of a fit that by chance came out small is too
        small. From a twenty-fifth to a twentieth, the weighted mean of both, without a step.
        """
        std, (skewed, symmetric) = self.local_radius_std, SKEWED_RADIUS_SIGMAS
        if self.fit.problem.known_radius is not None or self.radius > symmetric * std:
            return std
        _, high = self.interval("radius", LEVEL)
        if is_limit_of_radius(high, self.radius):
            return std
        square = squared_quantile(1, np.array([self.fit.degrees_of_freedom]), LEVEL)
        upper_std = (high - self.radius) / math.sqrt(square[0])
        weight = min((symmetric - self.radius / std) / (symmetric - skewed), 1.0)
        return max(std, weight * upper_std + (1 - weight) * std)

    @property
    def local_radius_std(self) -> float:
        """Standard uncertainty of the radius from the covariance at the estimate. Units: mm.

        Definition: rms change of b over the normal distribution of (m, p, q), by the cubature rule
        of third degree: the mean over both points at sqrt(3) standard deviations along each of its
        three principal axes (Arasaratnam and Haykin, Cubature Kalman filters, IEEE Transactions on
        Automatic Control 54, 2009). Far from a circle this is the linear approximation; near a
        circle, b = m - |(p, q)| has a kink, where the linear approximation is wrong. The points of
        the rule leave the curved surface of a known radius, whose own uncertainty is the upper
        limit.
        """
        covariance = self.fit.parameter_covariance[2:, 2:]
        variances, axes = np.linalg.eigh(covariance)
        steps = axes * np.sqrt(3 * np.maximum(variances, 0.0))
        shifted = self.fit.parameters[2:, None] + np.concatenate([steps, -steps], axis=1)
        radii = shifted[0] - np.hypot(shifted[1], shifted[2])
        std = math.sqrt(float(((radii - self.radius) ** 2).sum()) / 6)
        known = self.fit.problem.known_radius
        return std if known is None else min(std, known.effective_std)

    @property
    def theta_std(self) -> float:
        """Standard uncertainty of theta; at most that of a uniform direction. Units: rad."""
        return min(self._std(self._theta_gradient), UNIFORM_THETA_STD)

    @property
    def phi_std(self) -> float:
        """Standard uncertainty of phi, see `phi_std_from_ratio`. Units: rad."""
        return phi_std_from_ratio(self.phi, self._std(axis_ratio_gradient(self.fit.parameters)))

    @property
    def residual_correlation(self) -> float:
        """Autocorrelation time of the residuals in points; 1 for uncorrelated errors.

        Above 1 the residuals are not random: the sensor smooths along the line, or the form
        deviation of the surface exceeds the noise. The covariance and the intervals already
        include this factor.
        """
        return self.fit.correlation.autocorrelation_time

    @property
    def theta_determined(self) -> bool:
        """Whether a circle is excluded at 99.9 %, and an error of theta of 23 deg at 95 %."""
        return is_theta_determined(self.fit)

    def interval(self, quantity: SectionQuantity, level: float = 0.95) -> tuple[float, float]:
        """Return the interval that contains the true value with probability `level`.

        Parameters
        ----------
        quantity : {"radius", "theta", "phi", "centre_x", "centre_y"}
            Units: mm or rad.
        level : float
            Level of confidence, between 0 and 1.

        Returns
        -------
        low, high : float
            For theta both may lie outside [0, pi): the interval extends from low to high;
            (0, pi) means any direction.

        Raises
        ------
        ValueError
            If the quantity is unknown, or the level is not between 0 and 1.

        Examples
        --------
        >>> import lsvision as lsv
        >>> section = lsv.simulate.random_section("single", 7, noise_mm=0.02)
        >>> (pipe,) = lsv.measure_cylinders(section.profile).cylinders
        >>> low, high = pipe.interval("phi", level=0.99)
        >>> 0 < low < pipe.phi < high
        True
        """
        return find_interval(self.fit, quantity, level)

    @cached_property
    def estimates(self) -> tuple[Estimate, ...]:
        """Quantities of tables and files in mm and deg, with uncertainties and 95 % intervals."""
        return tuple(
            replace(each, interval=each.quantity.convert_to_unit(self.interval(name, LEVEL)))
            for each, name in zip(self._values, get_args(SectionQuantity), strict=True)
        )

    @property
    def _values(self) -> tuple[Estimate, ...]:
        """The `estimates` without intervals, whose computation takes some ms."""
        x_std, y_std = np.sqrt(self.fit.parameter_covariance.diagonal()[:2]).tolist()
        values = (self.radius, self.theta, self.phi, *self.centre)
        stds = (self.radius_std, self.theta_std, self.phi_std, x_std, y_std)
        known = (True, self.theta_determined, True, True, True)
        return tuple(map(Estimate.of, SECTION_QUANTITIES, values, stds, known))

    def to_dict(self) -> Record:
        """Return the section as plain numbers, ready for JSON.

        Returns
        -------
        dict
            Values, ``*_std_*`` and ``*_interval_95_*`` in mm and deg, ``theta_determined``, both
            semi-axes, ``axis_twins`` and ``indices``.

        Examples
        --------
        >>> import lsvision as lsv
        >>> section = lsv.simulate.random_section("single", 7, noise_mm=0.02)
        >>> (pipe,) = lsv.measure_cylinders(section.profile).cylinders
        >>> pipe.to_dict()["radius_mm"] == pipe.radius
        True
        """
        record: Record = {}
        for estimate in self.estimates:
            record |= estimate.record
        record["theta_determined"] = bool(self.theta_determined)
        record["semi_major_mm"] = replace_nonfinite(self.ellipse.semi_major)
        record["semi_minor_mm"] = replace_nonfinite(self.ellipse.semi_minor)
        record["axis_twins"] = [convert_numbers_to_json(axis) for axis in self.axis_candidates]
        record["indices"] = [int(index) for index in self.indices]
        return record

    def _summarise(self) -> str:
        words = [
            f"{each.quantity.name.replace('_', ' ')} {each.text}"
            + (f" {each.quantity.unit}" if each.determined else "")
            for each in self._values
        ]
        return ", ".join([*words, f"{len(self.indices)} points"])

    def _list_cells(self) -> list[tuple[str, ...]]:
        return format_section_cells([self])

    def _list_rows(self) -> list[Record]:
        return [build_section_row(self.to_dict())]

    def _draw_picture(self) -> str:
        points = self.fit.problem.points
        return draw_svg(points, [(points, self.ellipse)], "a section of a cylinder")

    @property
    def _theta_gradient(self) -> FloatArray:
        """Derivative of theta by the parameters of the fit, (5,). Units: rad/mm."""
        p, q = (float(value) for value in self.fit.parameters[3:])
        h = max(math.hypot(p, q), MIN_FLATTENING_MM)
        across = (-q / h, p / h) if p or q else (0.0, 1.0)
        return np.array([0.0, 0.0, 0.0, *across]) / (2 * h)

    def _std(self, gradient: FloatArray) -> float:
        """Return the standard uncertainty of a quantity from its gradient by the parameters."""
        variance = float(gradient @ self.fit.parameter_covariance @ gradient)
        return math.sqrt(max(variance, 0.0))  # of an exactly known value rounding may make it < 0


def precompute_intervals(sections: Iterable[CylinderSection], level: float = LEVEL) -> None:
    """Compute the intervals of many sections at once, about three times as fast as one by one.

    Each section keeps its intervals, which all its results and tables use.

    Parameters
    ----------
    sections : iterable of CylinderSection
        Sections, computed `SECTIONS_AT_ONCE` at a time.
    level : float
        Level of confidence, between 0 and 1.
    """
    fits = iter([section.fit for section in sections])
    while group := list(islice(fits, SECTIONS_AT_ONCE)):
        find_intervals_of_fits(group, level)
        are_thetas_determined(group)
