"""A fitted cylinder with the evidence it rests on, and how far that evidence is to be trusted."""

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from lsvision.cylinder.problem import PARAMETERS, tangent_frame
from lsvision.ellipse.fit import CHI2_TEST_SIGMAS
from lsvision.geometry import BoolArray, Cylinder, FloatArray
from lsvision.statistics.correlation import autocorrelation_time


@dataclass(frozen=True, eq=False, slots=True)
class CylinderFit:
    """A cylinder with the evidence it rests on.

    Parameters
    ----------
    cylinder : Cylinder
        The estimate; its point is the axis point nearest to the points' centroid (see
        `with_reference_point`).
    covariance : (5, 5) ndarray
        Order: point along e_phi, point along e_theta (mm), direction along e_phi, direction
        along e_theta (rad), radius (mm); with `tangent_basis` = (e_phi, e_theta). That of
        ``ScanPrediction.covariance``.
    residuals : (n,) ndarray
        Signed distance of every point from the surface, positive outside. Units: mm.
    normalised : (n,) ndarray
        What the fit makes least: residuals over their predicted standard deviation (over
        their rms where no noise model is given).
    stds : (n,) ndarray
        That deviation. Units: mm.
    inliers : (n,) ndarray of bool
        The points used.
    variance_factor : float
        By which the covariance that follows from `stds` is multiplied: 1 where they explain
        the residuals; more where those are larger, or correlated along the line.
    degrees_of_freedom : float
        Of `variance_factor`; infinite where it comes from the noise model alone.
    """

    cylinder: Cylinder
    covariance: FloatArray
    residuals: FloatArray
    normalised: FloatArray
    stds: FloatArray
    inliers: BoolArray
    variance_factor: float
    degrees_of_freedom: float

    @property
    def point(self) -> FloatArray:
        """(3,) point of the axis where `covariance` holds. Units: mm."""
        return self.cylinder.point

    @property
    def direction(self) -> FloatArray:
        """(3,) unit vector along the axis."""
        return self.cylinder.direction

    @property
    def radius(self) -> float:
        """Units: mm."""
        return self.cylinder.radius

    @property
    def radius_std(self) -> float:
        """One sigma of the radius. Units: mm."""
        return math.sqrt(self.covariance[4, 4])

    @property
    def direction_std(self) -> float:
        """Root mean square angle to the true direction, both ways together. Units: rad."""
        return math.sqrt(self.covariance[2, 2] + self.covariance[3, 3])

    @property
    def position_std(self) -> float:
        """Root mean square distance of `point` from the true axis. Units: mm."""
        return math.sqrt(self.covariance[0, 0] + self.covariance[1, 1])

    @property
    def tangent_basis(self) -> FloatArray:
        """(2, 3) e_phi and e_theta: the way the angle from Z grows, and Z x direction."""
        return tangent_frame(self.direction)[:2]

    @property
    def rms(self) -> float:
        """Root mean square residual of the points used. Units: mm."""
        return float(np.sqrt(np.mean(self.residuals[self.inliers] ** 2)))

    def with_reference_point(self, place: npt.ArrayLike) -> "CylinderFit":
        """The same fit with its point, and the covariance, at the axis point nearest to `place`.

        Parameters
        ----------
        place : (3,) array_like
            Frame of the points. Units: mm.
        """
        shift = float((np.asarray(place, dtype=np.float64) - self.point) @ self.direction)
        cylinder = Cylinder(self.point + shift * self.direction, self.direction, self.radius)
        carry = np.eye(PARAMETERS)
        carry[0, 2] = carry[1, 3] = shift
        return replace(self, cylinder=cylinder, covariance=carry @ self.covariance @ carry.T)

    def with_reversed_direction(self) -> "CylinderFit":
        """The same fit with its direction the other way round."""
        cylinder = Cylinder(self.point, -self.direction, self.radius)
        # e_phi stays and e_theta changes sign with the direction: (I - 2 e e') carries both.
        carry = tangent_frame(-self.direction)[:2] @ self.tangent_basis.T
        both = np.eye(PARAMETERS)
        both[:2, :2], both[2:4, 2:4] = carry, -carry
        return replace(self, cylinder=cylinder, covariance=both @ self.covariance @ both.T)


def variance_factor(
    normalised: FloatArray, degrees_of_freedom: int, *, known_noise: bool
) -> tuple[float, float, float]:
    """By how much residuals say that a covariance must be stretched.

    Parameters
    ----------
    normalised : (n,) ndarray
        Residuals over their predicted standard deviation, in their order along the line.
    degrees_of_freedom : int
        Residuals less unknowns.
    known_noise : bool
        Whether the deviations are a noise model's; else only their ratios count.

    Returns
    -------
    factor, freedom : float
        And how well it is known.
    spread : float
        By which to multiply the deviations first; 1 with known noise.
    """
    degrees_of_freedom = max(degrees_of_freedom, 1)
    excess = float(normalised @ normalised) / degrees_of_freedom
    correlation = autocorrelation_time(normalised)
    if known_noise:
        surprising = excess > 1 + CHI2_TEST_SIGMAS * math.sqrt(2 / degrees_of_freedom)
        return (excess if surprising else 1.0) * correlation, math.inf, 1.0
    excess = max(excess, float(np.finfo(float).tiny))
    return correlation, max(degrees_of_freedom / correlation, 1.0), math.sqrt(excess)
