"""One measured section of a cylinder: the numbers a user asks for, each with its sigma."""

import math
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from lsvision.ellipse.fit import EllipseFit
from lsvision.ellipse.intervals import Quantity, interval, theta_is_determined
from lsvision.ellipse.parameters import semi_major_gradient, semi_minor_gradient
from lsvision.ellipse.section_table import SECTION_QUANTITIES, section_cells, section_row
from lsvision.geometry import Ellipse, FloatArray, IntArray
from lsvision.profile import Arc
from lsvision.results.picture import draw_svg
from lsvision.results.quantities import LEVEL, Estimate, Record, finite, numbers
from lsvision.results.result import Result

THETA_UNKNOWN_STD = math.pi / math.sqrt(12)
"""Standard deviation of a direction of which nothing is known, uniform in [0, pi). Units: rad."""


@dataclass(frozen=True, eq=False, repr=False)
class CylinderSection(Result):
    """A cylinder as one light section sees it.

    Parameters
    ----------
    fit : EllipseFit
        The ellipse with its evidence.
    arc : Arc
        The span of the profile.
    indices : (k,) int ndarray
        The points of the profile it rests on.

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
        """The section. Units: mm, rad."""
        return self.fit.ellipse

    @property
    def radius(self) -> float:
        """Definition: b. Units: mm."""
        return self.ellipse.radius

    @property
    def theta(self) -> float:
        """Direction of the major axis. Units: rad, in [0, pi)."""
        return self.ellipse.theta

    @property
    def phi(self) -> float:
        """Angle between axis and laser plane's normal, arccos(b / a). Units: rad."""
        return self.ellipse.phi

    @property
    def centre(self) -> tuple[float, float]:
        """Section frame. Units: mm."""
        return self.ellipse.centre

    @property
    def axis_candidates(self) -> FloatArray:
        """Both axes that this one section allows: (2, 3) unit vectors, section frame.

        cos(phi) n + sin(phi) m and cos(phi) n - sin(phi) m, with n the laser plane's normal and
        m the ellipse's major axis.
        """
        return self.ellipse.axis_twins

    @property
    def axis_twins(self) -> FloatArray:
        """The same as `axis_candidates`, by its older name."""
        return self.axis_candidates

    @property
    def covariance(self) -> FloatArray:
        """Covariance of centre_x, centre_y, semi_major, semi_minor, theta: (5, 5).

        Linear approximation; units mm and rad. Near a circle the variance of theta grows
        without limit, as it should; `interval` is right there too.
        """
        rows = np.zeros((5, 5))
        rows[0, 0] = rows[1, 1] = 1.0
        rows[2] = semi_major_gradient(self.fit.parameters)
        rows[3] = semi_minor_gradient(self.fit.parameters)
        rows[4] = self._theta_gradient
        covariance: FloatArray = rows @ self.fit.parameter_covariance @ rows.T
        return covariance

    @property
    def radius_std(self) -> float:
        """Standard uncertainty of the radius. Units: mm.

        Definition: rms change of b over the distribution of (m, p, q), by the six points of a
        rule of third degree. That is the linear approximation where the section is surely no
        circle; near one, b = m - |(p, q)| has a kink that the linear approximation does not see.
        """
        covariance = self.fit.parameter_covariance[2:, 2:]
        variances, axes = np.linalg.eigh(covariance)
        steps = axes * np.sqrt(3 * np.maximum(variances, 0.0))
        shifted = self.fit.parameters[2:, None] + np.concatenate([steps, -steps], axis=1)
        radii = shifted[0] - np.hypot(shifted[1], shifted[2])
        return math.sqrt(float(((radii - self.radius) ** 2).sum()) / 6)

    @property
    def theta_std(self) -> float:
        """One sigma of theta; at most that of a uniform direction. Units: rad."""
        return min(self._std(self._theta_gradient), THETA_UNKNOWN_STD)

    @property
    def phi_std(self) -> float:
        """One sigma of phi. Units: rad.

        Definition: that of the ratio b / a divided by sin(phi); where phi is smaller than its
        own error, the phi whose ratio is one sigma from 1.
        """
        a, b = self.ellipse.semi_major, self.ellipse.semi_minor
        parameters = self.fit.parameters
        ratio = semi_minor_gradient(parameters) / a - semi_major_gradient(parameters) * b / a**2
        ratio_std = self._std(ratio)
        linear = ratio_std / max(math.sin(self.phi), 1e-12)
        return min(linear, math.acos(max(1 - ratio_std, 0.0)))

    @property
    def residual_correlation(self) -> float:
        """Points for each independent one among the residuals; 1 for independent errors.

        Above 1 the residuals are not random at the level of the noise: the sensor smooths along
        the line, or the surface is no cylinder's to that level. The covariance and the intervals
        are wider by as much already.
        """
        return self.fit.correlation.autocorrelation_time

    @property
    def theta_determined(self) -> bool:
        """Whether theta means something.

        The section is no circle, at 99.9 % confidence, and theta not off by 30 deg, at 99 %.
        """
        return theta_is_determined(self.fit)

    def interval(self, quantity: Quantity, level: float = 0.95) -> tuple[float, float]:
        """Interval that holds the true value with probability `level`.

        Parameters
        ----------
        quantity : {"radius", "theta", "phi", "centre_x", "centre_y"}
            Units: mm or rad.
        level : float
            Between 0 and 1.

        Returns
        -------
        low, high : float
            For theta both may leave [0, pi): the interval runs from low to high through pi;
            (0, pi) means any direction.

        Raises
        ------
        ValueError
            If the quantity is none of these or the level is no probability.

        Examples
        --------
        >>> import lsvision as lsv
        >>> section = lsv.simulate.random_section("single", 7, noise_mm=0.02)
        >>> (pipe,) = lsv.measure_cylinders(section.profile).cylinders
        >>> low, high = pipe.interval("phi", level=0.99)
        >>> 0 < low < pipe.phi < high
        True
        """
        return interval(self.fit, quantity, level)

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """The numbers of tables and files in mm and deg, with sigmas and 95 % intervals."""
        return tuple(
            replace(each, interval=each.quantity.in_unit(self.interval(name, LEVEL)))
            for each, name in zip(self._values, get_args(Quantity), strict=True)
        )

    @property
    def _values(self) -> tuple[Estimate, ...]:
        """The same without the intervals, which take some ms."""
        x_std, y_std = (math.sqrt(variance) for variance in self.covariance.diagonal()[:2])
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
        record["semi_major_mm"] = finite(self.ellipse.semi_major)
        record["semi_minor_mm"] = finite(self.ellipse.semi_minor)
        record["axis_twins"] = [numbers(axis) for axis in self.axis_candidates]
        record["indices"] = [int(index) for index in self.indices]
        return record

    def _summary(self) -> str:
        words = [
            f"{each.quantity.name.replace('_', ' ')} {each.text}"
            + (f" {each.quantity.unit}" if each.determined else "")
            for each in self._values
        ]
        return ", ".join([*words, f"{len(self.indices)} points"])

    def _cells(self) -> list[tuple[str, ...]]:
        return section_cells([self])

    def _rows(self) -> list[Record]:
        return [section_row(self.to_dict())]

    def _picture(self) -> str:
        points = self.fit.problem.points
        return draw_svg(points, [(points, self.ellipse)], "a section of a cylinder")

    @property
    def _theta_gradient(self) -> FloatArray:
        p, q = (float(value) for value in self.fit.parameters[3:])
        h = max(math.hypot(p, q), 1e-12)
        across = (-q / h, p / h) if p or q else (0.0, 1.0)
        return np.array([0.0, 0.0, 0.0, *across]) / (2 * h)

    def _std(self, gradient: FloatArray) -> float:
        return math.sqrt(float(gradient @ self.fit.parameter_covariance @ gradient))
