"""One measured section of a cylinder: the numbers a user asks for, each with its sigma."""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.ellipse.fit import EllipseFit
from lsvision.ellipse.intervals import Quantity, interval, theta_is_determined
from lsvision.ellipse.parameters import semi_major_gradient, semi_minor_gradient
from lsvision.geometry import Ellipse, FloatArray, IntArray
from lsvision.profile import Arc

THETA_UNKNOWN_STD = math.pi / math.sqrt(12)
"""Standard deviation of a direction of which nothing is known, uniform in [0, pi). Units: rad."""


@dataclass(frozen=True, eq=False, slots=True)
class CylinderSection:
    """A cylinder as one light section sees it.

    Parameters
    ----------
    fit : EllipseFit
        The ellipse with its evidence.
    arc : Arc
        The span of the profile.
    indices : (k,) int ndarray
        The points of the profile it rests on.
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
    def axis_twins(self) -> FloatArray:
        """Both axes that this one section allows: (2, 3) unit vectors, section frame."""
        return self.ellipse.axis_twins

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
        """
        return interval(self.fit, quantity, level)

    @property
    def _theta_gradient(self) -> FloatArray:
        p, q = (float(value) for value in self.fit.parameters[3:])
        h = max(math.hypot(p, q), 1e-12)
        across = (-q / h, p / h) if p or q else (0.0, 1.0)
        return np.array([0.0, 0.0, 0.0, *across]) / (2 * h)

    def _std(self, gradient: FloatArray) -> float:
        return math.sqrt(float(gradient @ self.fit.parameter_covariance @ gradient))
