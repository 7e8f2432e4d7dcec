"""Prior on the tilt phi of a cylinder in the ellipse fit.

In the fit's parameters (centre, m, p, q) the tilt is ``tan^2(phi / 2) = h / m`` with
``h = |(p, q)|``; the prior does not constrain theta.
"""

import math
from dataclasses import dataclass

import numpy as np

from lsvision.geometry import FloatArray

EXACT_STD = 1e-6
"""Standard deviation of an exact phi in rad, and of an exact radius over the radius: negligible
against noise, but not singular."""
PERPENDICULAR_PHI_STD = 1e-3
"""Standard deviation of an exact phi near 0: a - b is then half a millionth of a. Units: rad."""
MAX_CIRCLE_SIGMAS = 2.0
"""Ratio of phi to its prior std up to which the section may be a circle."""
TINY_DIVISOR = 1e-12
"""Smallest divisor m, and ratio h / m, of a step that is not an ellipse."""


@dataclass(frozen=True, slots=True)
class PhiPrior:
    """Tilt that is known before the measurement, from the setup of laser and part.

    Parameters
    ----------
    phi : float
        Angle between the cylinder's axis and the normal of the laser plane. Units: rad, from 0
        to below pi / 2. At 0 the section is a circle.
    std : float
        Standard uncertainty; ``std = 0`` means exactly known. Units: rad.

    Notes
    -----
    More than two sigmas from 0 the prior is normal in phi. All (p, q) on a ring have this phi, so
    `fit_ellipse` uses the prior only where the points themselves determine theta.

    Within two sigmas of 0 the section may be a circle, at which phi is not a regular parameter: a
    cost of (phi / std)^2 has a cusp, where the fit would stop with a variance that is far too
    small. In this case (p, q) / m has a normal prior about zero, with the second moments for a phi
    that is the modulus of a normal variable and a uniform theta: with h / m = (phi / 2)^2, as for
    small angles, f = (phi / 2)^2 and v = (std / 2)^2, E h^2 / m^2 = f^2 + 6 f v + 3 v^2. They
    suffice for a linear estimate.

    Raises
    ------
    ValueError
        If phi is not in [0, pi / 2) or the std is negative.

    Examples
    --------
    >>> perpendicular = PhiPrior(0.0, math.radians(2.0))
    >>> residuals, _ = perpendicular.residuals_and_jacobian(np.array([0.0, -400.0, 20.0, 0.0, 0.0]))
    >>> residuals
    array([0., 0.])
    """

    phi: float
    std: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.phi < math.pi / 2:
            raise ValueError(f"expected a known phi from 0 to below pi / 2 rad, got {self.phi}")
        if not (math.isfinite(self.std) and self.std >= 0):
            raise ValueError(f"expected a known phi with std >= 0 rad, got {self.std}")

    @property
    def includes_circle(self) -> bool:
        """Whether a circle lies within two sigmas."""
        return self.phi <= MAX_CIRCLE_SIGMAS * self.std or self.phi < EXACT_STD

    @property
    def residual_count(self) -> int:
        """Number of residuals of the prior."""
        return 2 if self.includes_circle else 1

    @property
    def deviator_std(self) -> float:
        """Standard deviation of p / m and of q / m in the prior about a circle."""
        f, v = (self.phi / 2) ** 2, (max(self.std, PERPENDICULAR_PHI_STD) / 2) ** 2
        return math.sqrt((f * f + 6 * f * v + 3 * v * v) / 2)

    def compute_critical_ratio(self, level: float) -> float:
        """Return the critical likelihood ratio of the prior alone, near a circle.

        Definition: (h / m)^2 / deviator_std^2 at the `level` quantile of phi, the modulus of a
        normal variable. It exceeds the quantile of chi^2, because h is quadratic in phi.
        """
        from scipy.optimize import brentq
        from scipy.special import ndtr

        s = max(self.std, PERPENDICULAR_PHI_STD)
        phi = self.phi / s
        # Chebyshev's inequality bounds the quantile of any distribution.
        largest = phi + 1 / math.sqrt(1 - level)
        upper = brentq(lambda x: ndtr(x - phi) - ndtr(-x - phi) - level, 0.0, largest)
        return float(((upper * s / 2) ** 2 / self.deviator_std) ** 2)

    def residuals_and_jacobian(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the residuals of the prior over their standard deviations, and their derivative.

        Returns
        -------
        residuals : (k,) ndarray
            Residuals of the prior: two near a circle, else one.
        jacobian : (k, 5) ndarray
            Derivative by (centre_x, centre_y, m, p, q). Units: 1/mm.
        """
        m, p, q = (float(value) for value in parameters[2:])
        # A step of the iteration may have m <= 0, which is not an ellipse: avoid division by zero.
        m = max(m, TINY_DIVISOR)
        jacobian = np.zeros((self.residual_count, len(parameters)))
        if self.includes_circle:
            std = self.deviator_std
            residuals = np.array([p, q]) / (m * std)
            jacobian[:, 2] = -residuals / m
            jacobian[0, -2] = jacobian[1, -1] = 1 / (m * std)
            return residuals, jacobian
        h = max(math.hypot(p, q), TINY_DIVISOR * m)
        root = math.sqrt(h / m)
        std = max(self.std, EXACT_STD)
        # phi = 2 arctan(sqrt(h / m)).
        slope = 1 / (root * (1 + h / m) * m * std)
        jacobian[0, 2:] = -slope * h / m, slope * p / h, slope * q / h
        return np.array([(2 * math.atan(root) - self.phi) / std]), jacobian
