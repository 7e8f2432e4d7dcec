"""Result of an ellipse fit."""

import math
from dataclasses import dataclass

from lsvision.ellipse.parameters import deviator_from_parameters
from lsvision.ellipse.problem import EllipseProblem
from lsvision.geometry import Ellipse, FloatArray
from lsvision.geometry.arrays import rms
from lsvision.geometry.noisy_points import ComplexArray
from lsvision.statistics.correlation import Correlation

NONCIRCULAR_SIGMAS = 5.0
"""Standard deviations of (p, q) from 0 above which phi and theta are taken as normally distributed:
there the mean of |(p, q)| exceeds its true value by 0.1 standard deviations (std^2 / (2 h))."""


@dataclass(frozen=True, eq=False)
class EllipseFit:
    """Fitted ellipse with its residuals and covariance.

    Parameters
    ----------
    ellipse : Ellipse
        Estimated ellipse. Units: mm, rad.
    problem : EllipseProblem
        Points, weights and priors of the least-squares problem. Orthogonal residuals: the measured
        points are displaced by a fraction of their noise, see `lsvision.ellipse.bias`.
    parameters : (5,) ndarray
        ``centre_x, centre_y, m, p, q``; see `lsvision.ellipse.parameters`. Units: mm.
    residuals : (n,) ndarray
        Signed residuals, positive outside the ellipse. Units: mm.
    normalised : (n,) ndarray
        Residuals over their predicted standard deviations; without a noise model, these are scaled
        so that chi^2 is the number of degrees of freedom.
    normals : (n,) complex ndarray
        Outward unit normals of the ellipse at the points.
    unscaled_covariance : (5, 5) ndarray
        Covariance of the parameters for a variance factor of 1. Units: mm^2.
    variance_factor : float
        Factor on that covariance: 1 where a given noise model explains the residuals; more where
        they are larger, or correlated along the line; any size where the noise is estimated.
    degrees_of_freedom : float
        Degrees of freedom of `variance_factor`: infinite for a given noise model, but 4 at most
        where the residuals are correlated.
    correlation : Correlation
        Correlation of the residuals along the line.
    converged : bool
        Whether the iteration reached its minimum; false where the ellipse was still becoming
        flatter.
    """

    ellipse: Ellipse
    problem: EllipseProblem
    parameters: FloatArray
    residuals: FloatArray
    normalised: FloatArray
    normals: ComplexArray
    unscaled_covariance: FloatArray
    variance_factor: float
    degrees_of_freedom: float
    correlation: Correlation
    converged: bool

    @property
    def parameter_covariance(self) -> FloatArray:
        """Covariance of `parameters`, (5, 5). Units: mm^2."""
        return self.variance_factor * self.unscaled_covariance

    @property
    def is_noncircular(self) -> bool:
        """Whether (p, q) differs from 0 by more than 5 standard deviations, so theta is defined."""
        (pp, pq), (_, qq) = self.parameter_covariance[-2:, -2:].tolist()
        largest = (pp + qq) / 2 + math.hypot((pp - qq) / 2, pq)
        return abs(deviator_from_parameters(self.parameters)) > NONCIRCULAR_SIGMAS * math.sqrt(
            largest
        )

    @property
    def rms(self) -> float:
        """Root mean square of the residuals. Units: mm."""
        return rms(self.residuals)
